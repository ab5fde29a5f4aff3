"""A subject on a cylinder with a known mismatch, for the tests of the report.

The overlaps, grades and causes are computed by the package from these outlines; only the
scan processing before them is left out.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

from kiribench.conformability.causes import costs, fit_affine, main_cause
from kiribench.conformability.grades import grade_of, region_score, region_scores
from kiribench.conformability.overlap import overlaps
from kiribench.conformability.result import Causes, Conformability, FrameReport
from kiribench.errors import Fault
from kiribench.report.subject import SubjectReport
from kiribench.schema.layout import Layout, Patch, Regions
from kiribench.strain.result import Estimate, StrainField
from kiribench.surface.mesh import Mesh

STORED = Path(__file__).parents[1] / "data" / "synthetic"
RADIUS_MM = 60.0
CELL_MM = 15.0
SIDE_POINTS = 4


def copy_of_s1(root: Path) -> Path:
    """The first synthetic subject alone, as a dataset at ``root``."""
    shutil.copytree(STORED, root, ignore=shutil.ignore_patterns("sub-S2", "sub-S3"))
    listed = (root / "participants.tsv").read_text(encoding="utf-8").splitlines()
    (root / "participants.tsv").write_text("\n".join(listed[:2]) + "\n", encoding="utf-8")
    return root


def lift(flat: np.ndarray, side: str = "right") -> np.ndarray:
    """(longitudinal, lateral) mm from the centre of the patch -> on a cylinder, mm."""
    angle = flat[..., 1] / RADIUS_MM
    sign = -1.0 if side == "left" else 1.0
    return np.stack(
        [sign * RADIUS_MM * np.sin(angle), -flat[..., 0], RADIUS_MM * np.cos(angle)], axis=-1
    )


def cylinder_mesh(side: str = "right", step_mm: float = 3.0) -> Mesh:
    """A cylindrical skin 260 x 200 mm around the patch, outside normals."""
    along = np.arange(-130.0, 130.1, step_mm)
    across = np.arange(-100.0, 100.1, step_mm)
    grid = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1)
    vertices = lift(grid, side).reshape(-1, 3)
    n = len(across)
    first = (np.arange(len(along) - 1)[:, None] * n + np.arange(n - 1)[None, :]).ravel()
    faces = np.concatenate(
        [
            np.stack([first, first + n, first + n + 1], axis=1),
            np.stack([first, first + n + 1, first + 1], axis=1),
        ]
    )
    if side == "left":
        faces = faces[:, ::-1]
    return Mesh(vertices, faces.astype(np.int32))


def square(points: int = SIDE_POINTS) -> np.ndarray:
    """(4 n, 2) outline of the unit square about 0; corners in the order of a cell's."""
    corners = np.array([[-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]])
    t = np.arange(points) / points
    sides = [corners[i] + t[:, None] * (corners[(i + 1) % 4] - corners[i]) for i in range(4)]
    return np.concatenate(sides)


