"""Compiled loops of the denoiser: filter face normals, then move vertices along normals."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def vertex_faces(faces, vertex_count):  # type: ignore[no-untyped-def]
    """Faces around each vertex: offsets (n+1,) int64 into items (3m,) int32."""
    offsets = np.zeros(vertex_count + 1, np.int64)
    for face in range(len(faces)):
        for corner in range(3):
            offsets[faces[face, corner] + 1] += 1
    for vertex in range(vertex_count):
        offsets[vertex + 1] += offsets[vertex]
    items = np.empty(offsets[-1], np.int32)
    place = offsets[:-1].copy()
    for face in range(len(faces)):
        for corner in range(3):
            vertex = faces[face, corner]
            items[place[vertex]] = face
            place[vertex] += 1
    return offsets, items


@njit(cache=True)
def face_neighbours(centres, areas, faces, offsets, items, space_mm):  # type: ignore[no-untyped-def]
    """The faces that share a vertex with each face, and their weights.

    Returns bounds (m+1,) int64, others int32 and weights float32: area x Gaussian of the
    distance of the centres (``space_mm``), relative to the face's own area.
    """
    count = len(faces)
    bounds = np.zeros(count + 1, np.int64)
    others = np.empty(0, np.int32)
    weights = np.empty(0, np.float32)
    per_space = 0.5 / (space_mm * space_mm)
    for filling in range(2):
        if filling:
            others = np.empty(bounds[count], np.int32)
            weights = np.empty(bounds[count], np.float32)
        at = 0
        for face in range(count):
            first, second = faces[face, 0], faces[face, 1]
            for corner in range(3):
                vertex = faces[face, corner]
                for place in range(offsets[vertex], offsets[vertex + 1]):
                    other = items[place]
                    a, b, c = faces[other, 0], faces[other, 1], faces[other, 2]
                    if other == face:
                        continue
                    if corner > 0 and (a == first or b == first or c == first):
                        continue
                    if corner > 1 and (a == second or b == second or c == second):
                        continue
                    if filling:
                        apart = 0.0
                        for axis in range(3):
                            apart += (centres[other, axis] - centres[face, axis]) ** 2
                        others[at] = other
                        weights[at] = (
                            areas[other] / max(areas[face], 1e-30) * np.exp(-apart * per_space)
                        )
                    at += 1
            bounds[face + 1] = at
    return bounds, others, weights


@njit(cache=True)
def filter_normals(normals, guide, bounds, others, weights, range_scale):  # type: ignore[no-untyped-def]
    """One pass of joint bilateral filtering of the face normals (m, 3).

    A neighbour counts by its weight x Gaussian of the difference of the guide normals
    (``range_scale``; 0: by its weight alone).
    """
    out = np.empty_like(normals)
    per_range = 0.5 / (range_scale * range_scale) if range_scale > 0.0 else 0.0
    for face in range(len(normals)):
        x, y, z = normals[face, 0], normals[face, 1], normals[face, 2]
        for place in range(bounds[face], bounds[face + 1]):
            other = others[place]
            weight = np.float64(weights[place])
            if per_range > 0.0:
                i = guide[other, 0] - guide[face, 0]
                j = guide[other, 1] - guide[face, 1]
                k = guide[other, 2] - guide[face, 2]
                weight *= np.exp(-(i * i + j * j + k * k) * per_range)
            x += weight * normals[other, 0]
            y += weight * normals[other, 1]
            z += weight * normals[other, 2]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            out[face, 0] = x / length
            out[face, 1] = y / length
            out[face, 2] = z / length
        else:
            out[face] = normals[face]
    return out


@njit(cache=True)
def vertex_directions(normals, areas, faces, vertex_count):  # type: ignore[no-untyped-def]
    """(n, 3) unit area-weighted mean of the normals around each vertex."""
    out = np.zeros((vertex_count, 3))
    for face in range(len(faces)):
        for corner in range(3):
            for axis in range(3):
                out[faces[face, corner], axis] += areas[face] * normals[face, axis]
    for vertex in range(vertex_count):
        length = np.sqrt((out[vertex] ** 2).sum())
        if length > 0.0:
            out[vertex] /= length
    return out


@njit(cache=True)
def move_vertices(  # type: ignore[no-untyped-def]
    xyz, directions, normals, areas, faces, offsets, items, held, passes
):
    """Move vertices along ``directions`` until faces agree with ``normals``.

    Sun et al. (2007), eq. 5: each vertex goes to the area mean of the planes through the
    centroids of its faces, here along one fixed line. ``held`` (n,) bool: those stay. All
    vertices move at once in each of ``passes`` passes.
    """
    position = xyz.copy()
    moved = xyz.copy()
    for _ in range(passes):
        for vertex in range(len(xyz)):
            if held[vertex]:
                continue
            step = 0.0
            total = 0.0
            for place in range(offsets[vertex], offsets[vertex + 1]):
                face = items[place]
                a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
                off = 0.0
                along = 0.0
                for axis in range(3):
                    centre = (position[a, axis] + position[b, axis] + position[c, axis]) / 3.0
                    off += normals[face, axis] * (centre - position[vertex, axis])
                    along += normals[face, axis] * directions[vertex, axis]
                step += areas[face] * off * along
                total += areas[face] * along * along
            if total > 0.0:
                step /= total
                for axis in range(3):
                    moved[vertex, axis] = position[vertex, axis] + step * directions[vertex, axis]
        position[:] = moved
    return position
