"""``kiribench export``: a design as files for the laser, and files from others verified."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_GATE_FAILED, EXIT_OK, Fault, UsageError

if TYPE_CHECKING:
    from kiribench.fabrication.export import Export
    from kiribench.fabrication.patch import PatchPlan
    from kiribench.fabrication.profile import Profile
    from kiribench.fabrication.verify import Limits, Verification
    from kiribench.schema.patch_design import PatchDesign

SCHEMA = "kiribench.export/1"
VERIFY_SCHEMA = "kiribench.verify/1"
LIGAMENT_MM = 0.5


def export(
    design: Path | None = None,
    *,
    profile: str = "plain",
    kerf_mm: float | None = None,
    ligament_mm: float | None = None,
    cell_mm: float | None = None,
    hoops: bool = True,
    strap_mm: float = 20.0,
    fiducials: bool = True,
    verify: Path | None = None,
    part: Literal["patch", "foam", "template", "coupon"] = "patch",
    tolerance_mm: float = 0.01,
    common: Common | None = None,
) -> Outcome:
    """Write the files for the laser and read every one of them again.

    Writes to --out, as SVG and DXF in millimetres: the patch, the foam tiles, a template to
    mark the skin, and a coupon to measure the kerf; and a job sheet (HTML) and a preview (SVG).
    Files that fail their verification are not left there, and the exit code is 1. With
    --verify, nothing is written: a file that came back from another program is judged.

    Parameters
    ----------
    design
        Design table (sub-ID_design.tsv), or the folder that holds one.
    profile
        Machine: plain, trotec, epilog, lightburn, or a TOML file of your own.
    kerf_mm
        Width that the beam burns away; slits end half of it before their free tips. Without
        it the profile's, else the slits are not compensated.
    ligament_mm
        Narrowest bridge that may be left between two cuts. Without it the design's limit, else
        0.5.
    cell_mm
        Cell edge of a table without a sidecar.
    hoops
        Hoops for straps at both ends.
    strap_mm
        Width of the straps.
    fiducials
        Registration marks on patch and foam.
    verify
        SVG or DXF file to judge instead of exporting; with a design it is compared with what
        export would draw with the same options.
    part
        What the file of --verify is.
    tolerance_mm
        Largest difference of positions, lengths and extents that --verify lets pass.
    common
        Options of every command.
    """
    from kiribench.fabrication.hoops import Hoops
    from kiribench.fabrication.patch import PatchOptions, plan_patch
    from kiribench.fabrication.profile import read_profile
    from kiribench.fabrication.verify import Limits
    from kiribench.schema.patch_design import read_design

    common = common or Common()
    _positive("tolerance-mm", tolerance_mm)
    _positive("strap-mm", strap_mm)
    machine = read_profile(profile)
    kerf = machine.kerf_mm if kerf_mm is None else kerf_mm
    if kerf is not None and not 0 <= kerf < 5:
        raise _wrong("kerf-mm", kerf, "0 to 5 mm")
    if ligament_mm is not None and not 0 <= ligament_mm < 100:
        raise _wrong("ligament-mm", ligament_mm, "0 to 100 mm")
    source = None if design is None else read_design(design, cell_mm=cell_mm)
    narrowest = ligament_mm if ligament_mm is not None else _designed_ligament(source)
    limits = Limits(kerf or 0.0, narrowest, tolerance_mm)
    plan = None
    if source is not None:
        shape = Hoops(strap_mm=strap_mm) if hoops else None
        plan = plan_patch(source, PatchOptions(kerf or 0.0, shape, fiducials))
    if verify is not None:
        return _verify(verify, plan, machine, limits, part)
    if plan is None:
        raise UsageError(
            "design-missing",
            "There is nothing to export.",
            remedy="Give a design table, or --verify FILE.",
        )
    if common.out is None:
        raise UsageError(
            "out-missing",
            "There is no folder for the files.",
            remedy="Give --out DIR.",
        )
    return _export(plan, machine, limits, common.out, kerf)


def _export(
    plan: PatchPlan, machine: Profile, limits: Limits, out: Path, kerf: float | None
) -> Outcome:
    from kiribench.fabrication.export import export_patch, stem
    from kiribench.fabrication.placement import read_placement
    from kiribench.fabrication.preview import draw_preview
    from kiribench.fabrication.work import work_warnings
    from kiribench.report.job_sheet import job_sheet

    made = export_patch(plan, machine, limits, out)
    beside = plan.design.file.parent if plan.design.file else out
    placement, doubts = read_placement(beside)
    warnings = (*plan.warnings, *work_warnings(plan.slits, machine, kerf_mm=kerf), *doubts)
    sheet = out / f"{stem(plan)}_job-sheet.html"
    sheet.write_text(
        job_sheet(
            plan,
            machine,
            made,
            limits,
            kerf_known=kerf is not None,
            warnings=warnings,
            placement=placement,
        ),
        encoding="utf-8",
        newline="\n",
    )
    preview = out / f"{stem(plan)}_preview.svg"
    picture = draw_preview(made.drawings["patch"], travel=True)
    preview.write_text(picture, encoding="utf-8", newline="\n")
    faults = (*warnings, *made.faults)
    inputs = [] if plan.design.file is None else [plan.design.file]
    inputs += [path.with_suffix(".json") for path in inputs if path.with_suffix(".json").is_file()]
    return Outcome(
        result=_result(plan, machine, made, limits, faults, [sheet, preview]),
        text=_text(plan, machine, made, limits, out),
        exit_code=EXIT_OK if made.passed else EXIT_GATE_FAILED,
        faults=faults,
        inputs=tuple(inputs),
    )


def _result(
    plan: PatchPlan,
    machine: Profile,
    made: Export,
    limits: Limits,
    faults: tuple[Fault, ...],
    others: list[Path],
) -> dict[str, Any]:
    from dataclasses import asdict

    from kiribench.fabrication.work import work_of

    rows, columns = plan.design.shape
    return {
        "schema": SCHEMA,
        "participant": plan.design.participant,
        "side": plan.design.side,
        "rows": rows,
        "columns": columns,
        "cell_mm": plan.design.cell_mm,
        "profile": machine.name,
        "kerf_mm": limits.kerf_mm,
        "ligament_mm": limits.ligament_mm,
        "slits": len(plan.slits),
        "notches": int(plan.slits.notch.sum()),
        "slits_left_out": len(plan.slits.left_out),
        "slit_length_mm": float(plan.slits.length_mm.sum()),
        "design_length_mm": float(plan.slits.design_length_mm.sum()),
        "work": {kind: asdict(work_of(one, machine)) for kind, one in made.drawings.items()},
        "files": [path.name for path in [*made.files, *others]],
        "verified": [_verification(one) for one in made.verifications],
        "passed": made.passed,
        "faults": [fault.as_dict() for fault in faults],
    }


def _verification(one: Verification) -> dict[str, Any]:
    return {
        "file": one.file.name,
        "passed": one.passed,
        "readers": one.readers,
        "measured": one.measured,
        "faults": sorted({fault.code for fault in one.faults}),
    }


def _text(plan: PatchPlan, machine: Profile, made: Export, limits: Limits, out: Path) -> str:
    from kiribench.fabrication.work import work_of

    design = plan.design
    rows, columns = design.shape
    lines = [
        f"{design.file or 'design'}: {rows} x {columns} cells of {design.cell_mm:g} mm, "
        f"{len(plan.slits)} slits ({int(plan.slits.notch.sum())} notches), "
        f"{plan.slits.length_mm.sum() / 1000:.3f} m, kerf {limits.kerf_mm:g} mm, "
        f"for {machine.title}",
        "",
        f"{'file':34} {'cuts':>5} {'cut m':>7} {'travel m':>9} {'time':>9}",
    ]
    for one in made.drawings.values():
        work = work_of(one, machine)
        time = "not known" if work.seconds is None else f"{work.seconds:.0f} s"
        lines.append(
            f"{work.name:34} {work.cuts:5d} {work.cut_mm / 1000:7.3f} "
            f"{work.travel_mm / 1000:9.3f} {time:>9}"
        )
    patch = made.verifications[0].measured
    narrow = patch.get("narrowest_ligament_mm")
    lines.append("")
    if narrow is not None:
        lines.append(
            f"narrowest ligament {narrow:.3f} mm (limit {limits.ligament_mm:g} mm), "
            f"pieces {patch['pieces']}"
        )
    if made.passed:
        lines.append(f"Ready to cut: {len(made.files)} files in {out}, each read again.")
    else:
        codes = sorted({f.code for f in made.faults if f.severity == "error"})
        lines.append(f"Do not cut: {', '.join(codes)}. No file for the machine was written.")
    return "\n".join(lines)


def _verify(
    file: Path, plan: PatchPlan | None, machine: Profile, limits: Limits, part: str
) -> Outcome:
    from kiribench.fabrication.export import KINDS, draw
    from kiribench.fabrication.verify import verify_foreign

    kind = next(kind for kind in KINDS if kind == part)
    expected = None if plan is None else draw(kind, plan, machine)
    found = verify_foreign(file, expected, machine, limits, is_patch=kind == "patch")
    errors = sorted({fault.code for fault in found.faults if fault.severity == "error"})
    inputs = [file]
    if plan is not None and plan.design.file is not None:
        inputs.append(plan.design.file)
    result = {
        "schema": VERIFY_SCHEMA,
        "part": kind,
        "compared": expected is not None,
        "kerf_mm": limits.kerf_mm,
        "ligament_mm": limits.ligament_mm,
        **_verification(found),
        "file": str(file),
        "faults": [fault.as_dict() for fault in found.faults],
    }
    lines = [f"{file}"]
    for reader, numbers in found.readers.items():
        x0, y0, x1, y1 = numbers["extent_mm"]
        lines.append(
            f"  {reader}: {numbers['strokes']} strokes, {numbers['length_mm']:.3f} mm, "
            f"{x1 - x0:.3f} x {y1 - y0:.3f} mm"
        )
    for name, value in found.measured.items():
        shown = f"{value:.6g}" if isinstance(value, float) else value
        lines.append(f"  {name.replace('_', ' ')}: {shown}")
    if errors:
        lines.append(f"Do not cut: {', '.join(errors)}.")
    elif expected is None:
        lines.append(
            "No fault in the file itself. Its size and slits were not compared: give the design."
        )
    else:
        lines.append("It is the drawing of the design.")
    return Outcome(
        result=result,
        text="\n".join(lines),
        exit_code=EXIT_GATE_FAILED if errors else EXIT_OK,
        faults=found.faults,
        inputs=tuple(inputs),
    )


def _designed_ligament(design: PatchDesign | None) -> float:
    """The ligament that the design was made for."""
    settings = {} if design is None else design.settings
    nested = settings.get("Limits")
    for holder in (settings, nested if isinstance(nested, dict) else {}):
        value = holder.get("LigamentMm")
        if isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value < 100:
            return float(value)
    return LIGAMENT_MM


def _positive(name: str, value: float) -> None:
    if not 0 < value < 1e4:
        raise _wrong(name, value, "a length greater than 0")


def _wrong(name: str, value: float, expected: str) -> UsageError:
    return UsageError(
        "option-range",
        f"--{name} is out of range.",
        remedy="Give it in mm.",
        got=value,
        expected=expected,
    )
