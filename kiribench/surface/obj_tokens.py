"""The compiled tokens of an OBJ file: blanks, line ends, numbers, indices.

Positions are unsigned, which spares numba its test for negative indices.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numba import njit
from numpy.typing import NDArray

from kiribench.surface.obj_state import LINE

_EXACT = 40  # powers of ten kept as an unevaluated sum of two doubles


def _powers_of_ten() -> NDArray[np.float64]:
    rows = []
    for exponent in range(-_EXACT, _EXACT + 1):
        exact = Fraction(10) ** exponent
        high = float(exact)
        rows.append((high, float(exact - Fraction(high))))
    return np.array(rows)


_TEN = _powers_of_ten()
ONE = np.uint64(1)
TWO = np.uint64(2)
_3 = np.uint64(3)
_10 = np.uint64(10)
_DIGIT = np.uint64(48)
_MANTISSA = np.uint64(1 << 53)
_LARGEST = 1 << 40


@njit(cache=True)
def blank_end(buffer, at, state):  # type: ignore[no-untyped-def]
    """First position from ``at`` on that is no blank; a continued line end is a blank."""
    while True:
        byte = buffer[at]
        if byte == 32 or byte == 9:
            at += ONE
        elif byte != 92:
            return at
        elif buffer[at + ONE] == 13 and buffer[at + TWO] == 10:
            at += _3
            state[LINE] += 1
        elif buffer[at + ONE] == 10 or buffer[at + ONE] == 13:
            at += TWO
            state[LINE] += 1
        else:
            return at


@njit(cache=True)
def ends_line(byte):  # type: ignore[no-untyped-def]
    """Whether a line's content ends at this byte: a line end or a comment."""
    return byte == 10 or byte == 13 or byte == 35


@njit(cache=True)
def ends_token(byte):  # type: ignore[no-untyped-def]
    """Whether a token ends at this byte.

    Blanks, line ends and comments, and also control characters, '!' and '"', which then
    fail as the start of a token.
    """
    return byte <= 35 or byte == 92


@njit(cache=True)
def line_end(buffer, at, size):  # type: ignore[no-untyped-def]
    """Position after the line's end, and how many text lines that was (continuations)."""
    lines = 0
    while True:
        byte = buffer[at]
        if byte > 13:
            at += ONE
        elif byte == 10:
            lines += 1
            at += ONE
            if at >= size:
                return at, lines
            continued = at >= TWO and buffer[at - TWO] == 92
            continued |= at >= _3 and buffer[at - TWO] == 13 and buffer[at - _3] == 92
            if not continued:
                return at, lines
        elif byte == 13 and buffer[at + ONE] != 10:
            lines += 1
            at += ONE
            if at >= size or not (at >= TWO and buffer[at - TWO] == 92):
                return at, lines
        else:
            at += ONE


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
    if buffer[at] == 49 and buffer[at + ONE] == 46 and buffer[at + TWO] == 35:
        at += _3
    a, b, c = buffer[at] | 32, buffer[at + ONE] | 32, buffer[at + TWO] | 32
    value = np.nan
    if a == 105 and b == 110 and c == 102:
        value = np.inf
    elif not (a == 110 and b == 97 and c == 110) and start == at:
        return 0.0, start, False
    while not ends_token(buffer[at]):
        letter = buffer[at] | 32
        # nan(ind), infinity, 1.#QNAN, 1.#INF00
        if not (97 <= letter <= 122 or letter == 40 or letter == 41 or letter == 48):
            return 0.0, start, False
        at += ONE
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
        at += ONE


@njit(cache=True)
def number_at(buffer, at):  # type: ignore[no-untyped-def]
    """The number at ``at``: (value, position after it, whether it is one)."""
    start = at
    negative = buffer[at] == 45
    if negative or buffer[at] == 43:
        at += ONE
    first = at
    mantissa = np.uint64(0)
    digit = np.uint64(buffer[at]) - _DIGIT
    while digit < _10:
        mantissa = mantissa * _10 + digit
        at += ONE
        digit = np.uint64(buffer[at]) - _DIGIT
    figures = at - first
    exponent = np.int64(0)
    if buffer[at] == 46:
        at += ONE
        point = at
        digit = np.uint64(buffer[at]) - _DIGIT
        while digit < _10:
            mantissa = mantissa * _10 + digit
            at += ONE
            digit = np.uint64(buffer[at]) - _DIGIT
        exponent -= np.int64(at - point)
        figures += at - point
    if figures == 0 or (buffer[at] == 35 and buffer[at - ONE] == 46):
        value, at, good = _word(buffer, first)
        return (-value if negative else value), at, good
    if figures > 19:
        mantissa, exponent, at = _long_digits(buffer, first)
    if buffer[at] | 32 == 101:
        at += ONE
        down = buffer[at] == 45
        if down or buffer[at] == 43:
            at += ONE
        power = np.int64(0)
        before = at
        while 48 <= buffer[at] <= 57:
            if power < 100000:
                power = power * 10 + np.int64(buffer[at]) - 48
            at += ONE
        if at == before:
            return 0.0, start, False
        exponent += -power if down else power
    if not ends_token(buffer[at]):
        return 0.0, start, False
    value = _scaled(mantissa, max(min(exponent, 5000), -5000))
    return (-value if negative else value), at, True


@njit(cache=True)
def index_at(buffer, at):  # type: ignore[no-untyped-def]
    """The integer at ``at``: (value, position after it); the position is ``at`` if none."""
    start = at
    negative = buffer[at] == 45
    if negative or buffer[at] == 43:
        at += ONE
    first = at
    value = np.int64(0)
    digit = np.uint64(buffer[at]) - _DIGIT
    while digit < _10:
        value = value * 10 + np.int64(digit)
        at += ONE
        digit = np.uint64(buffer[at]) - _DIGIT
    if at == first:
        return 0, start
    if at - first > _10:
        value = np.int64(_LARGEST)
    return (-value if negative else value), at
