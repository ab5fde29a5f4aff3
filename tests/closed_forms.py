"""Closed-form surfaces on which geodesics and areas are known, for the synthetic truth."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from kiribench.synthetic.jet import FloatArray, Jet
from kiribench.synthetic.smooth import SmoothSurface


def plane() -> SmoothSurface:
    """A plane in curved coordinates: its geodesics are straight in space, not in (u, v)."""

    def embedding(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        return u + 2.0 * (v / 17.0).sin(), v + 1.5 * (u / 13.0).cos() + 0.05 * u, 0.0 * u

    return SmoothSurface(embedding)


def sphere(radius: float) -> SmoothSurface:
    """Longitude u / R and latitude v / R, in mm at the equator; the axis is y."""

    def embedding(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        a, b = u / radius, v / radius
        return radius * b.cos() * a.sin(), radius * b.sin(), radius * b.cos() * a.cos()

    return SmoothSurface(embedding)


def cylinder(radius: float, across: float = 1.0, along: float = 1.0) -> SmoothSurface:
    """A cylinder about y whose material is stretched across and along."""

    def embedding(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        angle = across / radius * u
        return radius * angle.sin(), along * v, radius * angle.cos()

    return SmoothSurface(embedding)


def sheared_plane(shear: float) -> SmoothSurface:
    """A plane whose lateral lines lean: (u, v) -> (u + shear v, v)."""

    def embedding(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        return u + shear * v, v, 0.0 * u

    return SmoothSurface(embedding)


def spherical_polygon_mm2(corners: FloatArray) -> float:
    """Area by Girard's theorem of a convex polygon of great circles, corners (n, 3)."""
    radius = float(np.linalg.norm(corners[0]))
    unit = corners / radius
    angles = 0.0
    for i in range(len(unit)):
        before, here, after = unit[i - 1], unit[i], unit[(i + 1) % len(unit)]
        a, b = np.cross(here, before), np.cross(here, after)
        angles += float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    return (angles - (len(unit) - 2) * np.pi) * radius**2


def clip_spherical(polygon: FloatArray, by: FloatArray) -> FloatArray:
    """The common part of two convex polygons of great circles, by half-spaces in turn."""
    radius = float(np.linalg.norm(polygon[0]))
    inside_of = by.mean(axis=0)
    for start, end in pairwise(np.vstack([by, by[:1]])):
        pole = np.cross(start, end)
        pole *= np.sign(pole @ inside_of)
        kept = []
        for here, after in pairwise(np.vstack([polygon, polygon[:1]])):
            h, a = pole @ here, pole @ after
            if h >= 0:
                kept.append(here)
            if h * a < 0:
                crossing = here + (after - here) * h / (h - a)
                kept.append(crossing / np.linalg.norm(crossing) * radius)
        polygon = np.array(kept)
    return polygon
