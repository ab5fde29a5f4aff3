"""Methods and assumptions in sentences, made from the options and results of this run."""

from __future__ import annotations

from dataclasses import dataclass

from kiribench.conformability.result import FAIR_FROM, GOOD_FROM, Conformability, FrameReport
from kiribench.report.subject import SubjectReport
from kiribench.report.words import count, number, percent
from kiribench.strain.result import StrainField


@dataclass(frozen=True)
class Reference:
    """A source that a sentence of the methods rests on."""

    key: str
    words: str
    url: str


PAPER = Reference(
    "paper",
    "Bali J., Li J., Chen J., Li S. Rapid Design and Fabrication of Body Conformable Surfaces "
    "with Kirigami Cutting and Machine Learning. arXiv 2511.13941.",
    "https://arxiv.org/abs/2511.13941",
)
GEODESICS = Reference(
    "geodesics",
    "Mitchell J. S. B., Mount D. M., Papadimitriou C. H. The discrete geodesic problem. SIAM J. "
    "Comput. 16 (1987) 647-668.",
    "https://doi.org/10.1137/0216045",
)
FIELLER = Reference(
    "fieller",
    "Fieller E. C. Some problems in interval estimation. J. R. Stat. Soc. B 16 (1954) 175-185.",
    "https://doi.org/10.1111/j.2517-6161.1954.tb00159.x",
)

MEASURE_WORDS = {
    "log": "logarithmic (Hencky) strain, the logarithm of the stretch",
    "engineering": "engineering strain, the stretch minus one",
    "green": "Green-Lagrange strain, half of the squared stretch minus one",
}
FRAME_WORDS = {
    "registered": "was registered to the bare flexed scan by the skin outside the patch (rigid, "
    "trimmed, point to plane)",
    "declared": "was taken to lie in the frame of the bare flexed scan, as its sidecar declares",
    "kept": "was kept in its frame, because registering it would not have improved the fit "
    "significantly",
    "assumed": "was taken to lie in the frame of the bare flexed scan, because too little skin "
    "is visible outside the patch to register by",
    "none": "was not registered, as asked for",
    "predicted": "does not exist: the patch was computed on the bare scan",
}


def methods(subject: SubjectReport) -> tuple[str, ...]:
    """The paragraphs of the methods section, for what was done and nothing else."""
    paragraphs = []
    if subject.strain is not None:
        paragraphs.append(_strain(subject, subject.strain))
    if subject.conformability is not None:
        paragraphs.append(_overlap(subject, subject.conformability))
        paragraphs.append(_frame(subject.conformability.frame))
        paragraphs.append(_uncertainty(subject.conformability))
    return tuple(paragraphs)


def references(subject: SubjectReport) -> tuple[Reference, ...]:
    """The sources that follow from what was done."""
    listed = [PAPER, GEODESICS]
    if subject.strain is not None:
        listed.append(FIELLER)
    return tuple(listed)


def _strain(subject: SubjectReport, strain: StrainField) -> str:
    grid = subject.layout.grid
    denoised = [
        name
        for name, done in zip(
            (strain.reference_pose, strain.deformed_pose), strain.denoised, strict=True
        )
        if done
    ]
    return (
        f"The grid of {grid.rows} x {grid.columns} cells of {grid.pitch_mm:g} mm was measured on "
        f"the bare scans {strain.reference_pose} and {strain.deformed_pose}. "
        + (f"Noise was removed from {' and '.join(denoised)} first. " if denoised else "")
        + "Every cell edge is the exact shortest path on the triangle mesh between nodes that may "
        "lie inside faces (Mitchell, Mount and Papadimitriou 1987). A cell's longitudinal and "
        "lateral stretch are the means of the length ratios of its two opposite edges, as in the "
        f"paper. Strains are in {MEASURE_WORDS[strain.strain_measure]}; Poisson's ratio is minus "
        "lateral over longitudinal strain in that measure, masked where the longitudinal strain is "
        f"below {strain.min_strain:g}, with Fieller's 95 % interval (1954). Shear comes from the "
        "cell's in-plane deformation gradient, fitted to its four corners."
    )


