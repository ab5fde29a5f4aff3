"""One tension test studied: fits, comparison, what they mean for a cut sheet; and its tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kiribench.calibration.compare import (
    Change,
    GivenModulus,
    LeftOut,
    given_modulus,
    left_out,
    set_up_errors,
    verdict,
)
from kiribench.calibration.consequences import CellPull, pull_cell
from kiribench.calibration.curve import STRAIN_SOURCE_WORDS, StrainRange, TensileCurve
from kiribench.calibration.fit import WEIGHTING_WORDS, Fit, RangeScore, Weighting, fit_law, scores
from kiribench.fem.material import NeoHookean, Ogden
from kiribench.schema.result_tables import write_table

NOT_SIMULATED = (
    "The finite elements take neo-Hookean and one-term Ogden laws; Yeoh and Ogden laws of more "
    "terms are fitted only."
)


@dataclass(frozen=True, eq=False)
class Study:
    """Everything that is known from one tension test.

    Attributes:
        curve: the test.
        fits: one a law, in the order asked for.
        left: of each fit: parts of the range left out.
        ranges: of each fit: how it does from 0 to several strains.
        changes: of each fit: what errors of the set-up would do.
        given: a modulus from elsewhere beside the test.
        pulls: cut pattern -> the cell pulled with each law that the finite elements take; the
            first is the given modulus.
        attribution: what the data's source asks to be said, or None.
    """

    curve: TensileCurve
    fits: tuple[Fit, ...]
    left: tuple[LeftOut, ...]
    ranges: tuple[tuple[RangeScore, ...], ...]
    changes: tuple[tuple[Change, ...], ...]
    given: GivenModulus
    pulls: tuple[tuple[CellPull, ...], ...]
    attribution: str | None

    @property
    def verdict(self) -> str:
        """Which law to use for what, in one sentence."""
        return _verdict(self)

    @property
    def lines(self) -> list[str]:
        """A text for a person, without the verdict."""
        return _lines(self)

    @property
    def result(self) -> dict[str, Any]:
        """A JSON object."""
        return _object(self)


def study(
    curve: TensileCurve,
    names: Sequence[str],
    strain_range: StrainRange,
    *,
    weighting: Weighting = "stress",
    modulus_mpa: float = 0.207,
    cuts: Sequence[tuple[float, float]] = (),
) -> Study:
    """Fit laws to a test and show what they are worth.

    Args:
        curve: the test.
        names: of the laws, see :data:`kiribench.calibration.fit.LAW_NAMES`.
        strain_range: engineering strains that the fits use.
        weighting: of the rows.
        modulus_mpa: a neo-Hookean shear modulus from elsewhere.
        cuts: cut patterns (a, b as parts of the cell) that are pulled with each law.

    Raises:
        DataError: ``tension-test-short``: too few rows in the range.
    """
    fits = tuple(fit_law(name, curve, strain_range, weighting=weighting) for name in names)
    laws = [fit.law for fit in fits if isinstance(fit.law, (NeoHookean, Ogden))]
    simulated = [NeoHookean(modulus_mpa), *dict.fromkeys(laws)]
    return Study(
        curve=curve,
        fits=fits,
        left=tuple(left_out(fit, curve) for fit in fits),
        ranges=tuple(scores(fit.law, curve, fitted=strain_range) for fit in fits),
        changes=tuple(set_up_errors(fit, curve) for fit in fits),
        given=given_modulus(curve, modulus_mpa),
        pulls=tuple(tuple(pull_cell(a, b, law) for law in simulated) for a, b in cuts),
        attribution=None
        if curve.file is None
        else (found[1] if (found := attribution_of(curve.file)) else None),
    )


def attribution_of(file: Path) -> tuple[Path, str] | None:
    """What the SOURCE.txt beside a file says of source and licence, with its path."""
    beside = file.parent / "SOURCE.txt"
    if not beside.is_file() or beside.stat().st_size > 100_000:
        return None
    text = beside.read_text(encoding="utf-8", errors="replace")
    said = [line.strip() for line in text.split("\n") if line.startswith(("SOURCE:", "LICENCE:"))]
    return (beside, " ".join(said)) if said else None


def write_fits(path: Path, found: Study) -> Path:
    """Write ``path``: one row a parameter of every fit, with its sidecar."""
    rows = []
    for fit in found.fits:
        for k, name in enumerate(fit.parameters):
            low, high = (float(value) for value in fit.interval[k])
            rows.append(
                {
                    "law": fit.name,
                    "parameter": name,
                    "value": float(fit.values[k]),
                    "low": low,
                    "high": high,
                    "noise_sd": float(fit.uncertainty.noise_sd[k]),
                    "misfit_sd": float(fit.uncertainty.misfit_sd[k]),
                    "strain_low": fit.range.low,
                    "strain_high": fit.range.high,
                    "rms_mpa": fit.rms_mpa,
                }
            )
    write_table(
        path,
        rows,
        {
            "Schema": "kiribench.fits/1",
            "Columns": {
                "law": "name of the law",
                "parameter": "with its unit; exponents have none",
                "value": "least squares",
                "low": "lower end of the 95 % interval",
                "high": "upper end of the 95 % interval",
                "noise_sd": "standard deviation by the noise of the rows alone",
                "misfit_sd": "standard deviation by what hangs together along the curve",
                "strain_low": "engineering strain from which the fit uses the test",
                "strain_high": "engineering strain up to which the fit uses the test",
                "rms_mpa": "root mean square error of the nominal stress in that range, MPa",
            },
            "StrainFrom": found.curve.source,
            "Weighting": found.fits[0].weighting,
            "Attribution": found.attribution,
        },
    )
    return path


def _verdict(found: Study) -> str:
    words = verdict([fit.name for fit in found.fits], found.left)
    given = found.given
    small = {x: error for x, error in given.stress_error.items() if x <= 1.0}
    if small:
        worst = max(small, key=lambda x: abs(small[x]))
        words += (
            f" A neo-Hookean {given.mu_mpa:g} MPa errs by {100 * small[worst]:+.0f} % at strain "
            f"{worst:g}"
            + (
                f" and is the least-squares fit up to strain {given.equal_up_to:.2f}."
                if given.equal_up_to is not None
                else " and is the least-squares fit of no range."
            )
        )
    return words


def _lines(found: Study) -> list[str]:
    curve = found.curve
    first = found.fits[0]
    lines = [
        f"{len(curve.stretch)} rows, engineering strain {curve.strain[0]:.3f} to "
        f"{curve.strain[-1]:.3f}, nominal stress up to {curve.stress_mpa.max():.3f} MPa",
        f"Strain by {STRAIN_SOURCE_WORDS[curve.source]}.",
        f"Fitted on strains {first.range} ({first.rows} rows); {WEIGHTING_WORDS[first.weighting]}.",
    ]
    for fit, left in zip(found.fits, found.left, strict=True):
        lines.append(
            f"{fit.name}: {fit_words(fit)}; rms {fit.rms_mpa:.4f} MPa, left-out parts "
            f"{left.bridged_mpa:.4f} MPa; {stability_words(fit)}"
        )
    for pulls in found.pulls:
        lines += choice_words(pulls)
    if found.pulls:
        lines.append(NOT_SIMULATED)
    if found.attribution:
        lines.append(f"Data: {found.attribution}")
    return lines


def fit_words(fit: Fit) -> str:
    """Parameters with their 95 % intervals."""
    shown = ", ".join(
        f"{name.removesuffix('_mpa')} {value:.4g} ± {half:.2g}"
        + (" MPa" if name.endswith("_mpa") else "")
        for name, value, half in zip(
            fit.parameters, fit.values, fit.uncertainty.half_width, strict=True
        )
    )
    if fit.vanished:
        shown += (
            f" ({fit.vanished} of the terms vanish{'es' if fit.vanished == 1 else ''}: no further "
            "stable term fits better)"
        )
    if fit.at_bound:
        shown += f" (at the edge of the search: {', '.join(fit.at_bound)})"
    return shown


def stability_words(fit: Fit) -> str:
    """Drucker's condition in words."""
    unstable = {k: x for k, x in fit.stability.first_unstable.items() if x is not None}
    if not unstable:
        return f"stable up to strain {fit.stability.largest_strain:.2f}"
    return "UNSTABLE in " + ", ".join(f"{k} tension from {x:.2f}" for k, x in unstable.items())


