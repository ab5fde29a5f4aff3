"""Registration, the descent: closest points, trimming, and the rigid steps they ask for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import RegistrationError
from kiribench.surface import connectivity, denoise_kernels
from kiribench.surface.face_grid import face_grid
from kiribench.surface.locate import locate
from kiribench.surface.mesh import FloatArray, Mesh
from kiribench.surface.rigid import RigidTransform, rotation_of

LARGEST_ANGLE_DEG = 45.0
MOST_ITERATIONS = 60
_OUTLIER_SIGMAS = 3.0
_SIGMA_OF_QUARTILE = 3.1383  # of |x|: less misled by nearly half of wrong points than the median
_FLOOR_MM = 0.01  # residuals below this are never outliers
_LEAST_STEP_MM = 1e-7
FREE = 1e-9  # share of the stiffest direction below which one is left alone
FEWEST = 20


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a descent ended.

    Attributes:
        pose: the motion found.
        iterations: steps taken.
        last_step: effect of the last step, in its own standard errors.
    """

    pose: RigidTransform
    iterations: int
    last_step: float


def descend(
    partners: Partners,
    points: FloatArray,
    directions: FloatArray,
    pose: RigidTransform,
    rounds: tuple[tuple[float, float], ...],
    most: int = MOST_ITERATIONS,
) -> Descent:
    """Iterate closest points from ``pose`` through ``rounds``."""
    iterations = 0
    last = np.inf
    for share, negligible in rounds:
        for _ in range(most):
            pairs = partners.find(pose.apply(points), directions @ pose.rotation.T)
            used = trimmed(pairs.residual, share)
            if len(used) < FEWEST:
                return Descent(pose, iterations, np.inf)
            rows, centre, reach = rows_of(pairs, used)
            residual = pairs.residual[used]
            scaled = _solve(rows, residual)
            turn = rotation_of(scaled[:3] / reach)
            shift = centre - turn @ centre + scaled[3:]
            pose = RigidTransform(turn, shift).after(pose)
            iterations += 1
            effect = float(np.linalg.norm(rows @ scaled))
            noise = float(np.sqrt(np.mean((residual - rows @ scaled) ** 2)))
            last = effect / max(noise, _LEAST_STEP_MM * np.sqrt(len(residual)))
            if last <= negligible:
                break
    return Descent(pose, iterations, last)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Points of the moving scan with a partner on the fixed one.

    Attributes:
        position: (k, 3) mm, on the moving scan, in the fixed frame.
        normal: (k, 3) unit normals of the fixed scan at the partners.
        residual: (k,) mm along the normal, from the point to its partner.
    """

    position: FloatArray
    normal: FloatArray
    residual: FloatArray


class Partners:
    """The fixed scan, ready to be asked for closest points."""

    def __init__(self, mesh: Mesh, exclude: NDArray[np.bool_] | None) -> None:
        self._mesh = mesh
        self._grid = face_grid(mesh)
        self._allowed = np.ones(len(mesh.faces), dtype=bool)
        if exclude is not None:
            self._allowed &= ~exclude
        count = len(mesh.vertices_mm)
        self._normals = denoise_kernels.vertex_directions(
            mesh.face_normals, mesh.face_areas_mm2, mesh.faces, count
        )
        order, starts = connectivity.edge_groups(mesh.faces, count)
        border = order[starts[:-1][np.diff(starts) == 1]]
        on_border = np.zeros(count, dtype=bool)
        on_border[mesh.faces[border // 3, border % 3]] = True
        on_border[mesh.faces[border // 3, (border + 1) % 3]] = True
        self._allowed &= ~on_border[mesh.faces].any(axis=1)

    def find(self, points: FloatArray, directions: FloatArray) -> Pairs:
        """Closest points of those (k, 3) points (mm) that have one of their direction (k, 3)."""
        found = locate(self._mesh, points, grid=self._grid).points
        corners = self._mesh.faces[found.faces]
        normal = np.einsum("kc,kcx->kx", found.barycentric, self._normals[corners])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        kept = self._allowed[found.faces] & (
            np.einsum("kx,kx->k", normal, directions) > np.cos(np.radians(LARGEST_ANGLE_DEG))
        )
        gap = found.positions_mm(self._mesh)[kept] - points[kept]
        return Pairs(points[kept], normal[kept], np.einsum("kx,kx->k", gap, normal[kept]))


def area_samples(
    mesh: Mesh, exclude: NDArray[np.bool_] | None, samples: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Points uniform in area on the allowed faces, and the smooth normals there."""
    area = mesh.face_areas_mm2.copy()
    if exclude is not None:
        area[exclude] = 0.0
    if not area.sum() > 0:
        raise RegistrationError(
            "registration-overlap",
            "Nothing is left of the moving scan outside the excluded part.",
            remedy="Exclude less: the skin around the patch is what registers the scans.",
        )
    # Systematic sampling of the cumulated area: even, whatever the size of the faces.
    ticks = (np.arange(samples) + rng.random()) / samples * area.sum()
    face = np.minimum(np.searchsorted(np.cumsum(area), ticks, side="right"), len(area) - 1)
    root, along = np.sqrt(rng.random(samples)), rng.random(samples)
    weights = np.column_stack([1.0 - root, root * (1.0 - along), root * along])
    normals = denoise_kernels.vertex_directions(
        mesh.face_normals, mesh.face_areas_mm2, mesh.faces, len(mesh.vertices_mm)
    )
    corners = mesh.faces[face]
    points = np.einsum("kc,kcx->kx", weights, mesh.vertices_mm[corners])
    direction = np.einsum("kc,kcx->kx", weights, normals[corners])
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-30)
    return np.asarray(points), np.asarray(direction)


def trimmed(residual: FloatArray, trim: float) -> NDArray[np.intp]:
    """The points to use: the best ``trim`` share, less those beyond 3 robust sigmas."""
    if len(residual) == 0:  # a start or a step that lost every partner
        return np.zeros(0, dtype=np.intp)
    size = np.abs(residual)
    limit = _OUTLIER_SIGMAS * _SIGMA_OF_QUARTILE * float(np.quantile(size, 0.25))
    kept = np.argsort(size, kind="stable")[: max(6, int(np.ceil(trim * len(size))))]
    return np.sort(kept[size[kept] <= max(limit, _FLOOR_MM)])


def rows_of(pairs: Pairs, used: NDArray[np.intp]) -> tuple[FloatArray, FloatArray, float]:
    """The equations ``rows @ (reach * w, t) = residual`` about the points' centre."""
    position, normal = pairs.position[used], pairs.normal[used]
    centre = position.mean(axis=0)
    arm = position - centre
    reach = float(np.sqrt(np.mean(np.sum(arm**2, axis=1))))
    return np.hstack([np.cross(arm, normal) / reach, normal]), centre, reach


def _solve(rows: FloatArray, residual: FloatArray) -> FloatArray:
    """Least squares; directions that the shape leaves free are not moved along."""
    values, vectors = np.linalg.eigh(rows.T @ rows)
    firm = values > FREE * values[-1]
    along = vectors.T @ (rows.T @ residual)
    return np.asarray(vectors @ np.where(firm, along / np.where(firm, values, 1.0), 0.0))
