"""``kiribench simulate``: the design space of uniform cut patterns, by finite elements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_GATE_FAILED, EXIT_OK, Fault, UsageError

if TYPE_CHECKING:
    from kiribench.fem.campaign import Campaign

SCHEMA = "kiribench.simulate/1"
_MOST_NAMED = 5


def simulate(
    *,
    model: Literal["cell", "sheet"] = "cell",
    designs: str = "paper",
    steps: str | None = None,
    mesh_mm: float | None = None,
    mesh_error: float | None = None,
    most_iterations: int | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    from_table: Path | None = None,
    strain_measure: Literal["log", "engineering", "green"] | None = None,
    strain_unit: Literal["fraction", "percent"] | None = None,
    figures: bool = True,
    common: Common | None = None,
) -> Outcome:
    """Simulate kirigami sheets by finite elements, design by design and step by step.

    Needs --out. Writes design_space.parquet with design_space.json, and report.html with the
    figures. Every finished design is kept at once in the folder's designs/: started again
    after a kill or a crash, the command goes on where it was and ends with the same table. A
    design that does not converge is a row with a status; its reason is in the JSON, and the
    exit code is 1.

    Parameters
    ----------
    model
        cell: the periodic cell, an infinite sheet. sheet: the paper's 220 x 120 mm sheet
        with grips, some fifty times the cost.
    designs
        paper: the 441 of the paper. Or pairs of cut lengths in percent of the cell (across,
        along the pull), such as "35,85;90,90". Or a CSV or TSV file with the columns
        a_percent and b_percent.
    steps
        Load steps: displacements in mm for a sheet, longitudinal stretches for a cell, such
        as 10,50,120 or 10:250:10 (first:last:step). By default the paper's 10:250:10 mm, and
        1.056:2.4:0.056 for a cell.
    mesh_mm
        Longest element edge; edges near the cut tips follow in proportion. By default 2.5 mm
        for a sheet and 1.25 mm for a cell.
    mesh_error
        A design whose estimated mesh error of Poisson's ratio exceeds this is computed again
        with edges 0.7 times as long, up to three times. By default 0.01; with --mesh-mm no
        design is, unless this is given too.
    most_iterations
        Newton iterations for one design, by default 1500 (most need 50); the steps not reached
        then are not-converged. Started again with more, the command takes up these designs.
    jobs
        Processes on this machine.
    scheduler
        Address of a Dask scheduler (tcp://host:8786), whose workers then do the work.
    from_table
        Read a table of another program instead of simulating: a, b, strain, nu and, if there
        is one, displacement, in CSV, TSV or Parquet. It is checked and converted to stretches.
    strain_measure
        With --from-table: the measure of its strains, unless the table says it.
    strain_unit
        With --from-table: the unit of its strains, unless the table says it.
    figures
        Write report.html; --no-figures leaves it out.
    """
    common = common or Common()
    if common.out is None:
        raise UsageError(
            "out-missing",
            "simulate writes tables and needs a folder.",
            remedy="Give --out DIR; start again with the same DIR to go on after a stop.",
        )
    if from_table is not None:
        return _convert(from_table, common.out, strain_measure, strain_unit)
    if strain_measure is not None or strain_unit is not None:
        raise UsageError(
            "measure-without-table",
            "A simulated table stores stretches, which have no strain measure.",
            remedy="Leave --strain-measure and --strain-unit out, or give --from-table.",
        )
    from kiribench.cli.progress import progress
    from kiribench.fem.campaign import run_campaign
    from kiribench.fem.campaign_settings import CampaignSettings
    from kiribench.fem.campaign_words import read_designs, read_steps
    from kiribench.fem.equilibrium import MOST_WORK

    settings = CampaignSettings.of(
        model,
        None if steps is None else read_steps(steps),
        mesh_mm,
        mesh_error,
        MOST_WORK if most_iterations is None else most_iterations,
    )
    asked, files = read_designs(designs)
    with progress("simulating", quiet=common.quiet) as show:
        campaign = run_campaign(
            settings, asked, common.out, jobs=jobs, scheduler=scheduler, progress=show
        )
    page = None
    if figures:
        from kiribench.report.design_space_page import write_design_space_report

        page = write_design_space_report(common.out / "report.html", campaign.table)
    faults = _faults(campaign)
    return Outcome(
        result=_object(campaign, page),
        text=_text(campaign, page),
        exit_code=EXIT_GATE_FAILED if campaign.incomplete else EXIT_OK,
        faults=faults,
        inputs=files,
    )


def _convert(
    table: Path, out: Path, strain_measure: str | None, strain_unit: str | None
) -> Outcome:
    from kiribench.schema.design_space_convert import convert_table

    converted = convert_table(table, out, strain_measure=strain_measure, strain_unit=strain_unit)
    rows, names = len(converted.frame), converted.frame["design"].nunique()
    text = (
        f"{table.name}: {rows} rows of {names} designs, {converted.measure} strain "
        f"({converted.strain_unit}), cut lengths in {converted.cut_unit}.\n"
        f"Table: {converted.file}\n"
        "Read, checked and converted to stretches."
    )
    return Outcome(
        result={
            "schema": SCHEMA,
            "converted_from": str(table),
            "strain_measure": converted.measure,
            "strain_unit": converted.strain_unit,
            "cut_unit": converted.cut_unit,
            "rows": rows,
            "designs": int(names),
            "table": str(converted.file),
        },
        text=text,
        faults=converted.notes,
        inputs=converted.inputs,
    )


def _faults(campaign: Campaign) -> tuple[Fault, ...]:
    faults = [
        Fault(
            "design-incomplete",
            f"Design {piece.design.name} has no answer for {_without(piece.status)} steps: "
            f"{piece.reason}.",
            "Use smaller --steps, another --mesh-mm or more --most-iterations; the rows with "
            "status ok are valid.",
            file=str(campaign.table),
        )
        for piece in campaign.incomplete[:_MOST_NAMED]
    ]
    if campaign.overlapping:
        faults.append(
            Fault(
                "faces-overlap",
                f"{len(campaign.overlapping)} designs have crack faces that interpenetrate: "
                "contact is not modelled.",
                "Look at face_overlap_mm; the gauge in the middle is far from the grips, where "
                "it happens.",
                file=str(campaign.table),
                expected="0.1 mm or less",
                severity="warning",
            )
        )
    return tuple(faults)


def _without(status: tuple[str, ...]) -> int:
    return len(status) - status.count("ok")


def _object(campaign: Campaign, page: Path | None) -> dict[str, Any]:
    ok = sum(piece.status.count("ok") for piece in campaign.pieces)
    return {
        "schema": SCHEMA,
        "model": campaign.settings.model,
        "designs": len(campaign.pieces),
        "resumed": campaign.resumed,
        "rows": sum(len(piece.status) for piece in campaign.pieces),
        "rows_ok": ok,
        "incomplete": [
            {"design": piece.design.name, "steps": _without(piece.status), "reason": piece.reason}
            for piece in campaign.incomplete
        ],
        "faces_overlap": [piece.design.name for piece in campaign.overlapping],
        "largest_mesh_error_poisson": campaign.largest_mesh_error,
        "refined": [piece.design.name for piece in campaign.pieces if piece.mesh_scale < 1.0],
        "cpu_seconds": round(campaign.cpu_seconds, 2),
        "table": str(campaign.table),
        "sidecar": str(campaign.sidecar),
        "report": None if page is None else str(page),
    }


def _text(campaign: Campaign, page: Path | None) -> str:
    count, steps = len(campaign.pieces), len(campaign.settings.steps)
    error = campaign.largest_mesh_error
    lines = [
        f"{count} designs x {steps} steps, {campaign.settings.model} model, longest element edge "
        f"{campaign.settings.longest_edge_mm:g} mm",
        f"{campaign.cpu_seconds:.1f} CPU s; {campaign.resumed} designs were there already",
        "mesh error of Poisson's ratio: "
        + ("not known" if error is None else f"at most {error:.4f}"),
    ]
    refined = sum(piece.mesh_scale < 1.0 for piece in campaign.pieces)
    if refined:
        lines.append(f"{refined} designs on a finer mesh, where the mesh error asked for it")
    if campaign.overlapping:
        lines.append(f"crack faces overlap by more than 0.1 mm in {len(campaign.overlapping)}")
    lines.append(f"Table: {campaign.table}")
    if page is not None:
        lines.append(f"Report: {page}")
    short = len(campaign.incomplete)
    lines.append(
        f"{short} of {count} designs did not reach the last step."
        if short
        else "Every design reached the last step."
    )
    return "\n".join(lines)
