"""The order of work: a short way for the head through strokes that may be begun at either end.

The travel is what the head moves with the beam off. Finding the shortest is a travelling-salesman
problem whose towns have two gates each. Nearest neighbour gives a start; it is improved by 2-opt
and by moving chains of up to three strokes, either way round (Or 1976), over the nearest ends
only, and then by iterated local search with local double bridges (Johnson & McGeoch 1997). The
numbers drawn depend on nothing but the strokes: the same strokes give the same order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import cKDTree

from kiribench.fabrication.strokes import FloatArray, Stroke

IntArray = npt.NDArray[np.int64]

_NEIGHBOURS = 10
_KICKS_A_STROKE = 50
"""Length of the search: double bridges a stroke, ..."""
_WORK = 4_000_000
"""... and at most this many double bridges x strokes."""


@dataclass(frozen=True, eq=False)
class Route:
    """An order of k strokes.

    Attributes:
        order: (k,) indices of the strokes.
        turned: (k,) whether the stroke is drawn from its second end, in the same order.
        travel_mm: way with the beam off, from the starting point on, mm.
    """

    order: IntArray
    turned: npt.NDArray[np.bool_]
    travel_mm: float


def shortest_route(ends_mm: FloatArray, start_mm: Sequence[float] | FloatArray) -> Route:
    """A short route through strokes given by their ends, from a point to anywhere.

    Args:
        ends_mm: (k, 2, 2) first and last point of each stroke.
        start_mm: (2,) where the head comes from.
    """
    count = len(ends_mm)
    if count == 0:
        return Route(np.zeros(0, np.int64), np.zeros(0, bool), 0.0)
    points = np.concatenate(
        [np.asarray(ends_mm, np.float64).reshape(-1, 2), np.asarray(start_mm, np.float64)[None]]
    )
    tour = _nearest_first(points)
    if count > 2:
        near = _neighbours(points[:-1])
        kicks = max(200, min(_KICKS_A_STROKE * count, _WORK // count))
        tour = _search(points, near, tour, kicks)
    travel = float(_length(points, tour))
    return Route(tour >> 1, (tour & 1).astype(bool), travel)


def in_order(strokes: Sequence[Stroke], start_mm: FloatArray) -> list[Stroke]:
    """The strokes in a short order, turned where that is shorter, closed ones begun nearby."""
    if not strokes:
        return []
    ends = np.array([stroke.ends_mm for stroke in strokes])
    route = shortest_route(ends, start_mm)
    ordered = []
    at = np.asarray(start_mm, np.float64)
    for index, turned in zip(route.order, route.turned, strict=True):
        stroke = strokes[index]
        if stroke.closed:
            nearest = int(np.argmin(np.linalg.norm(stroke.points_mm - at, axis=1)))
            stroke = stroke.started_at(nearest)
        elif turned:
            stroke = stroke.reversed()
        ordered.append(stroke)
        at = stroke.ends_mm[1]
    return ordered


def travel_mm(strokes: Sequence[Stroke], start_mm: Sequence[float] | FloatArray) -> float:
    """Way of the head with the beam off through ``strokes`` as they stand, mm."""
    at = np.asarray(start_mm, np.float64)
    total = 0.0
    for stroke in strokes:
        first, last = stroke.ends_mm
        total += float(np.hypot(*(first - at)))
        at = last
    return total


def _nearest_first(points: FloatArray) -> IntArray:
    """The greedy route, as indices of the points where strokes are begun."""
    count = (len(points) - 1) // 2
    free = np.ones(2 * count, bool)
    at = points[-1]
    tour = np.zeros(count, np.int64)
    for k in range(count):
        distance = np.where(free, np.hypot(*(points[:-1] - at).T), np.inf)
        begin = int(np.argmin(distance))
        tour[k] = begin
        free[begin] = free[begin ^ 1] = False
        at = points[begin ^ 1]
    return tour


def _neighbours(points: FloatArray) -> IntArray:
    """(n, m) the nearest other points of each point, its stroke's other end left out."""
    wanted = min(_NEIGHBOURS + 2, len(points))
    _, found = cKDTree(points).query(points, k=wanted)
    own = np.arange(len(points))[:, None]
    foreign = (found >> 1) != (own >> 1)
    # The foreign ones first, in the order of distance; the others repeat the first foreign one.
    order = np.argsort(~foreign, axis=1, kind="stable")
    sorted_ = np.take_along_axis(found, order, axis=1)
    kept = np.take_along_axis(foreign, order, axis=1)
    return np.where(kept, sorted_, sorted_[:, :1])[:, :_NEIGHBOURS].astype(np.int64)


