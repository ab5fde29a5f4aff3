"""The compiled inner loop of the OBJ reader: parse one block of whole lines.

The running totals live in a small ``state`` array, so that a file of any size passes through
one buffer. Every block is followed by ``PADDING`` line ends, which spares the loops a test for
the block's end at every byte. Positions are unsigned, which spares numba its test for
negative indices.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from kiribench.surface.obj_state import (
    BAD_CORNER,
    BAD_NUMBER,
    BARE,
    BINARY,
    COLOURED,
    ERROR,
    ERROR_AT,
    ERROR_LINE,
    FACE_LINE,
    FEW_COORDINATES,
    FEW_CORNERS,
    FIRST_COLOURED,
    FORWARD,
    FORWARD_LINE,
    FORWARD_UV,
    FORWARD_UV_LINE,
    FULL,
    LAST_ITEM,
    LINE,
    MIXED_CORNERS,
    NAMES,
    OUT_OF_RANGE,
    TRIANGLES,
    UVS,
    VERTICES,
)
from kiribench.surface.obj_tokens import (
    ONE,
    TWO,
    blank_end,
    ends_line,
    ends_token,
    index_at,
    line_end,
    number_at,
)


@njit(cache=True)
def _fail(state, code, line, at):  # type: ignore[no-untyped-def]
    state[ERROR] = code
    state[ERROR_LINE] = line
    state[ERROR_AT] = at


@njit(cache=True)
def parse(  # type: ignore[no-untyped-def]
    buffer, start, stop, state, vertices, colours, uvs, faces, face_uvs
):
    """Parse the lines in ``buffer[start:stop]`` into the arrays, from ``state`` onwards.

    vertices (n, 3) float64; colours (n, 3) float32, NaN where a vertex has none, untouched
    before the first that has one; uvs (k, 2) float64; faces (m, 3) int32; face_uvs (m, 3)
    int32, -1 where none. An index may name what follows later in the file: the largest such
    is left in ``state``. Returns the position reached; ``state[ERROR]`` is FULL if that is
    short of ``stop`` because a line's content had no room.
    """
    at = np.uint64(start)
    size = np.uint64(stop)
    values = np.zeros(8)
    while True:
        at = blank_end(buffer, at, state)
        if at >= size:
            return at
        line = state[LINE] + 1
        line_start = at
        byte = buffer[at]
        following = buffer[at + ONE]
        blank = following <= 32 or following == 92
        texture = byte == 118 and following == 116
        if (byte == 118 and blank) or texture:
            at += TWO if texture else ONE
            found = 0
            while True:
                at = blank_end(buffer, at, state)
                if ends_line(buffer[at]):
                    break
                value, at, good = number_at(buffer, at)
                if not good:
                    _fail(state, BAD_NUMBER, line, at)
                    return at
                if found < 8:
                    values[found] = value
                found += 1
            if found < (1 if texture else 3):
                _fail(state, FEW_COORDINATES, line, at)
                return at
            if texture:
                row = state[UVS]
                if row >= len(uvs):
                    _fail(state, FULL, line, line_start)
                    return line_start
                uvs[row, 0] = values[0]
                uvs[row, 1] = values[1] if found > 1 else 0.0
                state[UVS] = row + 1
            else:
                row = state[VERTICES]
                if row >= len(vertices):
                    _fail(state, FULL, line, line_start)
                    return line_start
                vertices[row, 0] = values[0]
                vertices[row, 1] = values[1]
                vertices[row, 2] = values[2]
                if found >= 6:
                    if state[COLOURED] == 0:
                        state[FIRST_COLOURED] = row
                    state[COLOURED] += 1
                    colours[row, 0] = values[3]
                    colours[row, 1] = values[4]
                    colours[row, 2] = values[5]
                elif state[COLOURED] > 0:
                    colours[row, :] = np.nan
                state[VERTICES] = row + 1
                state[LAST_ITEM] = byte
        elif byte == 102 and blank:
            at += ONE
            corners = 0
            first = previous = first_uv = previous_uv = 0
            with_uv = False
            row = state[TRIANGLES]
            count, uv_count = state[VERTICES], state[UVS]
            while True:
                at = blank_end(buffer, at, state)
                if ends_line(buffer[at]):
                    break
                before = at
                vertex, at = index_at(buffer, at)
                if at == before:
                    _fail(state, BAD_CORNER, line, before)
                    return at
                uv = 0
                this_uv = False
                if buffer[at] == 47:
                    slash = at + ONE
                    uv, at = index_at(buffer, slash)
                    this_uv = at > slash
                    if buffer[at] == 47:
                        at += ONE
                        _, at = index_at(buffer, at)
                if not ends_token(buffer[at]):
                    _fail(state, BAD_CORNER, line, before)
                    return at
                if corners > 0 and this_uv != with_uv:
                    _fail(state, MIXED_CORNERS, line, before)
                    return at
                with_uv = this_uv
                vertex += count if vertex < 0 else -1
                if vertex < 0 or vertex > 2147483646:
                    _fail(state, OUT_OF_RANGE, line, before)
                    return at
                if vertex >= count and vertex > state[FORWARD]:
                    state[FORWARD] = vertex
                    state[FORWARD_LINE] = line
                if this_uv:
                    uv += uv_count if uv < 0 else -1
                    if uv < 0 or uv > 2147483646:
                        _fail(state, OUT_OF_RANGE, line, before)
                        return at
                    if uv >= uv_count and uv > state[FORWARD_UV]:
                        state[FORWARD_UV] = uv
                        state[FORWARD_UV_LINE] = line
                if corners == 0:
                    first, first_uv = vertex, uv
                elif corners >= 2:
                    if row >= len(faces):
                        _fail(state, FULL, line, line_start)
                        return line_start
                    faces[row, 0] = first
                    faces[row, 1] = previous
                    faces[row, 2] = vertex
                    face_uvs[row, 0] = first_uv if with_uv else -1
                    face_uvs[row, 1] = previous_uv if with_uv else -1
                    face_uvs[row, 2] = uv if with_uv else -1
                    row += 1
                previous, previous_uv = vertex, uv
                corners += 1
            if corners < 3:
                _fail(state, FEW_CORNERS, line, at)
                return at
            if not with_uv:
                state[BARE] += row - state[TRIANGLES]
            state[TRIANGLES] = row
            state[FACE_LINE] = line
            state[LAST_ITEM] = byte
        elif byte == 109 or byte == 117:  # mtllib, usemtl
            state[NAMES] = 1
        elif byte == 0:
            _fail(state, BINARY, line, at)
            return at
        at, lines = line_end(buffer, at, size)
        state[LINE] += lines
