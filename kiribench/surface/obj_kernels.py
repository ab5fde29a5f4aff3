"""The compiled inner loop of the OBJ reader: parse one block of whole lines.

The running totals live in a small ``state`` array, so that a file of any size passes through
one buffer. Every block is followed by ``PADDING`` line ends, which spares the loops a test for
the block's end at every byte. Positions are unsigned, which spares numba its test for
negative indices.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Slots of the state array.
(
    VERTICES,
    UVS,
    TRIANGLES,
    COLOURED,
    FIRST_COLOURED,
    BARE,
    LINE,
    ERROR,
    ERROR_LINE,
    ERROR_AT,
    LAST_ITEM,
    FACE_LINE,
    NAMES,
    FORWARD,
    FORWARD_LINE,
    FORWARD_UV,
    FORWARD_UV_LINE,
    STATE_SIZE,
) = range(18)

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
    FULL,
) = range(9)

PADDING = 64

_EXACT = 40  # powers of ten kept as an unevaluated sum of two doubles


def _powers_of_ten() -> NDArray[np.float64]:
    rows = []
    for exponent in range(-_EXACT, _EXACT + 1):
        exact = Fraction(10) ** exponent
        high = float(exact)
        rows.append((high, float(exact - Fraction(high))))
    return np.array(rows)


_TEN = _powers_of_ten()
_1 = np.uint64(1)
_2 = np.uint64(2)
_3 = np.uint64(3)
_10 = np.uint64(10)
_DIGIT = np.uint64(48)
_MANTISSA = np.uint64(1 << 53)
_LARGEST = 1 << 40


@njit(cache=True)
def _blank_end(buffer, at, state):  # type: ignore[no-untyped-def]
    """First position from ``at`` on that is no blank; a continued line end is a blank."""
    while True:
        byte = buffer[at]
        if byte == 32 or byte == 9:
            at += _1
        elif byte != 92:
            return at
        elif buffer[at + _1] == 13 and buffer[at + _2] == 10:
            at += _3
            state[LINE] += 1
        elif buffer[at + _1] == 10 or buffer[at + _1] == 13:
            at += _2
            state[LINE] += 1
        else:
            return at


@njit(cache=True)
def _ends_line(byte):  # type: ignore[no-untyped-def]
    """Whether a line's content ends at this byte: a line end or a comment."""
    return byte == 10 or byte == 13 or byte == 35


@njit(cache=True)
def _ends_token(byte):  # type: ignore[no-untyped-def]
    # Blanks, line ends and comments, and also control characters, '!' and '"', which then
    # fail as the start of a token.
    return byte <= 35 or byte == 92


@njit(cache=True)
def _line_end(buffer, at, size):  # type: ignore[no-untyped-def]
    """Position after the line's end, and how many text lines that was (continuations)."""
    lines = 0
    while True:
        byte = buffer[at]
        if byte > 13:
            at += _1
        elif byte == 10:
            lines += 1
            at += _1
            if at >= size:
                return at, lines
            continued = at >= _2 and buffer[at - _2] == 92
            continued |= at >= _3 and buffer[at - _2] == 13 and buffer[at - _3] == 92
            if not continued:
                return at, lines
        elif byte == 13 and buffer[at + _1] != 10:
            lines += 1
            at += _1
            if at >= size or not (at >= _2 and buffer[at - _2] == 92):
                return at, lines
        else:
            at += _1


@njit(cache=True)
def _scaled(mantissa, exponent):  # type: ignore[no-untyped-def]
    """``mantissa * 10**exponent``, correctly rounded but for ties closer than 1e-30.

    Below 2^53 and 10^22 one operation is exact (Clinger 1990, doi 10.1145/93542.93557);
    else the product is formed as an unevaluated sum of doubles (Dekker 1971,
    doi 10.1007/BF01397083).
    """
    if mantissa < _MANTISSA:
        value = np.float64(mantissa)
        if -22 <= exponent <= 0:
            return value / _TEN[_EXACT - exponent, 0]
        if 0 < exponent <= 22:
            return value * _TEN[exponent + _EXACT, 0]
        if mantissa == 0:
            return 0.0
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
def _word(buffer, at):  # type: ignore[no-untyped-def]
    """``nan``, ``inf``, ``1.#IND`` and their kin: (value, position after it, whether it is)."""
    start = at
    if buffer[at] == 49 and buffer[at + _1] == 46 and buffer[at + _2] == 35:
        at += _3
    a, b, c = buffer[at] | 32, buffer[at + _1] | 32, buffer[at + _2] | 32
    value = np.nan
    if a == 105 and b == 110 and c == 102:
        value = np.inf
    elif not (a == 110 and b == 97 and c == 110) and start == at:
        return 0.0, start, False
    while not _ends_token(buffer[at]):
        letter = buffer[at] | 32
        # nan(ind), infinity, 1.#QNAN, 1.#INF00
        if not (97 <= letter <= 122 or letter == 40 or letter == 41 or letter == 48):
            return 0.0, start, False
        at += _1
    return value, at, True


