"""The numbered checks, one a file; each has a page in docs/checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kiribench.validation.checks import (
    kb001_split_groups,
    kb002_unshuffled,
    kb003_target_leakage,
    kb004_few_designs,
    kb005_under_fitted,
    kb006_calibration,
    kb007_extrapolation,
    kb008_mixed_measures,
    kb009_duplicates,
    kb010_below_mesh_error,
)
from kiribench.validation.checks.check import Check, Evidence, Found, Severity

CHECKS: tuple[Check, ...] = (
    kb001_split_groups.CHECK,
    kb002_unshuffled.CHECK,
    kb003_target_leakage.CHECK,
    kb004_few_designs.CHECK,
    kb005_under_fitted.CHECK,
    kb006_calibration.CHECK,
    kb007_extrapolation.CHECK,
    kb008_mixed_measures.CHECK,
    kb009_duplicates.CHECK,
    kb010_below_mesh_error.CHECK,
)


@dataclass(frozen=True)
class CheckResult:
    """A check with what it found."""

    check: Check
    found: Found

    @property
    def severity(self) -> Severity:
        """How bad it is where it fired."""
        return self.found.severity or self.check.severity

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "code": self.check.code,
            "title": self.check.title,
            "status": self.found.status,
            "severity": self.severity if self.found.status == "fired" else None,
            "detail": self.found.detail,
            "remedy": self.check.remedy,
            "page": self.check.page,
        }


def run_checks(evidence: Evidence) -> tuple[CheckResult, ...]:
    """All checks, in the order of their numbers."""
    return tuple(CheckResult(check, check.look(evidence)) for check in CHECKS)
