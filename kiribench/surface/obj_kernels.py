"""The compiled inner loops of the OBJ reader: count, then parse, one block of bytes at a time.

A block is a run of whole lines. Both loops keep their running totals in a small ``state``
array, so that a file of any size passes through one buffer of fixed size.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Slots of the state array shared by both loops.
VERTICES, UVS, TRIANGLES, COLOURED, BARE, LINE, ERROR, ERROR_LINE, ERROR_AT, ITEMS = range(10)
FACE_LINE = 10
STATE_SIZE = 11

# Values of state[ERROR].
(
    OK,
    BAD_NUMBER,
    FEW_COORDINATES,
    BAD_CORNER,
    OUT_OF_RANGE,
    FEW_CORNERS,
    MIXED_CORNERS,
    BINARY,
) = range(8)

_EXACT = 40  # powers of ten kept as an unevaluated sum of two doubles


def _powers_of_ten() -> NDArray[np.float64]:
    rows = []
    for exponent in range(-_EXACT, _EXACT + 1):
        exact = Fraction(10) ** exponent
        high = float(exact)
        rows.append((high, float(exact - Fraction(high))))
    return np.array(rows)


_TEN = _powers_of_ten()


@njit(cache=True, inline="always")
def _blank_end(buffer, at, size):  # type: ignore[no-untyped-def]
    """First position at or after ``at`` that is no blank; a continued line end is a blank."""
    while at < size:
        byte = buffer[at]
        if byte == 32 or byte == 9:
            at += 1
        elif byte == 92 and at + 1 < size and buffer[at + 1] == 10:
            at += 2
        elif byte == 92 and at + 2 < size and buffer[at + 1] == 13 and buffer[at + 2] == 10:
            at += 3
        else:
            break
    return at


@njit(cache=True, inline="always")
def _ends_line(buffer, at, size):  # type: ignore[no-untyped-def]
    """Whether a line's content ends here: its end, the block's end or a comment."""
    return at >= size or buffer[at] == 10 or buffer[at] == 13 or buffer[at] == 35


@njit(cache=True, inline="always")
def _ends_token(buffer, at, size):  # type: ignore[no-untyped-def]
    if at >= size:
        return True
    byte = buffer[at]
    return byte == 32 or byte == 9 or byte == 10 or byte == 13 or byte == 35 or byte == 92


@njit(cache=True)
def _line_end(buffer, at, size):  # type: ignore[no-untyped-def]
    """Position after the line's end and how many text lines that was (continuations)."""
    lines = 0
    while at < size:
        byte = buffer[at]
        if byte == 10:
            lines += 1
            continued = (at >= 1 and buffer[at - 1] == 92) or (
                at >= 2 and buffer[at - 1] == 13 and buffer[at - 2] == 92
            )
            at += 1
            if not continued:
                return at, lines
        elif byte == 13 and not (at + 1 < size and buffer[at + 1] == 10):
            return at + 1, lines + 1
        else:
            at += 1
    return at, lines + 1


@njit(cache=True)
def _scaled(mantissa, exponent):  # type: ignore[no-untyped-def]
    """``mantissa * 10**exponent``, correctly rounded but for ties closer than 1e-30.

    Below 2^53 and 10^22 one operation is exact (Clinger 1990, doi 10.1145/93542.93557);
    else the product is formed as an unevaluated sum of doubles (Dekker 1971,
    doi 10.1007/BF01397083).
    """
    if mantissa == 0:
        return 0.0
    if mantissa < np.uint64(9007199254740992):
        value = np.float64(mantissa)
        if 0 <= exponent <= 22:
            return value * _TEN[exponent + _EXACT, 0]
        if -22 <= exponent < 0:
            return value / _TEN[_EXACT - exponent, 0]
    if exponent < -_EXACT or exponent > _EXACT:
        value = np.float64(mantissa)
        while exponent > 300:
            value *= 1e300
            exponent -= 300
        while exponent < -300:
            value *= 1e-300
            exponent += 300
        return value * 10.0**exponent
    upper = mantissa >> np.uint64(32)
    lower = mantissa & np.uint64(0xFFFFFFFF)
    first, second = np.float64(upper) * 4294967296.0, np.float64(lower)
    high = first + second
    low = second - (high - first)
    ten, rest = _TEN[exponent + _EXACT, 0], _TEN[exponent + _EXACT, 1]
    split = 134217729.0 * high
    high_1 = split - (split - high)
    high_2 = high - high_1
    split = 134217729.0 * ten
    ten_1 = split - (split - ten)
    ten_2 = ten - ten_1
    product = high * ten
    error = ((high_1 * ten_1 - product) + high_1 * ten_2 + high_2 * ten_1) + high_2 * ten_2
    return product + (error + (high * rest + low * ten))