@njit(cache=True)
def _long_digits(buffer, at):  # type: ignore[no-untyped-def]
    """A run of digits (and a point) of any length: 19 figures, exponent, position after it."""
    mantissa = np.uint64(0)
    figures = 0
    exponent = 0
    point = False
    while True:
        byte = buffer[at]
        if byte == 46 and not point:
            point = True
        elif 48 <= byte <= 57:
            if figures < 19:
                mantissa = mantissa * _10 + (np.uint64(byte) - _DIGIT)
                if mantissa > 0:
                    figures += 1
                if point:
                    exponent -= 1
            elif not point:
                exponent += 1
        else:
            return mantissa, exponent, at
        at += _1


@njit(cache=True)
def _number(buffer, at):  # type: ignore[no-untyped-def]
    """The number at ``at``: (value, position after it, whether it is one)."""
    start = at
    negative = buffer[at] == 45
    if negative or buffer[at] == 43:
        at += _1
    first = at
    mantissa = np.uint64(0)
    digit = np.uint64(buffer[at]) - _DIGIT
    while digit < _10:
        mantissa = mantissa * _10 + digit
        at += _1
        digit = np.uint64(buffer[at]) - _DIGIT
    figures = at - first
    exponent = np.int64(0)
    if buffer[at] == 46:
        at += _1
        point = at
        digit = np.uint64(buffer[at]) - _DIGIT
        while digit < _10:
            mantissa = mantissa * _10 + digit
            at += _1
            digit = np.uint64(buffer[at]) - _DIGIT
        exponent -= np.int64(at - point)
        figures += at - point
    if figures == 0 or (buffer[at] == 35 and buffer[at - _1] == 46):
        value, at, good = _word(buffer, first)
        return (-value if negative else value), at, good
    if figures > 19:
        mantissa, exponent, at = _long_digits(buffer, first)
    if buffer[at] | 32 == 101:
        at += _1
        down = buffer[at] == 45
        if down or buffer[at] == 43:
            at += _1
        power = np.int64(0)
        before = at
        while 48 <= buffer[at] <= 57:
            if power < 100000:
                power = power * 10 + np.int64(buffer[at]) - 48
            at += _1
        if at == before:
            return 0.0, start, False
        exponent += -power if down else power
    if not _ends_token(buffer[at]):
        return 0.0, start, False
    value = _scaled(mantissa, max(min(exponent, 5000), -5000))
    return (-value if negative else value), at, True


@njit(cache=True)
def _index(buffer, at):  # type: ignore[no-untyped-def]
    """The integer at ``at``: (value, position after it); the position is ``at`` if none."""
    start = at
    negative = buffer[at] == 45
    if negative or buffer[at] == 43:
        at += _1
    first = at
    value = np.int64(0)
    digit = np.uint64(buffer[at]) - _DIGIT
    while digit < _10:
        value = value * 10 + np.int64(digit)
        at += _1
        digit = np.uint64(buffer[at]) - _DIGIT
    if at == first:
        return 0, start
    if at - first > _10:
        value = np.int64(_LARGEST)
    return (-value if negative else value), at


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
        at = _blank_end(buffer, at, state)
        if at >= size:
            return at
        line = state[LINE] + 1
        line_start = at
        byte = buffer[at]
        following = buffer[at + _1]
        blank = following <= 32 or following == 92
        texture = byte == 118 and following == 116
        if (byte == 118 and blank) or texture:
            at += _2 if texture else _1
            found = 0
            while True:
                at = _blank_end(buffer, at, state)
                if _ends_line(buffer[at]):
                    break
                value, at, good = _number(buffer, at)
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
            at += _1
            corners = 0
            first = previous = first_uv = previous_uv = 0
            with_uv = False
            row = state[TRIANGLES]
            count, uv_count = state[VERTICES], state[UVS]
            while True:
                at = _blank_end(buffer, at, state)
                if _ends_line(buffer[at]):
                    break
                before = at
                vertex, at = _index(buffer, at)
                if at == before:
                    _fail(state, BAD_CORNER, line, before)
                    return at
                uv = 0
                this_uv = False
                if buffer[at] == 47:
                    slash = at + _1
                    uv, at = _index(buffer, slash)
                    this_uv = at > slash
                    if buffer[at] == 47:
                        at += _1
                        _, at = _index(buffer, at)
                if not _ends_token(buffer[at]):
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
        at, lines = _line_end(buffer, at, size)
        state[LINE] += lines
