"""What a conformability score returns: per cell, per region and for the whole patch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
TextArray = NDArray[np.str_]

GradeBy = Literal["paper", "strict", "iou"]
Alignment = Literal["global", "per-cell"]
Grade = Literal["good", "fair", "poor"]
DEFINITIONS: tuple[GradeBy, ...] = get_args(GradeBy)
GRADES: tuple[Grade, ...] = get_args(Grade)

#: The paper's limits: good from .90, fair from .75 (exactly .75 is fair), else poor.
GOOD_FROM = 0.90
FAIR_FROM = 0.75

#: The causes of a mismatch in the order of the split.
CAUSES: tuple[str, ...] = (
    "shift",
    "rotation",
    "longitudinal-stretch",
    "lateral-stretch",
    "shear",
    "rest",
)

#: Reason codes of a cell without a score, with the sentence that a report prints.
REASONS = {
    "skin-node-missing": "A corner of the skin cell is missing on the bare scan.",
    "patch-node-missing": "A corner of the patch cell is missing or hidden on the worn scan.",
    "patch-off-skin": "A patch corner has no skin below it within the search distance.",
    "path-around-hole": "A path of the cell leads around a hole of the bare scan.",
    "cell-degenerate": "The skin cell or the patch cell is folded or has no area.",
}


@dataclass(frozen=True, eq=False)
class Causes:
    """The mismatch of every cell, split, and what each part alone would cost.

    The corners of the patch cell are fitted by an affine map of the skin cell's corners,
    ``k = c + shift + A (s - c)``, ``A = R(rotation) [[a, g b], [0, b]]`` in the skin
    cell's frame (first axis longitudinal, distal; second medial). What the affine map
    leaves is the rest. NaN where the cell is not scored.

    Attributes:
        shift_mm: (R, C, 2) centre offset patch minus skin, longitudinal (distal
            positive) and lateral (medial positive).
        rotation_deg: (R, C) turn of the longitudinal side, from distal towards medial.
        longitudinal_stretch, lateral_stretch: (R, C) patch size over skin size.
        shear: (R, C) tangent of the closing of the right angle.
        rest_mm: (R, C) rms corner distance that the affine map leaves.
        cost: (R, C, 6) loss of the graded overlap if this part alone were present, in
            the order of ``CAUSES``. Parts interact: the costs need not add up.
        main: (R, C) the cause of the largest cost; ``"none"`` where all costs are below
            .005; ``""`` where the cell is not scored.
    """

    shift_mm: FloatArray
    rotation_deg: FloatArray
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    shear: FloatArray
    rest_mm: FloatArray
    cost: FloatArray
    main: TextArray


@dataclass(frozen=True)
class RegionScore:
    """Counts of a region, or of the whole patch.

    Attributes:
        label: region label; ``"all"`` for the whole patch.
        cells: cells in the layout; ``scored`` those with a grade (the denominator).
        good, fair, poor: counts; they sum to ``scored``.
        satisfactory: (good + fair) / scored, or None when nothing is scored.
        satisfactory_low, satisfactory_high: its 95 % interval.
        mean_overlap: mean graded overlap of the scored cells, or None.
    """

    label: str
    cells: int
    scored: int
    good: int
    fair: int
    poor: int
    satisfactory: float | None
    satisfactory_low: float | None
    satisfactory_high: float | None
    mean_overlap: float | None


@dataclass(frozen=True)
class FrameReport:
    """How the worn scan was brought into the frame of the bare scan.

    Attributes:
        method: ``registered`` (by the skin outside the patch), ``declared`` (the sidecar
            says RegisteredTo), ``kept`` (registering would not have improved the
            fit significantly), ``assumed`` (too little skin outside the patch; the patch
            already lies on the skin), ``none`` (asked for) or ``predicted`` (no worn scan: the
            corners were computed on the bare scan).
        rotation_deg, shift_mm: size of the motion applied to the worn scan (shift of
            the patch's centre).
        residual_rms_mm: point-to-plane rms of the skin used, or None.
        inlier_fraction: fraction of the skin points kept by the trim, or None.
        points_used: number of skin points used.
        shift_sd_mm, rotation_sd_deg: uncertainty of the patch's place from the
            registration (rms over the axes), 0 where the frame is given.
        grades_at_risk: cells whose grade changes in more than 5 % of the draws in which
            the registration alone is varied.
    """

    method: Literal["registered", "declared", "kept", "assumed", "none", "predicted"]
    rotation_deg: float
    shift_mm: float
    residual_rms_mm: float | None
    inlier_fraction: float | None
    points_used: int
    shift_sd_mm: float
    rotation_sd_deg: float
    grades_at_risk: int


@dataclass(frozen=True, eq=False)
class Conformability:
    """The score of one participant's worn patch.

    Cell arrays are (R, C), row 0 proximal, column 0 lateral; NaN or ``""`` exactly where
    ``reason`` is not empty.

    Attributes:
        participant: the subject's id.
        grade_by, alignment: the definition and the alignment that the grades use.
        cell_mm: nominal cell size of the patch.
        region: (R, C) region labels.
        overlap_paper: area(S and K) / area(S), S the skin cell, K the patch cell;
            overlap_strict: over the larger of the two areas; overlap_iou: over the union.
        skin_area_mm2, patch_area_mm2: (R, C) areas on the skin.
        grade: (R, C) by ``grade_by``; grades: the same by each definition.
        definition_matters: (R, C) whether the three definitions give different grades.
        overlap_low, overlap_high: 95 % interval of the graded overlap.
        probability: (R, C, 3) of good, fair, poor.
        perfect_fit_reading: (R, C) what a perfect fit would read on average with this
            node uncertainty: noise biases a good fit downwards.
        centre_offset_mm: (R, C) distance between the two cell centres, before any
            per-cell alignment.
        causes: why the overlap is what it is.
        reason: (R, C) why the cell has no score.
        skin_outline_mm, patch_outline_mm: (R, C, n, 2) closed outlines (first point not
            repeated) in the cell's flat frame: longitudinal (distal), lateral (medial),
            origin at the skin cell's centre.
        skin_outline_3d_mm, patch_outline_3d_mm: (R, C, n, 3) the same on the bare scan.
        lift_off_mm: (R+1, C+1) distance of each patch corner from the skin along the
            normal (positive outside); NaN where missing.
        regions: in the order in which the labels first appear; whole: all cells.
        frame: how the scans were brought together.
        samples, seed: of the Monte Carlo.
        node_sd_mm: (skin, patch) median node uncertainty used.
        notes: facts a reader needs, as sentences. warnings: what is doubtful.
    """

    participant: str
    grade_by: GradeBy
    alignment: Alignment
    cell_mm: float
    region: TextArray
    overlap_paper: FloatArray
    overlap_strict: FloatArray
    overlap_iou: FloatArray
    skin_area_mm2: FloatArray
    patch_area_mm2: FloatArray
    grade: TextArray
    grades: dict[GradeBy, TextArray]
    definition_matters: BoolArray
    overlap_low: FloatArray
    overlap_high: FloatArray
    probability: FloatArray
    perfect_fit_reading: FloatArray
    centre_offset_mm: FloatArray
    causes: Causes
    reason: TextArray
    skin_outline_mm: FloatArray
    patch_outline_mm: FloatArray
    skin_outline_3d_mm: FloatArray
    patch_outline_3d_mm: FloatArray
    lift_off_mm: FloatArray
    regions: tuple[RegionScore, ...]
    whole: RegionScore
    frame: FrameReport
    samples: int
    seed: int
    node_sd_mm: tuple[float, float]
    notes: tuple[str, ...] = ()
    warnings: tuple[Fault, ...] = ()

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C) number of patch cells down and across."""
        rows, columns = self.reason.shape
        return int(rows), int(columns)

    @property
    def overlap(self) -> FloatArray:
        """(R, C) the overlap that the grades use."""
        by: dict[GradeBy, FloatArray] = {
            "paper": self.overlap_paper,
            "strict": self.overlap_strict,
            "iou": self.overlap_iou,
        }
        return by[self.grade_by]

    @property
    def scored(self) -> BoolArray:
        """(R, C) whether the cell has a score."""
        return np.asarray(self.reason == "")
