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
def filter_normals(  # type: ignore[no-untyped-def]
    normals, guide, centres, areas, faces, offsets, items, range_scale, space_mm
):
    """One pass of joint bilateral filtering of face normals over vertex-sharing faces.

    normals, guide, centres (m, 3); areas (m,); a weight is area x Gaussian of the distance of
    centres (``space_mm``) x Gaussian of the difference of guide normals (``range_scale``).
    """
    out = np.empty_like(normals)
    per_space = 0.5 / (space_mm * space_mm)
    per_range = 0.5 / (range_scale * range_scale)
    for face in range(len(faces)):
        x = areas[face] * normals[face, 0]
        y = areas[face] * normals[face, 1]
        z = areas[face] * normals[face, 2]
        first, second = faces[face, 0], faces[face, 1]
        for corner in range(3):
            vertex = faces[face, corner]
            for place in range(offsets[vertex], offsets[vertex + 1]):
                other = items[place]
                if other == face:
                    continue
                a, b, c = faces[other, 0], faces[other, 1], faces[other, 2]
                if corner > 0 and (a == first or b == first or c == first):
                    continue
                if corner > 1 and (a == second or b == second or c == second):
                    continue
                apart = 0.0
                turned = 0.0
                for axis in range(3):
                    apart += (centres[other, axis] - centres[face, axis]) ** 2
                    turned += (guide[other, axis] - guide[face, axis]) ** 2
                weight = areas[other] * np.exp(-apart * per_space - turned * per_range)
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
                    moved[vertex, axis] = (
                        position[vertex, axis] + step * directions[vertex, axis]
                    )
        position[:] = moved
    return position