@njit(cache=True)
def _gap(points, a, b):  # type: ignore[no-untyped-def]
    dx, dy = points[a, 0] - points[b, 0], points[a, 1] - points[b, 1]
    return (dx * dx + dy * dy) ** 0.5


@njit(cache=True)
def _length(points, tour):  # type: ignore[no-untyped-def]
    at = len(points) - 1
    total = 0.0
    for begin in tour:
        total += _gap(points, at, begin)
        at = begin ^ 1
    return total


@njit(cache=True)
def _turn(tour, pos, i, j):  # type: ignore[no-untyped-def]
    """Draw the strokes at i..j in the opposite order, each from its other end."""
    while i < j:
        a, b = tour[i] ^ 1, tour[j] ^ 1
        tour[i], tour[j] = b, a
        pos[b >> 1], pos[a >> 1] = i, j
        i += 1
        j -= 1
    if i == j:
        tour[i] ^= 1


@njit(cache=True)
def _carry(tour, pos, i, k, g):  # type: ignore[no-untyped-def]
    """Move the strokes at i..k (at most three) into the gap before g."""
    held = tour[i : k + 1].copy()
    n = k - i + 1
    if g > k:
        for m in range(k + 1, g):
            tour[m - n] = tour[m]
            pos[tour[m] >> 1] = m - n
        first = g - n
    else:
        for m in range(i - 1, g - 1, -1):
            tour[m + n] = tour[m]
            pos[tour[m] >> 1] = m + n
        first = g
    for m in range(n):
        tour[first + m] = held[m]
        pos[held[m] >> 1] = first + m
    return first


@njit(cache=True)
def _best_move(points, near, tour, pos, p):  # type: ignore[no-untyped-def]
    """One improving move at the end ``p``: (gain, kind, i, k, g); kind 0 means none."""
    n, home = len(tour), len(points) - 1
    i = pos[p >> 1]
    entry = tour[i] == p
    if not entry and i == n - 1:
        return 0.0, 0, 0, 0, 0
    mate = (tour[i - 1] ^ 1 if i > 0 else home) if entry else tour[i + 1]
    base = _gap(points, p, mate)
    best, kind, bi, bk, bg = 1e-9, 0, 0, 0, 0
    for q in near[p]:
        dq = _gap(points, p, q)
        if dq >= base:
            break
        j = pos[q >> 1]
        q_entry = tour[j] == q
        before_j = tour[j - 1] ^ 1 if j > 0 else home
        if q_entry == entry:
            if entry:
                lo, hi = min(i, j), max(i, j)
                gain = base + _gap(points, before_j, q) - dq - _gap(points, mate, before_j)
                if gain > best:
                    best, kind, bi, bk, bg = gain, 1, lo, hi - 1, 0
            else:
                lo, hi = min(i, j) + 1, max(i, j)
                gain = base - dq
                if j + 1 < n:
                    gain += _gap(points, q, tour[j + 1]) - _gap(points, mate, tour[j + 1])
                if gain > best:
                    best, kind, bi, bk, bg = gain, 1, lo, hi, 0
        for size in range(1, 4):
            first = i if entry else i - size + 1
            last = first + size - 1
            if first < 0 or last >= n:
                break
            # The chain's end p is to touch q; tail is the chain's other end.
            tail = tour[last] ^ 1 if entry else tour[first]
            other = tour[j + 1] if j + 1 < n else -1
            g = j if q_entry else j + 1
            if first <= j <= last or first <= g <= last + 1:
                continue
            left = tour[first - 1] ^ 1 if first > 0 else home
            gain = _gap(points, left, tour[first])
            if last + 1 < n:
                right = tour[last + 1]
                gain += _gap(points, tour[last] ^ 1, right) - _gap(points, left, right)
            if q_entry:
                gain += _gap(points, before_j, q) - dq - _gap(points, before_j, tail)
            else:
                gain -= dq
                if other >= 0:
                    gain += _gap(points, q, other) - _gap(points, tail, other)
            if gain > best:
                # The chain is turned where two beginnings or two endings meet.
                best, kind, bi, bk, bg = gain, 3 if q_entry == entry else 2, first, last, g
    return best, kind, bi, bk, bg


