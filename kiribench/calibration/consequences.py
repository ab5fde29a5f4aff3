"""What the choice of the law changes in a cut sheet, and what it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fem.assembly import POINTS, AssembledSystem, quadrature
from kiribench.fem.cell import CELL_MESH, cell_equations, cell_mesh
from kiribench.fem.equilibrium import LoadStepper, Solved
from kiribench.fem.material import Material, response

FloatArray = npt.NDArray[np.float64]

TIP_RADIUS = 0.04
"""Tip stress is averaged over the material this near to a cut tip, in cells. Nearer to the tip
the stress grows without bound as the mesh is refined, so a largest stress has no meaning."""
STRETCHES = (1.1, 1.2, 1.35, 1.5)
CELL_MM = 10.0


@dataclass(frozen=True, eq=False)
class CellPull:
    """The periodic cell pulled with one law; n stretches.

    Attributes:
        a, b: cut lengths / cell edge.
        material: the law.
        stretch: (n,) longitudinal.
        poisson: (n,) Poisson's ratio in log strain.
        stress_mpa: (n,) nominal stress of the sheet.
        tip_stress_mpa: (n,) largest principal true stress, mean within :data:`TIP_RADIUS` of the
            cut tips.
        tip_stretch: (n,) largest principal stretch, mean over the same material.
    """

    a: float
    b: float
    material: Material
    stretch: FloatArray
    poisson: FloatArray
    stress_mpa: FloatArray
    tip_stress_mpa: FloatArray
    tip_stretch: FloatArray


def pull_cell(
    a: float, b: float, material: Material, stretches: tuple[float, ...] = STRETCHES
) -> CellPull:
    """Pull the periodic cell; steps that have no answer are NaN.

    Args:
        a, b: cut lengths / cell edge, below 1; without any the tip's columns are NaN.
        material: a law of the finite elements.
        stretches: longitudinal, growing from above 1.
    """
    mesh = cell_mesh(a, b, CELL_MM, CELL_MESH)
    triangles = mesh.triangles()
    equation, pattern, sides = cell_equations(mesh)
    system = AssembledSystem(mesh.points_mm, triangles, equation, material)
    stepper = LoadStepper(system, pattern)
    points = quadrature(mesh.points_mm, triangles)
    near = _near_tips(mesh.points_mm, triangles, a, b)
    half = CELL_MM / 2
    rows = np.full((len(stretches), 4), np.nan)
    for k, stretch in enumerate(stretches):
        state = stepper.advance(stretch - 1)
        if not isinstance(state, Solved):
            break
        width = float(state.x[sides["right"][0], 0]) / half
        pull = float(system.forces(state.x)[sides["top"], 1].sum()) / half
        tip = _tip(state.x, triangles, points.gradients, points.areas_mm2, near, material)
        rows[k] = -np.log(width) / np.log(stretch), pull, *tip
    return CellPull(a, b, material, np.array(stretches), *rows.T)


def _near_tips(
    points: FloatArray, triangles: npt.NDArray[np.int64], a: float, b: float
) -> npt.NDArray[np.bool_]:
    """(m, q) the integration points within :data:`TIP_RADIUS` of a cut tip."""
    half = CELL_MM / 2
    # Walking round the facet, every edge begins with a half-cut: across, along, across, along.
    tips = []
    if a > 0:
        tips += [(a * half, 0.0), (half - a * half, half)]
    if b > 0:
        tips += [(half, b * half), (0.0, half - b * half)]
    if not tips:
        return np.zeros((len(triangles), len(POINTS)), dtype=bool)
    r, s = POINTS[:, 0], POINTS[:, 1]
    t = 1 - r - s
    shapes = np.stack(
        [t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * r * t, 4 * r * s, 4 * s * t]
    )
    at = np.einsum("aq,mai->mqi", shapes, points[triangles])
    away = np.linalg.norm(at[:, :, None] - np.array(tips)[None, None], axis=3).min(axis=2)
    return np.asarray(away < TIP_RADIUS * CELL_MM)


def _tip(
    x: FloatArray,
    triangles: npt.NDArray[np.int64],
    gradients: FloatArray,
    areas: FloatArray,
    near: npt.NDArray[np.bool_],
    material: Material,
) -> tuple[float, float]:
    """Mean largest principal true stress (MPa) and stretch over the material near the tips."""
    stress = stretch = area = 0.0
    out = np.zeros(14)
    for element, point in np.argwhere(near):
        gradient = x[triangles[element]].T @ gradients[element, point]
        (p, q), (r, s) = gradient.tolist()
        response(p, q, r, s, material.mu_mpa, float(material.alpha), False, out)
        # True stress is P F^T over the change of volume, which is none.
        true = out[:4].reshape(2, 2) @ gradient.T
        weight = float(areas[element, point])
        stress += weight * float(np.linalg.eigvalsh(0.5 * (true + true.T))[-1])
        stretch += weight * float(np.linalg.svd(gradient, compute_uv=False)[0])
        area += weight
    return (stress / area, stretch / area) if area else (np.nan, np.nan)
