"""Faults of one file as they are found."""

from __future__ import annotations

from dataclasses import dataclass, field

from kiribench.errors import Fault


@dataclass
class Findings:
    """A growing list of faults of one file.

    Attributes:
        file: that they are about.
        faults: in the order of finding.
    """

    file: str | None
    faults: list[Fault] = field(default_factory=list)

    def error(
        self, code: str, what: str, remedy: str, got: object = None, expected: object = None
    ) -> None:
        """Something that must not be cut."""
        self.faults.append(
            Fault(code, what, remedy, file=self.file, got=_text(got), expected=_text(expected))
        )

    def warning(
        self, code: str, what: str, remedy: str, got: object = None, expected: object = None
    ) -> None:
        """Something to know before cutting."""
        self.faults.append(
            Fault(
                code,
                what,
                remedy,
                file=self.file,
                got=_text(got),
                expected=_text(expected),
                severity="warning",
            )
        )


def _text(value: object) -> str | None:
    return None if value is None else str(value)
