"""The placement tolerance that ``kiribench check`` writes beside a design, for the job sheet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from kiribench.errors import Fault
from kiribench.schema.strict_json import parse_json

SCHEMA = "kiribench.placement/1"
FILE = "placement.json"


@dataclass(frozen=True)
class Placement:
    """How far off the patch may be worn.

    Attributes:
        share: of the best share of cells that must be kept, as the file states it, or None.
        allowed: (what, how much) in words, in the order of the file.
    """

    share: float | None
    allowed: tuple[tuple[str, str], ...]


def read_placement(folder: Path) -> tuple[Placement | None, tuple[Fault, ...]]:
    """The tolerance in ``folder``, None where there is no file or none that can be read."""
    path = folder / FILE
    if not path.is_file():
        return None, ()
    content, faults = parse_json(path.read_bytes(), file=str(path))
    if content is None or content.get("schema") != SCHEMA:
        return None, (
            Fault(
                "placement-unreadable",
                "The placement tolerance beside the design cannot be read.",
                "Run kiribench check again, or remove the file.",
                file=str(path),
                got=None if content is None else ascii(content.get("schema"))[:60],
                expected=SCHEMA,
                severity="warning",
            ),
            *faults,
        )
    allowed = []
    offsets = content.get("offsets_mm")
    for way, value in (offsets if isinstance(offsets, dict) else {}).items():
        allowed.append((f"shifted {way}", _amount(value, "mm")))
    for key, words, unit in (
        ("turn_deg", "turned", "degrees"),
        ("strap_slip_mm", "lower strap slipped", "mm"),
    ):
        if key in content:
            allowed.append((words, _amount(content[key], unit)))
    share = content.get("share")
    number = isinstance(share, (int, float)) and not isinstance(share, bool)
    return Placement(float(share) if number and share is not None else None, tuple(allowed)), faults


def _amount(value: object, unit: str) -> str:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return "not known"
    return f"up to {value:.3g} {unit}"
