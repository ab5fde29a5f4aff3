"""``kiribench calibrate``: hyperelastic laws fitted to one tension test."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kiribench.cli.command import Common, Outcome
from kiribench.errors import UsageError

if TYPE_CHECKING:
    from kiribench.calibration.study import Study

SCHEMA = "kiribench.calibrate/1"


def calibrate(
    curve: Path,
    /,
    *,
    law: Literal["neo-hookean", "ogden", "yeoh", "all"] = "all",
    ogden_terms: int = 2,
    strain_range: str = "0:1",
    weighting: Literal["stress", "relative"] = "stress",
    modulus_mpa: float = 0.207,
    cuts: str = "90,90;35,85",
    length_mm: float | None = None,
    width_mm: float | None = None,
    thickness_mm: float | None = None,
    kind: Literal["engineering", "true"] | None = None,
    strain_unit: Literal["fraction", "percent"] | None = None,
    strain_from: Literal["crosshead", "extensometer", "camera"] | None = None,
    common: Common | None = None,
) -> Outcome:
    """Fit neo-Hookean, Ogden and Yeoh laws to a tension test, with uncertainty.

    Reads a CSV of one pull: strain and stress, stretch and stress, or displacement and force
    (then with the sample's sizes). Columns are found by their names; units stand in brackets or
    in a line below the names. Separators may be semicolons, tabs or commas, decimal marks points
    or commas. With --out it also writes calibrate.html with the curve and the fits, and fits.tsv.

    Parameters
    ----------
    curve
        The CSV file.
    law
        Which laws are fitted.
    ogden_terms
        Ogden laws with 1 to this many terms are fitted, at most 3.
    strain_range
        Engineering strains that the fits use, such as 0:1 or 0:190%.
    weighting
        stress: every row's error in nominal stress counts alike. relative: every row's error
        relative to the measured stress.
    modulus_mpa
        A neo-Hookean shear modulus to lay beside the test; by default the paper's.
    cuts
        Cut patterns that are pulled with each law to show what the choice changes: pairs of cut
        lengths in percent of the cell (across, along the pull). "none" leaves that out.
    length_mm
        Undeformed length that the displacement belongs to, where the file does not say it.
    width_mm
        Undeformed width of the cross-section.
    thickness_mm
        Undeformed thickness of the cross-section.
    kind
        Engineering or true strain and stress, where the columns do not say it.
    strain_unit
        Unit of the strain, where its column does not say it.
    strain_from
        What the strain was measured by, where the file does not say it.
    """
    common = common or Common()
    if not 1 <= ogden_terms <= 3:
        raise UsageError(
            "ogden-terms",
            "The number of Ogden terms is out of range.",
            remedy="Give 1, 2 or 3: one pull does not determine more.",
            got=ogden_terms,
        )
    if not 0 < modulus_mpa < 1e6:
        raise UsageError(
            "modulus",
            "The shear modulus is not a positive number.",
            remedy="Give --modulus-mpa in MPa.",
            got=modulus_mpa,
        )
    from kiribench.calibration.curve import Sample, StrainRange
    from kiribench.calibration.read import read_curve
    from kiribench.calibration.study import attribution_of, study
    from kiribench.fem.campaign_words import read_designs

    names = {"neo-hookean": ["neo-hookean"], "yeoh": ["yeoh"]}.get(law) or [
        *(["neo-hookean"] if law == "all" else []),
        "ogden",
        *(f"ogden-{count}" for count in range(2, ogden_terms + 1)),
        *(["yeoh"] if law == "all" else []),
    ]
    asked, files = ((), ()) if cuts.strip() == "none" else read_designs(cuts)
    test = read_curve(
        curve,
        sample=Sample(length_mm, width_mm, thickness_mm),
        kind=kind,
        strain_unit=strain_unit,
        strain_from=strain_from,
    )
    found = study(
        test,
        names,
        StrainRange.parse(strain_range),
        weighting=weighting,
        modulus_mpa=modulus_mpa,
        cuts=[(design.a_percent / 100, design.b_percent / 100) for design in asked],
    )
    source = attribution_of(curve)
    page = None
    if common.out is not None:
        from kiribench.calibration.study import write_fits
        from kiribench.report.calibrate_page import write_calibrate_report

        write_fits(common.out / "fits.tsv", found)
        page = write_calibrate_report(common.out / "calibrate.html", found)
    return Outcome(
        result={
            "schema": SCHEMA,
            **found.result,
            "report": None if page is None else str(page),
        },
        text=_text(found, page),
        faults=test.notes,
        inputs=(curve, *files, *([source[0]] if source else [])),
    )


def _text(found: Study, page: Path | None) -> str:
    lines = list(found.lines)
    if page is not None:
        lines.append(f"Report: {page}")
    return "\n".join([*lines, found.verdict])