def law_words(law: NeoHookean | Ogden) -> str:
    """A law of the finite elements in short."""
    if isinstance(law, NeoHookean):
        return f"neo-Hookean {law.mu_mpa:.4g} MPa"
    return f"Ogden {law.mu_mpa:.4g} MPa, alpha {law.alpha:.4g}"


def choice_words(pulls: Sequence[CellPull]) -> list[str]:
    """What another law than the first changes in one cut pattern, by law."""
    base = pulls[0]
    lines = [
        f"Cell a = {100 * base.a:g} %, b = {100 * base.b:g} %, stretch {base.stretch[0]:g} to "
        f"{base.stretch[-1]:g}, against {law_words(base.material)}:"
    ]
    for other in pulls[1:]:
        nu = float(np.nanmax(np.abs(other.poisson - base.poisson)))
        lines.append(
            f"  {law_words(other.material)}: force x {_span(other.stress_mpa / base.stress_mpa)}, "
            f"tip stress x {_span(other.tip_stress_mpa / base.tip_stress_mpa)}, Poisson's ratio "
            + ("unchanged" if nu < 1e-6 else f"changed by up to {nu:.3f}")
        )
    return lines


def _span(values: Any) -> str:
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return f"{low:.3f}" if high - low < 5e-4 else f"{low:.2f} to {high:.2f}"