@njit(cache=True)
def _word(buffer, at, size):  # type: ignore[no-untyped-def]
    """``nan``, ``inf`` and the forms that C runtimes print; (value, end), end < 0 if none."""
    if at + 2 >= size:
        return 0.0, -1
    a, b, c = buffer[at] | 32, buffer[at + 1] | 32, buffer[at + 2] | 32
    value = np.nan
    if a == 105 and b == 110 and c == 102:
        value = np.inf
    elif not (a == 110 and b == 97 and c == 110):
        return 0.0, -1
    at += 3
    while not _ends_token(buffer, at, size):
        byte = buffer[at] | 32
        # infinity, nan(ind), nan(snan)
        if not (97 <= byte <= 122 or byte == 40 or byte == 41):
            return 0.0, -1
        at += 1
    return value, at


@njit(cache=True)
def _number(buffer, at, size):  # type: ignore[no-untyped-def]
    """The number at ``at``: (value, position after it), position -1 if malformed."""
    negative = False
    if buffer[at] == 45 or buffer[at] == 43:
        negative = buffer[at] == 45
        at += 1
    mantissa = np.uint64(0)
    digits = 0
    exponent = 0
    seen = False
    while at < size and 48 <= buffer[at] <= 57:
        seen = True
        if digits < 19:
            mantissa = mantissa * np.uint64(10) + np.uint64(buffer[at] - 48)
            if mantissa > 0:
                digits += 1
        else:
            exponent += 1
        at += 1
    if at < size and buffer[at] == 46:
        at += 1
        if seen and at < size and buffer[at] == 35:  # 1.#QNAN, -1.#IND, 1.#INF
            infinite = (
                at + 3 < size and (buffer[at + 2] | 32) == 110 and (buffer[at + 3] | 32) == 102
            )
            while at < size and not (
                buffer[at] == 32 or buffer[at] == 9 or buffer[at] == 10 or buffer[at] == 13
            ):
                at += 1
            if infinite:
                return (-np.inf if negative else np.inf), at
            return np.nan, at
        while at < size and 48 <= buffer[at] <= 57:
            seen = True
            if digits < 19:
                mantissa = mantissa * np.uint64(10) + np.uint64(buffer[at] - 48)
                if mantissa > 0:
                    digits += 1
                exponent -= 1
            at += 1
    if not seen:
        value, end = _word(buffer, at, size)
        return (-value if negative else value), end
    if at < size and (buffer[at] | 32) == 101:
        at += 1
        down = False
        if at < size and (buffer[at] == 45 or buffer[at] == 43):
            down = buffer[at] == 45
            at += 1
        power = 0
        start = at
        while at < size and 48 <= buffer[at] <= 57:
            if power < 100000:
                power = power * 10 + (buffer[at] - 48)
            at += 1
        if at == start:
            return 0.0, -1
        exponent += -power if down else power
    if not _ends_token(buffer, at, size):
        return 0.0, -1
    value = _scaled(mantissa, max(min(exponent, 5000), -5000))
    return (-value if negative else value), at


@njit(cache=True)
def _index(buffer, at, size):  # type: ignore[no-untyped-def]
    """The integer at ``at``: (value, position after it); the position is ``at`` if none."""
    start = at
    negative = False
    if at < size and (buffer[at] == 45 or buffer[at] == 43):
        negative = buffer[at] == 45
        at += 1
    first = at
    value = 0
    while at < size and 48 <= buffer[at] <= 57:
        if value < 1000000000000:
            value = value * 10 + (buffer[at] - 48)
        at += 1
    if at == first:
        return 0, start
    return (-value if negative else value), at


@njit(cache=True)
def count(buffer, size, state):  # type: ignore[no-untyped-def]
    """Add the block's vertices, texture coordinates and triangles to ``state``."""
    at = 0
    while at < size:
        at = _blank_end(buffer, at, size)
        if at >= size:
            break
        byte = buffer[at]
        following = buffer[at + 1] if at + 1 < size else 10
        blank = following == 32 or following == 9 or following == 92
        if byte == 0:
            state[ERROR] = BINARY
            state[ERROR_LINE] = state[LINE] + 1
            return
        if (byte == 118 or byte == 102) and blank:
            at += 1
            tokens = 0
            while True:
                at = _blank_end(buffer, at, size)
                if _ends_line(buffer, at, size):
                    break
                tokens += 1
                at += 1
                while not _ends_token(buffer, at, size):
                    at += 1
            if byte == 102:
                state[TRIANGLES] += max(tokens - 2, 0)
            else:
                state[VERTICES] += 1
                if tokens >= 6:
                    state[COLOURED] += 1
        elif byte == 118 and following == 116:
            state[UVS] += 1
        at, lines = _line_end(buffer, at, size)
        state[LINE] += lines


