"""Skins for the tests of the worn patch: a sphere, moved and mirrored maps, knees on disk."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kiribench.dataset import Dataset
from kiribench.fem.surface_map import NodeSpline, SurfaceJet, SurfaceMap

SYNTHETIC = Path(__file__).parents[1] / "data" / "synthetic"


@dataclass(frozen=True)
class Sphere:
    """Parallels and meridians of a sphere about the origin; v = 0 is the equator."""

    radius_mm: float

    @property
    def outward(self) -> float:
        return 1.0

    def at(self, q: np.ndarray) -> SurfaceJet:
        r = self.radius_mm
        (su, cu), (sv, cv) = ((np.sin(t / r), np.cos(t / r)) for t in q.T)
        x = r * np.column_stack([su * cv, sv, cu * cv])
        zero = np.zeros_like(su)
        first = np.stack(
            [np.column_stack([cu * cv, zero, -su * cv]), np.column_stack([-su * sv, cv, -cu * sv])],
            axis=1,
        )
        second = (
            np.stack(
                [
                    np.column_stack([-su * cv, zero, -cu * cv]),
                    np.column_stack([-cu * sv, zero, su * sv]),
                    np.column_stack([-su * cv, -sv, -cu * cv]),
                ],
                axis=1,
            )
            / r
        )
        return SurfaceJet(x, first, second)


@dataclass(frozen=True)
class Quadric:
    """A plane stretched alike both ways and bent: z = -(across x^2 + along y^2) / 2 - twist x y."""

    across: float
    along: float
    stretch: float = 1.0
    twist: float = 0.0

    @property
    def outward(self) -> float:
        return 1.0

    def at(self, q: np.ndarray) -> SurfaceJet:
        s = self.stretch
        x, y = s * q.T
        zero, one = np.zeros_like(x), np.ones_like(x)
        height = -0.5 * (self.across * x * x + self.along * y * y) - self.twist * x * y
        place = np.column_stack([x, y, height])
        first = s * np.stack(
            [
                np.column_stack([one, zero, -self.across * x - self.twist * y]),
                np.column_stack([zero, one, -self.along * y - self.twist * x]),
            ],
            axis=1,
        )
        second = np.zeros((len(q), 3, 3))
        second[:, :, 2] = -s * s * np.array([self.across, self.twist, self.along])
        return SurfaceJet(place, first, second)


@dataclass(frozen=True, eq=False)
class Moved:
    """Another skin, turned (3, 3) and displaced (3,)."""

    surface: SurfaceMap
    turn: np.ndarray
    shift: np.ndarray

    @property
    def outward(self) -> float:
        return self.surface.outward * float(np.sign(np.linalg.det(self.turn)))

    def at(self, q: np.ndarray) -> SurfaceJet:
        jet = self.surface.at(q)
        return SurfaceJet(
            jet.x @ self.turn.T + self.shift, jet.first @ self.turn.T, jet.second @ self.turn.T
        )


@dataclass(frozen=True, eq=False)
class Relabelled:
    """Another skin with material coordinates that begin elsewhere: q + shift is q there."""

    surface: SurfaceMap
    shift: tuple[float, float]

    @property
    def outward(self) -> float:
        return self.surface.outward

    def at(self, q: np.ndarray) -> SurfaceJet:
        return self.surface.at(q + np.array(self.shift))


def sphere_nodes(radius: float, rows: int, columns: int, pitch: float) -> np.ndarray:
    """Nodes (rows, columns, 3) of ``Sphere`` about its equator and zero meridian."""
    u, v = np.meshgrid(
        pitch * (np.arange(columns) - (columns - 1) / 2), pitch * (np.arange(rows) - (rows - 1) / 2)
    )
    q = np.column_stack([u.ravel(), v.ravel()])
    return Sphere(radius).at(q).x.reshape(rows, columns, 3)


def knee_nodes(participant: str, acquisition: str) -> np.ndarray:
    """Nodes (17, 13, 3) of a shipped subject."""
    table = Dataset.open(SYNTHETIC).subject(participant).nodes(acquisition)
    nodes = np.full((*table.shape, 3), np.nan)
    nodes[table.row, table.col] = table.xyz_mm
    return nodes


def knee(participant: str) -> NodeSpline:
    """The 90-degree skin of a shipped subject."""
    return NodeSpline.of(knee_nodes(participant, "flex090"), 15.0)
