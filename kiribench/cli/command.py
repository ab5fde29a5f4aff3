"""What every command takes and gives: the common options and the outcome."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from kiribench.errors import EXIT_OK, Fault


@Parameter(name="*")
@dataclass(frozen=True)
class Common:
    """Options of every command.

    Parameters
    ----------
    out
        Folder for the result files; made if it is not there.
    json
        Print one JSON object instead of text.
    quiet
        No progress bars and no warnings on stderr.
    """

    out: Path | None = None
    json: Annotated[bool, Parameter(negative=())] = False
    quiet: Annotated[bool, Parameter(negative=())] = False


@dataclass(frozen=True)
class Outcome:
    """What a command gives back to the launcher.

    Attributes:
        result: one JSON object; its ``schema`` key names the kind and the version.
        text: the same for a person; the last line is a verdict in words.
        exit_code: 0, or 1 where a gate that the user set has failed.
        faults: warnings, or the reason of a failed gate; printed to stderr.
        inputs: every file that was read, for the provenance.
    """

    result: dict[str, Any]
    text: str
    exit_code: int = EXIT_OK
    faults: tuple[Fault, ...] = ()
    inputs: tuple[Path, ...] = field(default=())
