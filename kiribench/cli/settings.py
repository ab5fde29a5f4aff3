"""The settings that were in force: flags, settings file and defaults together, as JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any


def effective_settings(arguments: Mapping[str, Any], config: Path | None) -> dict[str, Any]:
    """Every option with the value that was used, ready for JSON.

    Args:
        arguments: the bound arguments of a command, defaults applied.
        config: the settings file that was named, if any.

    Returns:
        Names as in the settings file (dashes), nested options flattened.
    """
    settings: dict[str, Any] = {}
    for name, value in arguments.items():
        if is_dataclass(value) and not isinstance(value, type):
            nested = {field.name: getattr(value, field.name) for field in fields(value)}
            settings.update(effective_settings(nested, None))
        else:
            settings[name.replace("_", "-")] = _plain(value)
    if config is not None:
        settings["config"] = str(config)
    return settings


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    return str(value)