def _list(values: Any) -> list[float | None]:
    return [float(x) if np.isfinite(x) else None for x in values]


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _object(found: Study) -> dict[str, Any]:
    curve = found.curve
    return {
        "test": {
            "rows": len(curve.stretch),
            "largest_strain": float(curve.strain[-1]),
            "largest_stress_mpa": float(curve.stress_mpa.max()),
            "strain_from": curve.source,
            "strain_from_words": STRAIN_SOURCE_WORDS[curve.source],
            "columns": list(curve.columns),
            "length_mm": curve.sample.length_mm,
            "width_mm": curve.sample.width_mm,
            "thickness_mm": curve.sample.thickness_mm,
            "noise_mpa": _number(curve.noise_mpa),
        },
        "strain_range": [found.fits[0].range.low, found.fits[0].range.high],
        "weighting": found.fits[0].weighting,
        "fits": [
            {
                "law": fit.name,
                "rows": fit.rows,
                "parameters": {
                    name: {
                        "value": float(fit.values[k]),
                        "interval": _list(fit.interval[k]),
                        "noise_sd": float(fit.uncertainty.noise_sd[k]),
                        "misfit_sd": float(fit.uncertainty.misfit_sd[k]),
                        "jackknife_sd": _number(left.jackknife_sd[k]),
                    }
                    for k, name in enumerate(fit.parameters)
                },
                "correlation": [_list(row) for row in fit.uncertainty.correlation],
                "initial_shear_modulus_mpa": fit.initial_shear_modulus_mpa,
                "rms_mpa": fit.rms_mpa,
                "condition": fit.condition,
                "at_bound": list(fit.at_bound),
                "terms_vanished": fit.vanished,
                "stable": fit.stability.stable,
                "first_unstable_strain": fit.stability.first_unstable,
                "left_out_rms_mpa": _list(left.rms_mpa),
                "ranges": [
                    {
                        "strain": [one.range.low, one.range.high],
                        "rows": one.rows,
                        "rms_mpa": _number(one.rms_mpa),
                        "worst_relative_error": _number(one.worst),
                        "worst_at_strain": _number(one.worst_at),
                        "within_fit": one.fitted,
                    }
                    for one in ranges
                ],
                "set_up_errors": [
                    {
                        "what": change.what,
                        "initial_modulus_percent": change.modulus_percent,
                        "parameters": list(change.values),
                    }
                    for change in changes
                ],
            }
            for fit, left, ranges, changes in zip(
                found.fits, found.left, found.ranges, found.changes, strict=True
            )
        ],
        "given_modulus": {
            "mu_mpa": found.given.mu_mpa,
            "equal_to_fit_up_to_strain": found.given.equal_up_to,
            "stress_exact_at_strain": found.given.exact_at,
            "modulus_by_range": [
                {"largest_strain": x, "mu_mpa": mu}
                for x, mu in found.given.modulus_by_range.items()
            ],
            "stress_error": [
                {"strain": x, "relative": error} for x, error in found.given.stress_error.items()
            ],
        },
        "choice": [
            {
                "a_percent": 100 * pulls[0].a,
                "b_percent": 100 * pulls[0].b,
                "longitudinal_stretch": _list(pulls[0].stretch),
                "laws": [
                    {
                        "law": law_words(pull.material),
                        "poisson_ratio": _list(pull.poisson),
                        "nominal_stress_mpa": _list(pull.stress_mpa),
                        "tip_stress_mpa": _list(pull.tip_stress_mpa),
                        "tip_stretch": _list(pull.tip_stretch),
                    }
                    for pull in pulls
                ],
            }
            for pulls in found.pulls
        ],
        "not_simulated": NOT_SIMULATED,
        "attribution": found.attribution,
        "verdict": found.verdict,
    }
