"""``kiribench check``: what a design is predicted to do, before anybody cuts it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from kiribench.cli.check_files import write_files
from kiribench.cli.check_ground import ground_of, of_one_subject, subject_of, synthetic
from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_GATE_FAILED, EXIT_OK, Fault, UsageError

if TYPE_CHECKING:
    from kiribench.dataset import Subject
    from kiribench.reference.check import CheckedDesign, CheckOptions
    from kiribench.reference.ground import Ground
    from kiribench.reference.placement import Placement
    from kiribench.schema.patch_design import PatchDesign

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
    offset_mm: tuple[float, float] = (0.0, 0.0),
    turn_deg: float = 0.0,
    strap_slip_mm: float = 0.0,
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
    offset_mm
        Where the patch is put on: so far medially and so far distally of its place, in mm on the
        skin as drawn. Tolerances of placement are only found for a patch in its place.
    turn_deg
        Put on turned by this angle about its centre, its distal end laterally if positive.
    strap_slip_mm
        The distal strap has slipped proximally by this length.
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
    _check_numbers(
        ("fail-under", fail_under, 0.0, 1.0, "0 to 1"),
        ("friction", None if friction == "stick" else coefficient, 0.0, 1e6, "0 or more, or stick"),
        ("pull", pull, 0.5, 4.0, "a length ratio, 0.5 to 4"),
        ("share", share, 1e-9, 1.0, "more than 0, at most 1"),
        *(("offset-mm", part, -100.0, 100.0, "-100 to 100") for part in offset_mm),
        ("turn-deg", turn_deg, -45.0, 45.0, "-45 to 45"),
        ("strap-slip-mm", strap_slip_mm, -100.0, 100.0, "-100 to 100"),
    )
    displaced = any((*offset_mm, turn_deg, strap_slip_mm))
    designs = [read_design(path, cell_mm=cell_mm) for path in design]
    if reference == "tensile":
        from kiribench.cli.check_tensile import check_tensile

        return check_tensile(designs, data, common, SCHEMA)
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
        spec=WearSpec(
            friction=coefficient,
            straps=straps,
            offset_mm=offset_mm,
            turn_deg=turn_deg,
            strap_slip_mm=strap_slip_mm,
        ),
        score=score,
    )
    found = (
        None
        if surface == "flat" and pull is not None
        else subject_of(designs[0], subject, participant, needed=surface == "worn")
    )
    of_one_subject(designs, None if found is None else found.id)
    ground = ground_of(designs[0], found, surface, pull)
    return _simulated(
        designs, ground, options, found, reference, common,
        with_uniform=uniform, with_placement=placement and not displaced, share=share,
        fail_under=fail_under,
    )  # fmt: skip


def _check_numbers(*limits: tuple[str, float | None, float, float, str]) -> None:
    for name, value, low, high, expected in limits:
        if value is not None and not low <= value <= high:
            raise UsageError(
                f"{name}-range",
                f"--{name} is out of range.",
                remedy="Choose a value in the range.",
                got=value,
                expected=expected,
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
    from kiribench.reference.against_worn import against_worn
    from kiribench.reference.check import check_design
    from kiribench.reference.export import check_object, check_text
    from kiribench.reference.given_table import (
        compare_table,
        comparison_object,
        comparison_text,
        read_given,
    )
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
            content["reference"] = comparison_object(comparison)
            lines.append(comparison_text(comparison))
        objects.append(content)
        text.append("\n".join(lines))
    failed = _gate(checked[: len(designs)], fail_under)
    from kiribench.report.check_words import DRAWN_NOTE, check_verdict

    verdict = check_verdict(checked)
    computed = subject is not None and synthetic(subject)
    worn_note, beside = None, None
    if subject is not None and ground.kind == "worn" and subject.has("flex090worn"):
        # Of a computed subject the misfit was drawn, and there is nothing to agree with.
        beside = None if computed else against_worn(subject, checked, options.score)
        worn_note = DRAWN_NOTE if beside is None else beside.words()
    result = {
        "schema": SCHEMA,
        "participant": None if subject is None else subject.id,
        "reference": reference,
        "surface": ground.kind,
        "grade_by": options.score.grade_by,
        "fail_under": fail_under,
        "passed": not failed,
        "verdict": verdict,
        "worn_scan": worn_note,
        "against_worn": None if beside is None else beside.as_object(),
        "designs": objects,
    }
    if common.out is not None:
        write_files(common.out, checked, tolerances, objects, synthetic=computed, note=worn_note)
    text += [worn_note] if worn_note else []
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

    from kiribench.reference.check import put_on
    from kiribench.reference.fast_overlap import FastOverlap
    from kiribench.reference.ground import KneeGround
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