@njit(cache=True)
def _push(stack, waiting, top, tour, i):  # type: ignore[no-untyped-def]
    """Put both ends of the stroke at position i on the list of ends to look at."""
    if 0 <= i < len(tour):
        for p in (tour[i], tour[i] ^ 1):
            if not waiting[p]:
                waiting[p] = True
                stack[top] = p
                top += 1
    return top


@njit(cache=True)
def _improve(points, near, tour, pos, stack, waiting, top):  # type: ignore[no-untyped-def]
    """Improving moves until no end on the list has one; the length gained."""
    gained = 0.0
    while top > 0:
        top -= 1
        p = stack[top]
        waiting[p] = False
        while True:
            gain, kind, i, k, g = _best_move(points, near, tour, pos, p)
            if kind == 0:
                break
            gained += gain
            if kind == 1:
                _turn(tour, pos, i, k)
            else:
                if kind == 3:
                    _turn(tour, pos, i, k)
                first = _carry(tour, pos, i, k, g)
                hole = i if g > k else k + 1
                for m in (first - 1, first, first + k - i, first + k - i + 1, hole - 1, hole):
                    top = _push(stack, waiting, top, tour, m)
            for m in (i - 1, i, k, k + 1):
                top = _push(stack, waiting, top, tour, m)
    return gained


@njit(cache=True)
def _search(points, near, begin, kicks):  # type: ignore[no-untyped-def]
    """Iterated local search from the tour ``begin``."""
    n = len(begin)
    tour, pos = begin.copy(), np.zeros(n, np.int64)
    stack, waiting = np.zeros(2 * n, np.int64), np.zeros(2 * n, np.bool_)
    top = 0
    for i in range(n):
        pos[tour[i] >> 1] = i
        top = _push(stack, waiting, top, tour, i)
    _improve(points, near, tour, pos, stack, waiting, top)
    if n < 3:
        return tour
    kept, kept_pos = tour.copy(), pos.copy()
    random = np.uint64(88172645463325252)
    longest = max(1, min(50, (n - 1) // 3))
    draws = np.zeros(3, np.int64)
    home = len(points) - 1
    for _ in range(kicks):
        for m in range(3):  # xorshift64 (Marsaglia 2003)
            random ^= random << np.uint64(13)
            random ^= random >> np.uint64(7)
            random ^= random << np.uint64(17)
            draws[m] = np.int64(random >> np.uint64(33))
        size_a, size_b = 1 + draws[0] % longest, 1 + draws[1] % longest
        a = draws[2] % (n - size_a - size_b + 1)
        b, c = a + size_a, a + size_a + size_b
        left = tour[a - 1] ^ 1 if a > 0 else home
        change = (
            _gap(points, left, tour[b])
            + _gap(points, tour[c - 1] ^ 1, tour[a])
            - _gap(points, left, tour[a])
            - _gap(points, tour[b - 1] ^ 1, tour[b])
        )
        if c < n:
            change += _gap(points, tour[b - 1] ^ 1, tour[c])
            change -= _gap(points, tour[c - 1] ^ 1, tour[c])
        held = tour[a:b].copy()
        for m in range(b, c):
            tour[m - size_a] = tour[m]
        for m in range(size_a):
            tour[a + size_b + m] = held[m]
        for m in range(a, c):
            pos[tour[m] >> 1] = m
        top = 0
        for m in (a - 1, a, a + size_b - 1, a + size_b, c - 1, c):
            top = _push(stack, waiting, top, tour, m)
        change -= _improve(points, near, tour, pos, stack, waiting, top)
        if change <= 1e-9:
            kept[:] = tour
            kept_pos[:] = pos
        else:
            tour[:] = kept
            pos[:] = kept_pos
    return tour