@njit(cache=True)
def _fail(state, code, line, at):  # type: ignore[no-untyped-def]
    state[ERROR] = code
    state[ERROR_LINE] = line
    state[ERROR_AT] = at


@njit(cache=True)
def parse(  # type: ignore[no-untyped-def]
    buffer, size, state, vertices, colours, uvs, faces, face_uvs
):
    """Parse the block into the arrays, from the totals in ``state`` onwards.

    vertices (n, 3) float64; colours (n or 0, 3) float32, left as they are where a vertex has
    none; uvs (k, 2) float64; faces (m, 3) int32; face_uvs (m or 0, 3) int32, -1 where none.
    """
    has_colours = len(colours) > 0
    has_uvs = len(face_uvs) > 0
    values = np.zeros(8)
    at = 0
    while at < size:
        at = _blank_end(buffer, at, size)
        if at >= size:
            break
        line = state[LINE] + 1
        byte = buffer[at]
        following = buffer[at + 1] if at + 1 < size else 10
        blank = following == 32 or following == 9 or following == 92 or following == 10
        blank = blank or following == 13
        texture = byte == 118 and following == 116
        if (byte == 118 and blank) or texture:
            at += 2 if texture else 1
            found = 0
            while True:
                at = _blank_end(buffer, at, size)
                if _ends_line(buffer, at, size):
                    break
                value, end = _number(buffer, at, size)
                if end < 0:
                    _fail(state, BAD_NUMBER, line, at)
                    return
                if found < 8:
                    values[found] = value
                found += 1
                at = end
            if found < (1 if texture else 3):
                _fail(state, FEW_COORDINATES, line, at)
                return
            if texture:
                row = state[UVS]
                uvs[row, 0] = values[0]
                uvs[row, 1] = values[1] if found > 1 else 0.0
                state[UVS] += 1
            else:
                row = state[VERTICES]
                for axis in range(3):
                    vertices[row, axis] = values[axis]
                if has_colours and found >= 6:
                    for axis in range(3):
                        colours[row, axis] = values[3 + axis]
                state[VERTICES] += 1
        elif byte == 102 and blank:
            at += 1
            corners = 0
            first = previous = first_uv = previous_uv = 0
            with_uv = False
            state[FACE_LINE] = line
            while True:
                at = _blank_end(buffer, at, size)
                if _ends_line(buffer, at, size):
                    break
                start = at
                vertex, at = _index(buffer, at, size)
                if at == start:
                    _fail(state, BAD_CORNER, line, start)
                    return
                uv = 0
                this_uv = False
                if at < size and buffer[at] == 47:
                    before = at + 1
                    uv, at = _index(buffer, before, size)
                    this_uv = at > before
                    if at < size and buffer[at] == 47:
                        before = at + 1
                        _, at = _index(buffer, before, size)
                if not _ends_token(buffer, at, size):
                    _fail(state, BAD_CORNER, line, start)
                    return
                if corners > 0 and this_uv != with_uv:
                    _fail(state, MIXED_CORNERS, line, start)
                    return
                with_uv = this_uv
                vertex = vertex - 1 if vertex > 0 else (
                    state[VERTICES] + vertex if vertex < 0 else -1
                )
                if vertex < 0 or vertex >= len(vertices):
                    _fail(state, OUT_OF_RANGE, line, start)
                    return
                if this_uv:
                    uv = uv - 1 if uv > 0 else (state[UVS] + uv if uv < 0 else -1)
                    if uv < 0 or uv >= len(uvs):
                        _fail(state, OUT_OF_RANGE, line, start)
                        return
                if corners == 0:
                    first, first_uv = vertex, uv
                elif corners >= 2:
                    row = state[TRIANGLES]
                    faces[row, 0] = first
                    faces[row, 1] = previous
                    faces[row, 2] = vertex
                    if has_uvs:
                        face_uvs[row, 0] = first_uv if with_uv else -1
                        face_uvs[row, 1] = previous_uv if with_uv else -1
                        face_uvs[row, 2] = uv if with_uv else -1
                    if not with_uv:
                        state[BARE] += 1
                    state[TRIANGLES] += 1
                previous, previous_uv = vertex, uv
                corners += 1
            if corners < 3:
                _fail(state, FEW_CORNERS, line, at)
                return
        if byte == 118 or byte == 102:
            state[ITEMS] = byte
        at, lines = _line_end(buffer, at, size)
        state[LINE] += lines