def _overlap(subject: SubjectReport, score: Conformability) -> str:
    rows, columns = score.shape
    thickness = subject.layout.patch.thickness_mm
    formula = {
        "paper": "the part of the skin cell's area that the patch cell covers",
        "strict": "the common area over the larger of the two areas",
        "iou": "the common area over the area of the union",
    }[score.grade_by]
    aligned = (
        "where the patch was strapped (global alignment)"
        if score.alignment == "global"
        else "after each patch cell was moved onto the centre of its skin cell (per-cell "
        "alignment, which flatters)"
    )
    return (
        f"Each of the {rows} x {columns} patch cells was compared with its cell of the drawn grid "
        f"on the bare flexed scan. Patch corners ({thickness:g} mm patch) were projected onto the "
        "skin along its normals; sides are geodesics; both outlines were laid flat by distance and "
        "direction from the skin cell's centre, so that areas are kept, and intersected. The grade "
        f"is by '{score.grade_by}': {formula}, {aligned}. "
        f"Good is {percent(GOOD_FROM, 0)} or more, fair "
        f"{percent(FAIR_FROM, 0)} or more, poor below; these limits are the paper's."
    )


def _frame(frame: FrameReport) -> str:
    words = f"The worn scan {FRAME_WORDS[frame.method]}."
    if frame.residual_rms_mm is not None:
        words += (
            f" It moved by {number(frame.shift_mm)} mm and {number(frame.rotation_deg)} degrees; "
            f"the residual is {number(frame.residual_rms_mm, 3)} mm rms over "
            f"{count(frame.points_used, 'point')}."
        )
    if frame.shift_sd_mm > 0:
        words += (
            f" This leaves the patch's place uncertain by {number(frame.shift_sd_mm, 3)} mm, which "
            f"puts the grade of {count(frame.grades_at_risk, 'cell')} at risk."
        )
    return words


def _uncertainty(score: Conformability) -> str:
    skin, patch = score.node_sd_mm
    return (
        f"Intervals and grade probabilities are from {score.samples} Monte Carlo draws (seed "
        f"{score.seed}) of the node positions, with a standard deviation of {skin:.3g} mm (skin) "
        f"and {patch:.3g} mm (patch) in each direction, and of the registration. Noise can only "
        "take from a perfect fit, so a good cell reads slightly low; the table of all cells gives "
        "what a perfect fit would read. A 95 % interval holds the fits that would read so; in "
        "repeated simulations it held the truth in 94 to 100 % of the readings by 'paper', in 92 "
        "to 100 % by 'strict' and 'iou'."
    )


def assumptions(subject: SubjectReport) -> tuple[str, ...]:
    """What had to be chosen because neither the data nor the paper says it."""
    layout = subject.layout
    score = subject.conformability
    listed = []
    if score is not None:
        row, column = layout.patch_offset
        given = layout.patch.row_offset is not None and layout.patch.column_offset is not None
        listed.append(
            f"The patch's corner (0, 0) lies on node ({row}, {column}) of the drawn grid "
            + ("(given in the metadata)." if given else "(centred; the data gives no offset).")
        )
        if layout.body_part == "knee":
            listed.append(
                "The region table says which cell belongs to which region; the paper names seven "
                "regions but not their cells."
            )
        listed.append("An overlap of exactly 75 % counts as fair, of exactly 90 % as good.")
        listed.append(
            "The paper gives no formula for 'areal overlap'; all three readings are shown."
        )
        listed.append(
            "Between its corners a patch cell's side is taken as a geodesic; curved or wrinkled "
            "sides are not seen."
        )
    if subject.strain is not None:
        listed.append(
            "The paper does not name its strain measure; the logarithmic one is the default here."
        )
        listed.append("A cell's strain is one value; what varies within a cell is not resolved.")
    listed.append("Nodes are uncertain independently of each other, alike in both directions.")
    if subject.synthetic:
        listed.append(
            "The synthetic skin follows closed formulas. How a patch fits it says nothing about "
            "how any real patch fits any person."
        )
    return tuple(listed)


def facts(subject: SubjectReport) -> tuple[str, ...]:
    """The notes that the two results carry, each once."""
    notes: list[str] = []
    for result in (subject.conformability, subject.strain):
        notes.extend(result.notes if result is not None else ())
    return tuple(dict.fromkeys(notes))