def conformability_case(
    participant: str = "S1",
    *,
    rows: int = 12,
    columns: int = 6,
    side: str = "right",
    missing: tuple[tuple[int, int], ...] = ((11, 5),),
    grade_by: str = "paper",
    regions: Regions | None = None,
) -> Conformability:
    """Patch cells that shift, stretch and shear more and more towards the lateral edge."""
    rng = np.random.default_rng(5)
    region = np.array((regions or Regions.knee(Patch(rows=rows, columns=columns))).labels)
    outline = CELL_MM * square()
    n = len(outline)
    skin = np.broadcast_to(outline, (rows, columns, n, 2)).copy()
    patch = skin.copy()
    skin3, patch3 = np.zeros((rows, columns, n, 3)), np.zeros((rows, columns, n, 3))
    cost = np.zeros((rows, columns, 6))
    main = np.full((rows, columns), "", dtype="<U24")
    fits = np.zeros((rows, columns, 7))
    for r in range(rows):
        for c in range(columns):
            edge = abs(c - 0.6 * (columns - 1)) / max(columns - 1, 1)
            shear = 0.35 * edge * np.sin(3.1 * r / rows)
            matrix = np.array([[1 - 0.25 * edge, shear], [0.0, 1 + 0.12 * np.cos(r)]])
            shift = np.array([2.2 * edge, 3.5 * edge * np.cos(r / 3)]) + rng.normal(0, 0.15, 2)
            patch[r, c] = outline @ matrix.T + shift
            fit = fit_affine(skin[r, c, ::SIDE_POINTS], patch[r, c, ::SIDE_POINTS])
            cost[r, c] = costs(fit, skin[r, c], patch[r, c], grade_by)
            main[r, c] = main_cause(cost[r, c])
            fits[r, c] = (
                *fit.shift, np.degrees(fit.rotation), fit.longitudinal, fit.lateral, fit.shear,
                fit.rest_mm,
            )  # fmt: skip
            place = CELL_MM * np.array([r - (rows - 1) / 2, c - (columns - 1) / 2])
            skin3[r, c] = lift(skin[r, c] + place, side)
            patch3[r, c] = lift(patch[r, c] + place, side) * np.array([1.03, 1.0, 1.03])
    areas = overlaps(skin, patch)
    reason = np.full((rows, columns), "", dtype="<U24")
    for place in missing:
        reason[place] = "patch-node-missing"
    gone = reason != ""

    def known(values: np.ndarray) -> np.ndarray:
        masked = np.array(values, dtype=np.float64)
        masked[gone] = np.nan
        return masked

    by = {"paper": known(areas.paper), "strict": known(areas.strict), "iou": known(areas.iou)}
    grades = {name: grade_of(values) for name, values in by.items()}
    overlap = by[grade_by]
    draws = np.clip(overlap + rng.normal(0, 0.015, (200, rows, columns)), 0, 1)
    differ = (grades["paper"] != grades["strict"]) | (grades["paper"] != grades["iou"])
    probability = np.stack(
        [
            (draws >= 0.9).mean(axis=0),
            ((draws >= 0.75) & (draws < 0.9)).mean(axis=0),
            (draws < 0.75).mean(axis=0),
        ],
        axis=-1,
    )
    main[gone] = ""
    scores = region_scores(region, overlap, grades[grade_by], draws)
    whole = region_score("all", np.ones((rows, columns), bool), overlap, grades[grade_by], draws)
    return Conformability(
        participant=participant,
        grade_by=grade_by,
        alignment="global",
        cell_mm=CELL_MM,
        region=region,
        overlap_paper=by["paper"],
        overlap_strict=by["strict"],
        overlap_iou=by["iou"],
        skin_area_mm2=known(areas.skin),
        patch_area_mm2=known(areas.patch),
        grade=grades[grade_by],
        grades=grades,
        definition_matters=differ & ~gone,
        overlap_low=known(overlap - 0.03),
        overlap_high=known(np.minimum(overlap + 0.03, 1)),
        probability=known(probability),
        perfect_fit_reading=known(np.full((rows, columns), 0.985)),
        centre_offset_mm=known(np.hypot(fits[..., 0], fits[..., 1])),
        causes=Causes(
            shift_mm=known(fits[..., :2]),
            rotation_deg=known(fits[..., 2]),
            longitudinal_stretch=known(fits[..., 3]),
            lateral_stretch=known(fits[..., 4]),
            shear=known(fits[..., 5]),
            rest_mm=known(fits[..., 6]),
            cost=known(cost),
            main=main,
        ),
        reason=reason,
        skin_outline_mm=known(skin),
        patch_outline_mm=known(patch),
        skin_outline_3d_mm=known(skin3),
        patch_outline_3d_mm=known(patch3),
        lift_off_mm=np.full((rows + 1, columns + 1), 2.0),
        regions=scores,
        whole=whole,
        frame=FrameReport("registered", 1.2, 3.4, 0.21, 0.8, 4200, 0.05, 0.1, 1),
        samples=200,
        seed=5,
        node_sd_mm=(0.1, 0.15),
        notes=("The patch lies 2 mm above the skin; its corners are projected along normals.",),
        warnings=(
            Fault("frame-far", "The worn scan was moved by 3.4 mm.", "Check the registration."),
        ),
    )


