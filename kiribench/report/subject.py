"""What the report of one subject is written from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from kiribench.conformability.result import Conformability
from kiribench.errors import Fault
from kiribench.report.truth import Truth
from kiribench.schema.layout import Layout
from kiribench.strain.result import StrainField
from kiribench.surface.mesh import Mesh


@dataclass(frozen=True, eq=False)
class SubjectReport:
    """Everything that the page of one subject shows; nothing is computed from raw scans.

    Attributes:
        participant: the subject's id, as in participants.tsv.
        dataset: the dataset's name.
        side: ``left``, ``right`` or ``none``.
        layout: grid, patch, regions and body part.
        synthetic: the scans are computed; the report then says so in its first sentence.
        conformability: the score of the worn scan, or None where it was not scored.
        strain: the skin strain between the two bare scans, or None.
        surface: the bare flexed scan for the pictures, or None.
        settings: the options in force, by their names on the command line.
        provenance: version, libraries and input hashes (:mod:`kiribench.provenance`).
        truth: of a synthetic subject, where it is known.
        warnings: what is doubtful in the input, beyond what the two results carry.
    """

    participant: str
    dataset: str
    side: str
    layout: Layout
    synthetic: bool
    conformability: Conformability | None
    strain: StrainField | None
    surface: Mesh | None
    settings: Mapping[str, Any]
    provenance: Mapping[str, Any]
    truth: Truth | None = None
    warnings: tuple[Fault, ...] = field(default=())

    @property
    def mirrored(self) -> bool:
        """Whether maps are drawn with lateral at the right, as a left leg is seen."""
        return self.side == "left"

    @property
    def limb(self) -> str:
        """``right knee``, or the body part alone."""
        part = self.layout.body_part
        return f"{self.side} {part}" if self.side in {"left", "right"} else part

    @property
    def all_warnings(self) -> tuple[Fault, ...]:
        """Warnings of the input and of both results, each once."""
        listed = [*self.warnings]
        for result in (self.conformability, self.strain):
            listed.extend(result.warnings if result else ())
        return tuple(dict.fromkeys(listed))
