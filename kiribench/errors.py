"""The error tree: every error that a user can meet, each with its exit code.

An error says what is wrong, where (file, row, column), what was found, what was
expected and what to do about it. Anything that is not a :class:`KiribenchError` is a bug
of ours and ends with exit code 70.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

EXIT_OK = 0
EXIT_GATE_FAILED = 1
EXIT_USAGE = 2
EXIT_BAD_DATA = 3
EXIT_NOT_CONVERGED = 4
EXIT_BUG = 70
EXIT_INTERRUPTED = 130

Severity = Literal["error", "warning"]


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong with the input, with its place and its remedy.

    Attributes:
        code: a short stable name in kebab case, such as ``mesh-nan-vertex``; tests and
            scripts match on it, never on the prose.
        what: one sentence, plain words.
        remedy: what the user can do about it.
        file: the file, as given by the user or relative to the dataset.
        row: 1-based line of a text file, or data row of a table (header not counted).
        column: the column's name, or the JSON key.
        got, expected: the offending value and the admissible one, as short text.
        severity: ``"error"`` stops the work, ``"warning"`` does not.
    """

    code: str
    what: str
    remedy: str
    file: str | None = None
    row: int | None = None
    column: str | None = None
    got: str | None = None
    expected: str | None = None
    severity: Severity = "error"

    @property
    def where(self) -> str:
        """The place as ``file, row 3, column x_mm``; empty where there is none."""
        parts = [self.file] if self.file else []
        if self.row is not None:
            parts.append(f"row {self.row}")
        if self.column is not None:
            parts.append(f"column {self.column}")
        return ", ".join(parts)

    def __str__(self) -> str:
        text = f"{self.severity}[{self.code}]"
        if self.where:
            text += f" {self.where}"
        text += f": {self.what}"
        if self.got is not None:
            text += f" Got {self.got}."
        if self.expected is not None:
            text += f" Expected {self.expected}."
        return f"{text} Remedy: {self.remedy}"

    def as_dict(self) -> dict[str, Any]:
        """The fault as a JSON object; absent places are left out."""
        return {key: value for key, value in asdict(self).items() if value is not None}


class KiribenchError(Exception):
    """Base of all errors that a user can cause or meet; carries one or more faults.

    Raise a subclass as ``MeshError("mesh-empty", "The scan has no faces.", remedy="...",
    file=path)``, or with many faults at once as ``DatasetError.of(faults)``.
    """

    exit_code = EXIT_BUG

    def __init__(
        self,
        code: str,
        what: str,
        *,
        remedy: str,
        file: str | Path | None = None,
        row: int | None = None,
        column: str | None = None,
        got: object = None,
        expected: object = None,
    ) -> None:
        self.faults: tuple[Fault, ...] = (
            Fault(
                code=code,
                what=what,
                remedy=remedy,
                file=None if file is None else str(file),
                row=row,
                column=column,
                got=None if got is None else str(got),
                expected=None if expected is None else str(expected),
            ),
        )
        super().__init__(str(self.faults[0]))

    @classmethod
    def of(cls, faults: Iterable[Fault]) -> KiribenchError:
        """An error that carries all of ``faults`` (at least one)."""
        listed: Sequence[Fault] = tuple(faults)
        if not listed:
            raise ValueError("an error needs at least one fault")
        first = listed[0]
        error = cls(first.code, first.what, remedy=first.remedy)
        error.faults = tuple(listed)
        error.args = ("\n".join(str(fault) for fault in listed),)
        return error

    @property
    def code(self) -> str:
        """The code of the first fault."""
        return self.faults[0].code

    def __reduce__(self) -> tuple[Any, ...]:
        # Errors travel between worker processes.
        return (_rebuild, (type(self), self.faults))


def _rebuild(cls: type[KiribenchError], faults: tuple[Fault, ...]) -> KiribenchError:
    return cls.of(faults)


class GateFailed(KiribenchError):
    """A limit that the user set (``--fail-under``, a regression bound) was not met."""

    exit_code = EXIT_GATE_FAILED


class UsageError(KiribenchError):
    """The command line or the settings file is wrong."""

    exit_code = EXIT_USAGE


class DataError(KiribenchError):
    """The input data is wrong; the base of the errors below."""

    exit_code = EXIT_BAD_DATA


class DatasetError(DataError):
    """The subject folder is incomplete or inconsistent."""


class MeshError(DataError):
    """A scan cannot be read or used."""


class NodesError(DataError):
    """A nodes table is wrong, or does not lie on its surface."""


class PathError(DataError):
    """No geodesic between two nodes can be found."""


class RegistrationError(DataError):
    """Two scans cannot be brought into one frame with confidence."""


class TableError(DataError):
    """A table (design space, targets, measurements) is wrong."""


class NotConvergedError(KiribenchError):
    """An iteration ended without an answer that can be trusted."""

    exit_code = EXIT_NOT_CONVERGED
