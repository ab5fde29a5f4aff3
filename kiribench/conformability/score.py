"""Score one participant: bare 90-degree scan, worn scan, both with nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.cells import score_cells
from kiribench.conformability.frame import Registering, bring_together
from kiribench.conformability.grades import grade_of, region_score, region_scores
from kiribench.conformability.montecarlo import FlatCells, changed_grades, vary
from kiribench.conformability.outlines import FlatOutlines, flat_outlines
from kiribench.conformability.projection import project_to_skin
from kiribench.conformability.result import (
    DEFINITIONS,
    Alignment,
    Conformability,
    FrameReport,
    GradeBy,
)
from kiribench.dataset import Subject
from kiribench.errors import Fault, NodesError, UsageError
from kiribench.surface.acquisition import Acquired, Denoise, acquire
from kiribench.surface.mesh import FloatArray, Mesh, SurfacePoints
from kiribench.surface.nodes import LocatedNodes

BARE, WORN = "flex090", "flex090worn"

#: How far below a patch corner the skin is looked for, beyond the patch's thickness: a
#: fold of a patch stands off so far; farther away it is another frame or a hole.
LIFT_REACH_MM = 15.0

#: A change of grade in more than this share of the registration draws is a risk.
RISK_FROM = 0.05


#: Draws of the Monte Carlo: fewer say nothing of 95 %, more fill the memory (30 kB a draw).
MIN_SAMPLES, MAX_SAMPLES = 100, 20_000


@dataclass(frozen=True)
class ScoreOptions:
    """What a person can choose.

    Attributes:
        grade_by: definition of the overlap that is graded.
        alignment: ``global`` or ``per-cell``.
        registration: ``auto`` or ``none``.
        denoise: of the bare scan: ``auto``, ``always`` or ``never``.
        samples: Monte Carlo draws. seed: of the draws.
    """

    grade_by: GradeBy = "paper"
    alignment: Alignment = "global"
    registration: Registering = "auto"
    denoise: Denoise = "auto"
    samples: int = 1000
    seed: int = 0

    def check(self) -> None:
        """Refuse values that do not exist.

        Raises:
            UsageError: ``option-unknown``, ``samples-out-of-range``, ``seed-negative``.
        """
        for name, value, known in (
            ("grade-by", self.grade_by, get_args(GradeBy)),
            ("alignment", self.alignment, get_args(Alignment)),
            ("registration", self.registration, get_args(Registering)),
            ("denoise", self.denoise, get_args(Denoise)),
        ):
            if value not in known:
                raise UsageError(
                    "option-unknown",
                    f"There is no such {name}.",
                    remedy="Choose one of the names.",
                    got=value,
                    expected=", ".join(known),
                )
        if not MIN_SAMPLES <= self.samples <= MAX_SAMPLES:
            raise UsageError(
                "samples-out-of-range",
                "An interval of 95 % needs some hundred draws; many thousand only cost memory.",
                remedy="Choose a number in the range.",
                got=self.samples,
                expected=f"{MIN_SAMPLES} to {MAX_SAMPLES}",
            )
        if self.seed < 0:
            raise UsageError(
                "seed-negative",
                "A seed is zero or a positive whole number.",
                remedy="Choose another seed.",
                got=self.seed,
            )


def score_subject(subject: Subject, options: ScoreOptions | None = None) -> Conformability:
    """Score the worn patch of one subject.

    Args:
        subject: with complete acquisitions ``flex090`` and ``flex090worn``.
        options: the defaults where None.

    Raises:
        DatasetError, MeshError, NodesError, PathError, RegistrationError: what is wrong with
            the input; UsageError: what is wrong with the options.
    """
    options = options or ScoreOptions()
    options.check()
    subject.require(BARE, WORN)
    bare = acquire(subject, BARE, denoise=options.denoise)
    # Nothing is measured along the worn scan: its corners are taken as they are, and
    # registration averages its noise. Denoising would round off the patch's edges.
    worn = acquire(subject, WORN, denoise=None)
    layout = subject.layout
    skin = bare.nodes.window(*layout.patch_offset, layout.patch.node_shape)
    region = np.array([list(row) for row in layout.regions.labels])
    return score_acquired(
        subject.id,
        bare,
        worn,
        skin,
        region,
        options,
        cell_mm=layout.patch.cell_mm,
        thickness_mm=layout.patch.thickness_mm,
        declared=declared_frame(subject),
    )


def declared_frame(subject: Subject) -> bool:
    """Whether the worn scan's sidecar says that it already is in the bare scan's frame."""
    extra = subject.scan_sidecar(WORN).model_extra or {}
    return BARE in str(extra.get("RegisteredTo", "")).replace(WORN, "")


def score_acquired(
    participant: str,
    bare: Acquired,
    worn: Acquired,
    skin: LocatedNodes,
    region: NDArray[np.str_],
    options: ScoreOptions,
    *,
    cell_mm: float,
    thickness_mm: float,
    declared: bool = False,
) -> Conformability:
    """Score from loaded scans.

    Args:
        bare: the bare scan in the worn pose. worn: the scan with the patch; its nodes are
            the patch's (R+1, C+1) corners.
        skin: (R+1, C+1) nodes of the bare scan under them.
        region: (R, C) labels.
        cell_mm, thickness_mm: of the patch.
        declared: the worn scan is known to be in the bare scan's frame.
    """
    rng = np.random.default_rng(options.seed)
    brought = bring_together(
        worn,
        bare,
        skin.positions_mm,
        thickness_mm=thickness_mm,
        registering=options.registration,
        declared=declared,
        samples=options.samples,
        rng=rng,
    )
    patch, lift = patch_on_skin(
        bare.mesh, brought.patch_mm, worn.nodes, thickness_mm + LIFT_REACH_MM
    )
    reason = missing_reasons(skin, worn.nodes, patch)
    if not (reason == "").any():
        raise NodesError(
            "conform-no-cell",
            "No cell of the patch has all its corners on both scans.",
            remedy="Complete the nodes tables, or check the patch's offset in the grid.",
        )
    return score_outlines(
        participant,
        flat_outlines(bare.mesh, skin, patch, bare.topology),
        reason,
        region,
        options,
        skin_sd_mm=skin.sd_mm,
        patch_sd_mm=worn.nodes.sd_mm,
        lift_off_mm=lift,
        frame=brought.report,
        draws_mm=brought.draws_mm,
        cell_mm=cell_mm,
        rng=rng,
        notes=(*bare.notes, *worn.notes, *brought.notes),
        warnings=(*bare.warnings, *worn.warnings, *brought.warnings),
    )


def score_outlines(
    participant: str,
    outlines: FlatOutlines,
    reason: NDArray[np.str_],
    region: NDArray[np.str_],
    options: ScoreOptions,
    *,
    skin_sd_mm: FloatArray,
    patch_sd_mm: FloatArray,
    lift_off_mm: FloatArray,
    frame: FrameReport,
    draws_mm: FloatArray | None,
    cell_mm: float,
    rng: np.random.Generator,
    notes: tuple[str, ...] = (),
    warnings: tuple[Fault, ...] = (),
) -> Conformability:
    """Score cells whose outlines lie in flat frames, wherever these come from.

    Args:
        outlines: of skin and patch cells. reason, region: (R, C), see :class:`Conformability`.
        skin_sd_mm, patch_sd_mm: (R+1, C+1) node sd per direction.
        lift_off_mm: (R+1, C+1) of the patch corners. frame: how the scans came together.
        draws_mm: (n, R+1, C+1, 3) displacements of the patch by the frame's uncertainty, or
            None. cell_mm: of the patch. rng: of the draws.
    """
    scores = score_cells(outlines, reason, options.grade_by, options.alignment)
    overlap = scores.overlap.by(options.grade_by)
    out = ~np.isfinite(overlap)
    cells = FlatCells(
        np.where(out[..., None, None], np.nan, outlines.skin_corners),
        np.where(out[..., None, None], np.nan, outlines.patch_corners),
        outlines.axes,
    )
    varied = vary(
        cells,
        overlap,
        skin_sd_mm,
        patch_sd_mm,
        draws_mm,
        definition=options.grade_by,
        alignment=options.alignment,
        samples=options.samples,
        rng=rng,
    )
    if draws_mm is not None:
        changed = changed_grades(
            cells,
            overlap,
            draws_mm,
            definition=options.grade_by,
            alignment=options.alignment,
        )
        frame = replace(frame, grades_at_risk=int((changed > RISK_FROM).sum()))
    grade = grade_of(overlap)
    grades = {name: grade_of(scores.overlap.by(name)) for name in DEFINITIONS}
    differ = np.zeros(grade.shape, dtype=bool)
    for other in grades.values():
        differ |= other != grade
    return Conformability(
        participant=participant,
        grade_by=options.grade_by,
        alignment=options.alignment,
        cell_mm=cell_mm,
        region=region,
        overlap_paper=scores.overlap.paper,
        overlap_strict=scores.overlap.strict,
        overlap_iou=scores.overlap.iou,
        skin_area_mm2=scores.overlap.skin,
        patch_area_mm2=scores.overlap.patch,
        grade=grade,
        grades=grades,
        definition_matters=differ,
        overlap_low=varied.low,
        overlap_high=varied.high,
        probability=varied.probability,
        perfect_fit_reading=varied.perfect_fit_reading,
        centre_offset_mm=scores.offset_mm,
        causes=scores.causes,
        reason=scores.reason,
        skin_outline_mm=scores.skin,
        patch_outline_mm=scores.patch,
        skin_outline_3d_mm=outlines.skin_3d,
        patch_outline_3d_mm=outlines.patch_3d,
        lift_off_mm=lift_off_mm,
        regions=region_scores(region, overlap, grade, varied.draws),
        whole=region_score("all", np.ones(grade.shape, dtype=bool), overlap, grade, varied.draws),
        frame=frame,
        samples=options.samples,
        seed=options.seed,
        node_sd_mm=(float(np.nanmedian(skin_sd_mm)), float(np.nanmedian(patch_sd_mm))),
        notes=(*notes, *_bias_note(varied.perfect_fit_reading)),
        warnings=warnings,
    )


def _bias_note(reading: FloatArray) -> tuple[str, ...]:
    value = float(np.nanmean(reading))
    return (
        f"Node uncertainty biases overlaps downwards: a perfect fit would read {value:.3f} on "
        "average here. Readings are not corrected for it; intervals and probabilities are.",
    )


def patch_on_skin(
    mesh: Mesh, patch_mm: FloatArray, worn: LocatedNodes, reach_mm: float
) -> tuple[LocatedNodes, FloatArray]:
    """Project the patch's corners onto the skin along its normals.

    Args:
        mesh: the bare scan.
        patch_mm: (R+1, C+1, 3) corners in the bare scan's frame, NaN where absent.
        worn: the corners on the worn scan (for their sd).
        reach_mm: how far the skin may be.

    Returns:
        The corners on the skin (absent where there is no skin), and (R+1, C+1) lift in mm.
    """
    present = worn.present
    projected = project_to_skin(mesh, patch_mm[present], reach_mm)
    kept = np.flatnonzero(projected.found)
    row, col = (axis[kept] for axis in np.nonzero(present))
    points: SurfacePoints = projected.points[kept]
    index = np.full(present.shape, -1, dtype=np.int32)
    index[row, col] = np.arange(len(kept), dtype=np.int32)
    positions = np.full(patch_mm.shape, np.nan)
    positions[row, col] = points.positions_mm(mesh)
    lift = np.full(present.shape, np.nan)
    lift[row, col] = projected.lift_mm[kept]
    on = LocatedNodes(points, index, worn.sd_mm, np.abs(lift), positions, worn.sd_source)
    return on, lift


def missing_reasons(
    skin: LocatedNodes, worn: LocatedNodes, patch: LocatedNodes
) -> NDArray[np.str_]:
    """(R, C) why a cell cannot be scored for want of a corner, else ``""``."""
    reason = np.full(skin.cells_present.shape, "", dtype="<U32")
    reason[~patch.cells_present] = "patch-off-skin"
    reason[~worn.cells_present] = "patch-node-missing"
    reason[~skin.cells_present] = "skin-node-missing"
    return reason


def input_warnings(result: Conformability) -> tuple[Fault, ...]:
    """The result's warnings plus one for cells without a score."""
    unscored = int((~result.scored).sum())
    if unscored == 0:
        return result.warnings
    names, counts = np.unique(result.reason[~result.scored], return_counts=True)
    listed = ", ".join(f"{n} {name}" for name, n in zip(names, counts, strict=True))
    return (
        *result.warnings,
        Fault(
            "conform-cells-missing",
            f"{unscored} of {result.reason.size} cells of participant {result.participant} have "
            f"no score ({listed}); ratios count the scored cells only.",
            "Complete the nodes tables if these cells matter.",
            severity="warning",
        ),
    )
