"""``kiribench tensile``: frames of a stretched sample to strain and Poisson curves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from kiribench.cli.command import Common, Outcome

if TYPE_CHECKING:
    from kiribench.tensile.result import TensileTest

SCHEMA = "kiribench.tensile/1"


def tensile(
    folder: Path,
    /,
    *,
    sidecar: Path | None = None,
    strain_measure: Literal["log", "engineering", "green"] = "log",
    min_strain: float = 0.01,
    zncc: float = 0.75,
    report: bool = True,
    common: Common | None = None,
) -> Outcome:
    """Measure stretches and Poisson's ratio in the pictures of a tensile test.

    The folder holds the pictures (PNG, TIFF, JPEG) or one video, tensile.json, which says what
    they show, and maybe the machine's table (time, displacement, force). With --out, writes
    cells.tsv (every cell in every frame), curve.tsv (every frame), overlays of what was
    followed, and tensile.html beside tensile.json.

    Parameters
    ----------
    folder
        Folder of the pictures.
    sidecar
        Another file than tensile.json (or tensile.toml) of the folder.
    strain_measure
        Measure of the strains and of Poisson's ratio.
    min_strain
        Poisson's ratio is left out where the absolute longitudinal strain is below this
        fraction.
    zncc
        Least correlation, 0 to 1, at which a part of a speckled sheet counts as found.
    report
        Write the HTML page and the overlays; only with --out.
    common
        Options of every command.
    """
    from kiribench.cli.progress import progress
    from kiribench.errors import UsageError
    from kiribench.strain.measures import check_min_strain
    from kiribench.tensile.followed import MeasureOptions
    from kiribench.tensile.measure import measure_frames
    from kiribench.tensile.overlay import overlays, write_overlays
    from kiribench.tensile.sidecar import read_sidecar
    from kiribench.tensile.tables import write_tensile

    common = common or Common()
    check_min_strain(min_strain)
    if not 0.0 < zncc < 1.0:
        raise UsageError(
            "zncc-range",
            "The least correlation is no number between 0 and 1.",
            remedy="Give --zncc 0.75, or less for poor pictures.",
            got=zncc,
        )
    if common.out is not None and common.out.resolve() == folder.resolve():
        raise UsageError(
            "out-is-input",
            "The results would overwrite tensile.json of the pictures.",
            remedy="Give --out another folder.",
            file=common.out,
        )
    with progress("following", quiet=common.quiet) as advance:
        test = measure_frames(folder, MeasureOptions(zncc), advance, sidecar=sidecar)
    if common.out is not None:
        write_tensile(common.out, test, measure=strain_measure, min_strain=min_strain)
        if report:
            from kiribench.report.tensile_page import write_tensile_report

            declared, _ = read_sidecar(folder, sidecar)
            drawn = overlays(folder, test, declared.frames)
            write_overlays(common.out, drawn)
            write_tensile_report(
                common.out / "tensile.html",
                test,
                drawn,
                title=folder.resolve().name,
                measure=strain_measure,
                min_strain=min_strain,
            )
    return Outcome(
        result=tensile_object(test, strain_measure, min_strain),
        text=tensile_text(test, strain_measure, min_strain),
        faults=test.warnings,
        inputs=test.files,
    )


def tensile_object(test: TensileTest, measure: str, min_strain: float) -> dict[str, Any]:
    """The JSON object of a test."""
    from kiribench.tensile.tables import curve_rows

    return {
        "schema": SCHEMA,
        "strain_measure": measure,
        "min_strain": min_strain,
        "marker": test.marker,
        "frames": len(test.frame),
        "cells": len(test.cell),
        "measured": int(test.measured.sum()),
        "strain_sd": test.strain_sd,
        "scale_mm_per_px": test.scale_mm_per_px,
        "status": {
            word: int((test.status == word).sum()) for word in sorted({*test.status.ravel()})
        },
        "notes": list(test.notes),
        "view": test.record.get("View", {}),
        "curve": curve_rows(test, measure, min_strain),
    }


def tensile_text(test: TensileTest, measure: str, min_strain: float) -> str:
    """The test for a person; the last line is the verdict."""
    import numpy as np

    curve = test.curve(measure, min_strain)
    lines = [
        f"{len(test.frame)} frames, {len(test.cell)} cells, followed by {test.marker}; "
        f"{measure} strain, mean and sd over cells.",
        f"  {'frame':<24} {'cells':>5} {'force N':>9} {'strain':>16} {'Poisson ratio':>18}",
    ]
    some = np.unique(np.linspace(0, len(test.frame) - 1, min(len(test.frame), 12)).astype(int))
    for n in some:
        force = f"{test.force_n[n]:.3f}" if np.isfinite(test.force_n[n]) else "-"
        lines.append(
            f"  {test.frame[n][-24:]:<24} {curve.cells[n]:>5} {force:>9} "
            f"{_pair(curve.longitudinal_strain[n], curve.longitudinal_sd[n]):>16} "
            f"{_pair(curve.poisson_ratio[n], curve.poisson_sd[n]):>18}"
        )
    if len(some) < len(test.frame):
        lines.append(f"  ({len(some)} of {len(test.frame)} frames shown)")
    lines += [f"  {note}" for note in test.notes]
    lines.append(f"  noise of the pictures: strain sd {test.strain_sd:.5f} a cell")
    total = test.status[1:].size
    lost = total - int(test.measured[1:].sum())
    furthest = float(np.nanmax(curve.longitudinal_strain))
    lines.append(
        f"  Verdict: {total - lost} of {total} readings of a cell measured"
        + (f", {lost} lost and marked" if lost else "")
        + f"; strain up to {furthest:.4f}."
    )
    return "\n".join(lines)


def _pair(mean: float, sd: float) -> str:
    if mean != mean:
        return "-"
    return f"{mean:+.4f}" + (f" ± {sd:.4f}" if sd == sd else "")
