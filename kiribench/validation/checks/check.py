"""What a numbered check is, and what it says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from kiribench.validation.fold import Fold
from kiribench.validation.ranking import Ranking
from kiribench.validation.summary import Summary
from kiribench.validation.table import CvTable

FloatArray = NDArray[np.float64]
Severity = Literal["error", "warning", "note"]
Status = Literal["fired", "passed", "not applicable"]


@dataclass(frozen=True, eq=False)
class Wanted:
    """What the surrogate is wanted for: strain and Poisson's ratio of skin cells.

    Attributes:
        longitudinal_strain, poisson_ratio: (k,).
        measure: their strain measure, ``None`` where the file does not say.
        source: the file's name.
    """

    longitudinal_strain: FloatArray
    poisson_ratio: FloatArray
    measure: str | None
    source: str


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the checks look at.

    Attributes:
        table: the rows.
        folds: by protocol.
        summaries: by protocol, then by model.
        ranking: of the headline protocol, if it was run.
        wanted: what the surrogate is wanted for, if the user said so.
    """

    table: CvTable
    folds: dict[str, tuple[Fold, ...]] = field(default_factory=dict)
    summaries: dict[str, dict[str, Summary]] = field(default_factory=dict)
    ranking: Ranking | None = None
    wanted: Wanted | None = None


@dataclass(frozen=True)
class Found:
    """What one check found.

    Attributes:
        status: ``fired``, ``passed`` or ``not applicable``.
        detail: one or two sentences with the numbers.
        severity: where it differs from the check's own, else ``None``.
    """

    status: Status
    detail: str
    severity: Severity | None = None


@dataclass(frozen=True)
class Check:
    """A numbered check.

    Attributes:
        code: ``KB001`` and so on; stable.
        title: what is wrong where it fires.
        severity: ``error`` (the scores mislead), ``warning`` or ``note``.
        remedy: what to do.
        look: the check itself.
    """

    code: str
    title: str
    severity: Severity
    remedy: str
    look: Callable[[Evidence], Found]

    @property
    def page(self) -> str:
        """Where it is explained, from the root of the sources."""
        return f"docs/checks/{self.code}.md"


def passed(detail: str) -> Found:
    """Nothing wrong."""
    return Found("passed", detail)


def not_applicable(detail: str) -> Found:
    """The check says nothing about this table."""
    return Found("not applicable", detail)


def fired(detail: str, severity: Severity | None = None) -> Found:
    """Something is wrong."""
    return Found("fired", detail, severity)
