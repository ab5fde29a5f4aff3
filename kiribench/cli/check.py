"""``kiribench check``: what a design is predicted to do, before anybody cuts it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_GATE_FAILED, EXIT_OK, Fault, UsageError

if TYPE_CHECKING:
    from kiribench.dataset import Subject
    from kiribench.reference.check import CheckedDesign, CheckOptions, Ground
    from kiribench.reference.given_table import TableComparison
    from kiribench.reference.placement import Placement
    from kiribench.schema.patch_design import PatchDesign
    from kiribench.tensile.result import TensileTest

SCHEMA = "kiribench.check/1"
PLACEMENT_ELEMENTS = 6


def check(
    design: Annotated[tuple[Path, ...], Parameter(negative=())],
    /,
    *,
    reference: str = "simulated",
    surface: Literal["auto", "worn", "flat"] = "auto",
    subject: Path | None = None,
    participant: str | None = None,
    friction: float | Literal["stick"] = 0.0,
    straps: Literal["rows", "hoops", "free"] = "rows",
    elements_per_facet: int = 10,
    pull: float | None = None,
    uniform: bool = True,
    placement: bool = True,
    share: float = 0.9,
    grade_by: Literal["paper", "strict", "iou"] = "paper",
    cell_mm: float | None = None,
    data: Path | None = None,
    samples: int = 400,
    seed: int = 0,
    fail_under: float | None = None,
    common: Common | None = None,
) -> Outcome:
    """Simulate designs as worn, or flat, and score them as a worn patch would be.

    Puts each design on the subject's bare flexed skin (frictionless membrane, strapped at both
    ends) and gives stretches, Poisson's ratio, shear and overlap of every cell, the error that
    the mesh makes, and how exactly the patch has to be put on. Predicted is not worn: nobody
    wore it. With --out, writes a table for each design, placement.json and an HTML page.

    Parameters
    ----------
    design
        Design tables (or folders with one): several are set side by side.
    reference
        simulated; tensile, for a measured tensile test in --data; or the path of a table of
        another solver or of a measurement, with row, col, longitudinal_stretch, lateral_stretch
        (and shear) by cell, or row, col, u_mm, v_mm by corner.
    surface
        worn on the subject's flexed skin, or flat in the plane (the skin laid flat, or --pull);
        auto is worn where a subject is found.
    subject
        Dataset folder with the subject; if absent it is looked for beside the design.
    participant
        Id of the participant; the design's own if absent.
    friction
        Coulomb coefficient between patch and skin, or stick: the patch stays where it was laid.
    straps
        Both end rows are held, their outermost cells only (hoops), or the proximal row (free).
    elements_per_facet
        Elements along a facet edge: 6 to explore, 10 to report, 16 to confirm; even. The mesh
        error is judged against a coarser mesh.
    pull
        Flat only: pull the patch to this length ratio instead of to the targets.
    uniform
        Add the best uniform sheet as the control.
    placement
        Find the offsets, turn and strap slip within which the grades hold (worn only).
    share
        Share of the cells whose grade has to hold for --placement.
    grade_by
        Overlap that is graded: of the skin cell (paper), of the larger cell (strict), or
        intersection over union (iou). All three are always given.
    cell_mm
        Cell edge of a design table without a sidecar.
    data
        Folder of the tensile test, for --reference tensile: tables of 'kiribench tensile', or
        the pictures.
    samples
        Draws of the Monte Carlo for intervals: the uncertainty of the skin's nodes.
    seed
        Seed of the draws.
    fail_under
        Exit with code 1 if the predicted satisfactory ratio of any given design is below this
        fraction (0.75 means 75 %).
    common
        Options of every command.
    """
    from kiribench.conformability.score import ScoreOptions
    from kiribench.fem.wear import WearSpec
    from kiribench.reference.check import CheckOptions
    from kiribench.schema.patch_design import read_design

    common = common or Common()
    coefficient = math.inf if friction == "stick" else float(friction)
    _check_numbers(fail_under, 0.0 if friction == "stick" else coefficient, pull, share)
    designs = [read_design(path, cell_mm=cell_mm) for path in design]
    if reference == "tensile":
        return _tensile(designs, data, common)
    if data is not None:
        raise UsageError(
            "check-data-unused",
            "--data is the folder of a tensile test.",
            remedy="Give --reference tensile with it.",
        )
    score = ScoreOptions(grade_by=grade_by, samples=samples, seed=seed)
    score.check()
    options = CheckOptions(
        elements=elements_per_facet,
        spec=WearSpec(friction=coefficient, straps=straps),
        score=score,
    )
    found = (
        None
        if surface == "flat" and pull is not None
        else _subject(designs[0], subject, participant, needed=surface == "worn")
    )
    ground = _ground(designs[0], found, surface, pull)
    return _simulated(
        designs, ground, options, found, reference, common,
        with_uniform=uniform, with_placement=placement, share=share, fail_under=fail_under,
    )  # fmt: skip


def _check_numbers(
    fail_under: float | None, friction: float, pull: float | None, share: float
) -> None:
    for name, value, fine, expected in (
        ("fail-under", fail_under, fail_under is None or 0 <= fail_under <= 1, "0 to 1"),
        ("friction", friction, 0 <= friction < math.inf, "0 or more, or stick"),
        ("pull", pull, pull is None or 0.5 <= pull <= 4, "a length ratio, 0.5 to 4"),
        ("share", share, 0 < share <= 1, "more than 0, at most 1"),
    ):
        if not fine:
            raise UsageError(
                f"{name}-range",
                f"--{name} is out of range.",
                remedy="Choose a value in the range.",
                got=value,
                expected=expected,
            )


def _subject(
    design: PatchDesign, folder: Path | None, participant: str | None, *, needed: bool
) -> Subject | None:
    """The subject that a design is for: in the folder given, or beside the design."""
    from kiribench.dataset import Dataset

    name = participant or design.participant
    if folder is None:
        folder = _dataset_of(design, name)
    if folder is None or not name:
        if needed:
            raise UsageError(
                "check-no-subject",
                "The subject that the design is for was not found.",
                remedy="Give its dataset with --subject, and its id with --participant if the "
                "design does not say it.",
                file=design.file,
                got=name or "no participant",
            )
        return None
    if folder.name == f"sub-{name}" and not (folder / "dataset_description.json").exists():
        folder = folder.parent
    return Dataset.open(folder).subject(name)


def _dataset_of(design: PatchDesign, participant: str) -> Path | None:
    """The dataset that the sidecar names, or one above the design, that has the participant."""
    if design.file is None or not participant:
        return None
    said = design.settings.get("Dataset")
    above = list(design.file.resolve().parents)
    candidates = [Path(said), design.file.parent / said] if isinstance(said, str) else []
    for folder in (*candidates, *above):
        if (folder / "dataset_description.json").is_file() and (
            folder / f"sub-{participant}"
        ).is_dir():
            return folder
    return None


def _ground(
    design: PatchDesign, subject: Subject | None, surface: str, pull: float | None
) -> Ground:
    import numpy as np

    from kiribench.design.skin import skin_of
    from kiribench.reference.check import FlatGround, KneeGround, targets_of
    from kiribench.reference.developed import flat_skin_of, flat_skin_of_stretches

    if surface == "worn" or (surface == "auto" and subject is not None and pull is None):
        if pull is not None:
            raise UsageError(
                "check-pull-worn",
                "--pull is for the flat check.",
                remedy="Give --surface flat with it, or leave it out.",
            )
        if subject is None:
            raise ValueError("a worn check has a subject")
        return KneeGround(skin_of(subject))
    plain = FlatGround(design.shape, design.cell_mm, pull=pull)
    if pull is not None:
        return plain
    if subject is not None:
        return FlatGround(design.shape, design.cell_mm, flat_skin_of(skin_of(subject)))
    longitudinal, lateral, source = targets_of(design, plain)
    if source != "design" or not np.isfinite(lateral).any():
        raise UsageError(
            "check-no-target",
            "There is neither a subject nor a target to check the design against.",
            remedy="Give --subject, a design table with its targets, or --pull.",
            file=design.file,
        )
    return FlatGround(
        design.shape,
        design.cell_mm,
        flat_skin_of_stretches(longitudinal, lateral, design.cell_mm),
    )


def _simulated(
    designs: list[PatchDesign],
    ground: Ground,
    options: CheckOptions,
    subject: Subject | None,
    reference: str,
    common: Common,
    *,
    with_uniform: bool,
    with_placement: bool,
    share: float,
    fail_under: float | None,
) -> Outcome:
    from kiribench.cli.progress import progress
    from kiribench.reference.check import check_design
    from kiribench.reference.export import check_object, check_text
    from kiribench.reference.given_table import compare_table, read_given
    from kiribench.reference.placement import placement_object, placement_text
    from kiribench.reference.side_by_side import best_uniform

    given = None if reference == "simulated" else read_given(Path(reference), designs[0].shape)
    checked: list[CheckedDesign] = []
    tolerances: list[Placement | None] = []
    total = len(designs) + with_uniform
    with progress("checking", quiet=common.quiet) as advance:
        for done, given_design in enumerate(designs):
            advance(done, total)
            checked.append(check_design(given_design, ground, options))
        if with_uniform:
            advance(len(designs), total)
            checked.append(best_uniform(designs[0], ground, options)[0])
        follow = with_placement and ground.kind == "worn"
        # Nobody puts the control on.
        tolerances = [
            _placement(one, share) if follow and index < len(designs) else None
            for index, one in enumerate(checked)
        ]
        advance(total, total)
    compared = [None if given is None else compare_table(one, given) for one in checked]
    objects, text = [], []
    for one, tolerance, comparison in zip(checked, tolerances, compared, strict=True):
        content = check_object(one)
        lines = [check_text(one)]
        if tolerance is not None:
            content["placement"] = placement_object(
                tolerance, participant=one.design.participant, method=one.design.method
            )
            lines.append("  " + placement_text(tolerance))
        if comparison is not None:
            content["reference"] = _compared(comparison)
            lines.append(_compared_text(comparison))
        objects.append(content)
        text.append("\n".join(lines))
    failed = _gate(checked[: len(designs)], fail_under)
    from kiribench.report.check_words import DRAWN_NOTE, check_verdict

    verdict = check_verdict(checked)
    synthetic = subject is not None and _synthetic(subject)
    drawn = synthetic and subject is not None and subject.has("flex090worn")
    result = {
        "schema": SCHEMA,
        "participant": None if subject is None else subject.id,
        "reference": reference,
        "surface": ground.kind,
        "grade_by": options.score.grade_by,
        "fail_under": fail_under,
        "passed": not failed,
        "verdict": verdict,
        "worn_scan": DRAWN_NOTE if drawn else None,
        "designs": objects,
    }
    if common.out is not None:
        _write(common.out, checked, tolerances, objects, synthetic=synthetic, drawn=drawn)
    text += [DRAWN_NOTE] if drawn else []
    text += [fault.what for fault in failed]
    text.append(f"Verdict: {verdict}")
    files = [table.file for table in designs if table.file is not None]
    return Outcome(
        result=result,
        text="\n\n".join(text),
        exit_code=EXIT_GATE_FAILED if failed else EXIT_OK,
        faults=tuple(failed),
        inputs=(*files, *(() if subject is None else subject.files)),
    )


def _placement(checked: CheckedDesign, share: float) -> Placement | None:
    from functools import partial

    from kiribench.reference.check import KneeGround, put_on
    from kiribench.reference.fast_overlap import FastOverlap
    from kiribench.reference.placement import placement_of

    ground, options = checked.ground, checked.options
    if not isinstance(ground, KneeGround):
        return None
    fast = FastOverlap.of(ground.skin)
    definition = options.score.grade_by
    return placement_of(
        partial(put_on, checked.design, ground, options, PLACEMENT_ELEMENTS),
        partial(fast.overlap, definition=definition),
        elements=PLACEMENT_ELEMENTS,
        share=share,
        definition=definition,
    )


def _compared(comparison: TableComparison) -> dict[str, Any]:
    import numpy as np

    content: dict[str, Any] = {
        "file": comparison.given.file.name,
        "kind": comparison.given.kind,
        "strain_measure": comparison.measure,
        "simulated_minus_given": comparison.summary(),
    }
    if comparison.overlap is not None:
        known = comparison.overlap[np.isfinite(comparison.overlap)]
        content["given_mean_overlap"] = float(known.mean()) if known.size else None
    return content


def _compared_text(comparison: TableComparison) -> str:
    lines = [f"  Simulated minus {comparison.given.file.name} ({comparison.given.kind}):"]
    for name, one in comparison.summary().items():
        words = name.replace("_", " ").replace("corner mm", "distance of corners, mm")
        lines.append(
            f"    {words:<26} rms {one['rms']:.4f}   largest {one['largest']:.4f}   "
            f"({one['count']})"
        )
    return "\n".join(lines)


def _write(
    out: Path,
    checked: list[CheckedDesign],
    tolerances: list[Placement | None],
    objects: list[dict[str, Any]],
    *,
    synthetic: bool,
    drawn: bool,
) -> None:
    from kiribench.reference.export import check_rows, check_sidecar
    from kiribench.report.check_page import write_check_page
    from kiribench.schema.result_tables import write_table

    who = checked[0].design.participant
    stem = f"sub-{who}_" if who else ""
    used: set[str] = set()
    for one, content in zip(checked, objects, strict=True):
        name = _file_name(one.design.method, used)
        write_table(out / f"{stem}{name}_check.tsv", check_rows(one), check_sidecar(one))
        if "placement" in content:
            path = out / f"{stem}{name}_placement.json"
            path.write_text(json.dumps(content["placement"], indent=2) + "\n", encoding="utf-8")
    if "placement" in objects[0]:
        first = json.dumps(objects[0]["placement"], indent=2) + "\n"
        (out / "placement.json").write_text(first, encoding="utf-8")
    page = out / f"{stem}check.html"
    write_check_page(page, checked, tolerances, synthetic=synthetic, drawn=drawn)


def _synthetic(subject: Subject) -> bool:
    from kiribench.dataset import Dataset
    from kiribench.report.gather import is_synthetic

    return is_synthetic(Dataset.open(subject.root).description)


def _file_name(method: str, used: set[str]) -> str:
    plain = "".join(letter if letter.isalnum() else "-" for letter in method.lower()) or "given"
    name, count = plain, 2
    while name in used:
        name, count = f"{plain}-{count}", count + 1
    used.add(name)
    return name


def _gate(checked: list[CheckedDesign], fail_under: float | None) -> list[Fault]:
    if fail_under is None:
        return []
    failed = []
    for one in checked:
        ratio = one.conformability.whole.satisfactory
        if ratio is None or math.isnan(ratio) or ratio < fail_under - 1e-12:
            failed.append(
                Fault(
                    "check-below-limit",
                    f"Design '{one.design.method}': the predicted satisfactory ratio is below "
                    "the limit.",
                    "Look at the causes, or design with --method worn.",
                    got="no cell scored" if ratio is None else f"{ratio:.4f}",
                    expected=f"{fail_under:g} or more",
                )
            )
    return failed


def _tensile(designs: list[PatchDesign], data: Path | None, common: Common) -> Outcome:
    from kiribench.reference.tensile import compare_tensile
    from kiribench.report.tensile_comparison_page import write_tensile_comparison

    if data is None:
        raise UsageError(
            "check-no-tensile-data",
            "A comparison with a tensile test needs the test.",
            remedy="Give its folder, as 'kiribench tensile' writes it or of its pictures, "
            "with --data.",
        )
    test = _tensile_test(data, common)
    found = [compare_tensile(one, test) for one in designs]
    if common.out is not None:
        used: set[str] = set()
        for one, comparison in zip(designs, found, strict=True):
            name = _file_name(one.method, used)
            write_tensile_comparison(
                common.out / f"{name}_tensile.html", comparison, f"{name} and {data.name}"
            )
    return Outcome(
        result={
            "schema": SCHEMA,
            "reference": "tensile",
            "designs": [
                {"method": one.method, **comparison.result}
                for one, comparison in zip(designs, found, strict=True)
            ],
        },
        text="\n\n".join(
            f"Design '{one.method}'"
            + (f" ({one.file.name})" if one.file else "")
            + ":\n"
            + comparison.text
            for one, comparison in zip(designs, found, strict=True)
        ),
        faults=test.warnings,
        inputs=(*(one.file for one in designs if one.file is not None), *test.files),
    )


def _tensile_test(data: Path, common: Common) -> TensileTest:
    """The tables that ``kiribench tensile`` wrote, or the pictures, which are measured now."""
    from kiribench.cli.progress import progress
    from kiribench.tensile.measure import measure_frames
    from kiribench.tensile.sidecar import NAMES
    from kiribench.tensile.tables import CELLS_FILE, CURVE_FILE, read_tensile

    tables = (data / CELLS_FILE).is_file() or (data / CURVE_FILE).is_file()
    if tables or not any((data / name).is_file() for name in NAMES):
        return read_tensile(data)
    with progress("following", quiet=common.quiet) as advance:
        return measure_frames(data, progress=advance)