def strain_case(participant: str = "S1", *, rows: int = 16, columns: int = 12) -> StrainField:
    """Strains like those the paper describes, with one node missing."""
    r, c = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    along = 0.12 + 0.33 * np.exp(-3 * (r**2 + c**2)) - 0.15 * (r > 0.85)
    across = 0.16 * np.exp(-3 * (r**2 + (np.abs(c) - 0.5) ** 2)) - 0.06 * (r > 0.6)
    reason = np.full((rows, columns), "", dtype="<U24")
    reason[0, :2] = "node-missing"
    gone = reason != ""
    poisson_reason = reason.copy()
    poisson_reason[(np.abs(along) < 0.03) & ~gone] = "strain-too-small"
    poisson_reason[rows - 3, 0] = "interval-unbounded"

    def estimate(values: np.ndarray, sd: float, mask: np.ndarray) -> Estimate:
        shown = np.where(mask, np.nan, values)
        return Estimate(shown, np.where(mask, np.nan, sd), shown - 1.96 * sd, shown + 1.96 * sd)

    with np.errstate(divide="ignore"):
        ratio = -across / along
    shear = 0.2 * r * c
    gradient = np.zeros((rows, columns, 2, 2))
    gradient[..., 0, 0], gradient[..., 1, 1] = np.exp(along), np.exp(across)
    gradient[..., 0, 1] = shear * np.exp(along)
    plain = np.where(gone, np.nan, 0.0)
    return StrainField(
        participant=participant,
        strain_measure="log",
        min_strain=0.03,
        longitudinal_stretch=estimate(np.exp(along), 0.01, gone),
        lateral_stretch=estimate(np.exp(across), 0.01, gone),
        longitudinal_strain=estimate(along, 0.01, gone),
        lateral_strain=estimate(across, 0.01, gone),
        shear=estimate(shear, 0.012, gone),
        poisson_ratio=estimate(
            ratio, 0.08, (poisson_reason != "") & (poisson_reason != "interval-unbounded")
        ),
        gradient=gradient,
        gradient_longitudinal_stretch=np.exp(along),
        gradient_lateral_stretch=np.exp(across),
        principal_stretches=np.stack([np.exp(along), np.exp(across)], axis=-1),
        principal_angle_deg=plain,
        rotation_deg=plain,
        area_ratio=np.exp(along + across),
        green=np.zeros((rows, columns, 3)),
        hencky=np.zeros((rows, columns, 3)),
        reason=reason,
        poisson_reason=poisson_reason,
        reference_edges_mm=(np.full((rows, columns + 1), 15.0), np.full((rows + 1, columns), 15.0)),
        deformed_edges_mm=(np.full((rows, columns + 1), 17.0), np.full((rows + 1, columns), 16.0)),
        sd_reference_mm=np.full((rows + 1, columns + 1), 0.1),
        sd_deformed_mm=np.full((rows + 1, columns + 1), 0.1),
        reference_pose="flex000",
        deformed_pose="flex090",
    )


def subject_case(participant: str = "S1", **changes: object) -> SubjectReport:
    """A whole subject; ``changes`` replace fields of the :class:`SubjectReport`."""
    side = str(changes.get("side", "right"))
    given: dict[str, object] = {
        "participant": participant,
        "dataset": "A test on a cylinder",
        "side": side,
        "layout": Layout.of(),
        "synthetic": True,
        "conformability": conformability_case(participant, side=side),
        "strain": strain_case(participant),
        "surface": cylinder_mesh(side),
        "settings": {"grade-by": "paper", "alignment": "global", "seed": 5},
        "provenance": {
            "kiribench": "0.1.0",
            "python": "3.11.0",
            "libraries": {"numpy": "2.4.6"},
            "inputs": {"sub-S1/surf/a.obj": {"sha256": "ab" * 32, "bytes": 12}},
        },
    }
    return SubjectReport(**{**given, **changes})  # type: ignore[arg-type]
