"""How exactly a patch has to be put on: the offsets within which its grades hold.

Every direction (up, down, medial, lateral, turned either way, lower strap slipped) is followed
from the nominal pose. The corners between poses that were solved are interpolated, the share of
cells whose grade holds is read with the fast overlap, and where it falls through the limit the
worn model is solved again; so every limit that is reported was reached by a solve close to it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.grades import ROUNDING
from kiribench.conformability.result import FAIR_FROM, GOOD_FROM, GradeBy
from kiribench.fem.wear import WornPatch

FloatArray = NDArray[np.float64]

SCHEMA = "kiribench.placement/1"

#: Name of each direction -> what a unit of it does to the pose (offset (u, v) mm, turn, slip).
DIRECTIONS: dict[str, dict[str, Any]] = {
    "up": {"offset_mm": (0.0, -1.0)},
    "down": {"offset_mm": (0.0, 1.0)},
    "medial": {"offset_mm": (1.0, 0.0)},
    "lateral": {"offset_mm": (-1.0, 0.0)},
    "turned_medial": {"turn_deg": -1.0},
    "turned_lateral": {"turn_deg": 1.0},
    "strap_slip": {"strap_slip_mm": 1.0},
}
#: Beyond these (mm, degrees, mm) nobody calls it the same place: half a cell, and its turn.
FARTHEST_MM, FARTHEST_DEG, FARTHEST_SLIP_MM = 7.5, 8.0, 15.0
#: A limit is found when a solve lies so near to it.
NEAR = 0.1
SOLVES = 6


class PosedModel(Protocol):
    """Corner positions of one design in a pose."""

    def __call__(self, **pose: Any) -> WornPatch:
        """The patch put on with an offset, a turn or a slip."""
        ...


@dataclass(frozen=True)
class Tolerance:
    """How far one may go in one direction.

    Attributes:
        direction: of ``DIRECTIONS``. unit: ``mm`` or ``deg``.
        fair, good: largest amount at which the asked share of cells is still at least fair,
            good; 0 where it is not so in the nominal pose; the farthest that was tried where
            it never falls.
        fair_open, good_open: whether it is that farthest.
        solves: of the worn model in this direction.
    """

    direction: str
    unit: str
    fair: float
    good: float
    fair_open: bool
    good_open: bool
    solves: int


@dataclass(frozen=True, eq=False)
class Placement:
    """The tolerance of a design.

    Attributes:
        share: of the cells whose grade has to hold.
        definition: of the overlap.
        tolerances: in the order of ``DIRECTIONS``.
        nominal_fair, nominal_good: share of cells in the nominal pose.
        elements: of the mesh. cpu_seconds: of all.
    """

    share: float
    definition: GradeBy
    tolerances: tuple[Tolerance, ...]
    nominal_fair: float
    nominal_good: float
    elements: int
    cpu_seconds: float

    def of(self, direction: str) -> Tolerance:
        """The tolerance in one direction."""
        return next(one for one in self.tolerances if one.direction == direction)


def placement_of(
    solve: PosedModel,
    overlap: Callable[[FloatArray], FloatArray],
    *,
    elements: int,
    share: float = 0.9,
    definition: GradeBy = "paper",
) -> Placement:
    """Follow every direction until the grades fall.

    Args:
        solve: the worn model of the design.
        overlap: (R+1, C+1, 2) corners in skin coordinates to (R, C) overlaps; NaN does not count.
        elements: of the mesh, for the record.
        share: of the cells whose grade has to hold.
        definition: of ``overlap``, for the record.
    """
    began = time.process_time()
    nominal = solve().corner_q_mm

    def held(limit: float, corner: FloatArray) -> float:
        found = overlap(corner)
        known = found[np.isfinite(found)]
        return float((known >= limit - ROUNDING).mean()) if known.size else 0.0

    def holds(limit: float, corner: FloatArray) -> bool:
        return held(limit, corner) >= share

    found = []
    for name, unit_pose in DIRECTIONS.items():
        turned, slipped = "turn_deg" in unit_pose, "strap_slip_mm" in unit_pose
        farthest = FARTHEST_DEG if turned else FARTHEST_SLIP_MM if slipped else FARTHEST_MM
        path = PosePath(solve, unit_pose, nominal, farthest)
        fair, fair_open = path.last_where(partial(holds, FAIR_FROM))
        good, good_open = path.last_where(partial(holds, GOOD_FROM))
        unit = "deg" if turned else "mm"
        found.append(Tolerance(name, unit, fair, good, fair_open, good_open, path.solves))
    return Placement(
        share=share,
        definition=definition,
        tolerances=tuple(found),
        nominal_fair=held(FAIR_FROM, nominal),
        nominal_good=held(GOOD_FROM, nominal),
        elements=elements,
        cpu_seconds=time.process_time() - began,
    )


class PosePath:
    """Corners along one direction, by solves and interpolation between them."""

    def __init__(
        self, solve: PosedModel, unit_pose: dict[str, Any], nominal: FloatArray, farthest: float
    ) -> None:
        self._solve, self._unit, self._farthest = solve, unit_pose, farthest
        self._amount, self._corner = [0.0], [nominal]
        self.solves = 0

    def _pose(self, amount: float) -> dict[str, Any]:
        return {
            key: tuple(amount * part for part in value)
            if isinstance(value, tuple)
            else amount * value
            for key, value in self._unit.items()
        }

    def _add(self, amount: float) -> bool:
        """Solve one more pose; whether it has an equilibrium."""
        worn = self._solve(**self._pose(amount))
        self.solves += 1
        if worn.status != "ok":
            return False
        at = int(np.searchsorted(self._amount, amount))
        self._amount.insert(at, amount)
        self._corner.insert(at, worn.corner_q_mm)
        return True

    def corner(self, amount: float) -> FloatArray:
        """(R+1, C+1, 2) interpolated, or extrapolated from the last two."""
        if len(self._amount) == 1:
            return self._corner[0]
        at = int(np.clip(np.searchsorted(self._amount, amount), 1, len(self._amount) - 1))
        low, high = self._amount[at - 1], self._amount[at]
        part = (amount - low) / (high - low)
        return np.asarray((1 - part) * self._corner[at - 1] + part * self._corner[at])

    def last_where(self, holds: Callable[[FloatArray], bool]) -> tuple[float, bool]:
        """The largest amount up to which it holds, and whether it holds all the way."""
        if not holds(self._corner[0]):
            return 0.0, False
        if len(self._amount) == 1 and not self._add(0.2 * self._farthest):
            return 0.0, False
        found = 0.0
        for _ in range(SOLVES):
            found = self._crossing(holds)
            if min(abs(found - amount) for amount in self._amount[1:]) <= NEAR:
                break
            if not self._add(found):
                # No equilibrium there: what was solved last is as far as anybody knows.
                found = max(amount for amount in self._amount if amount < found)
                break
        return found, found >= self._farthest

    def _crossing(self, holds: Callable[[FloatArray], bool]) -> float:
        """First amount on a fine grid where it no longer holds, refined by bisection."""
        grid = np.linspace(0.0, self._farthest, 61)
        for low, high in pairwise(grid):
            if holds(self.corner(float(high))):
                continue
            inside, outside = float(low), float(high)
            for _ in range(8):
                middle = 0.5 * (inside + outside)
                if holds(self.corner(middle)):
                    inside = middle
                else:
                    outside = middle
            return inside
        return self._farthest


def placement_object(placement: Placement, *, participant: str, method: str) -> dict[str, Any]:
    """``placement.json``: limits for the asked share of good cells, and of at least fair ones."""

    def limits(name: str) -> dict[str, Any]:
        values = {one.direction: getattr(one, name) for one in placement.tolerances}
        return {
            "offsets_mm": {
                key: round(values[key], 2) for key in ("up", "down", "lateral", "medial")
            },
            "turn_deg": round(min(values["turned_medial"], values["turned_lateral"]), 2),
            "strap_slip_mm": round(values["strap_slip"], 2),
        }

    return {
        "schema": SCHEMA,
        "participant": participant,
        "method": method,
        "share": placement.share,
        "overlap": placement.definition,
        "grade": "good",
        **limits("good"),
        "fair": limits("fair"),
        "nominal": {"fair": placement.nominal_fair, "good": placement.nominal_good},
        "open": [
            f"{one.direction}: {grade}"
            for one in placement.tolerances
            for grade, is_open in (("fair", one.fair_open), ("good", one.good_open))
            if is_open
        ],
        "elements_per_facet": placement.elements,
        "note": "Predicted by simulation, one error at a time, in mm on the skin as drawn; not "
        "measured on a person.",
    }


def placement_text(placement: Placement) -> str:
    """One sentence a grade."""

    def words(name: str) -> str:
        parts = []
        for one in placement.tolerances:
            value, is_open = getattr(one, name), getattr(one, f"{name}_open")
            unit = "°" if one.unit == "deg" else " mm"
            more = "over " if is_open else ""
            parts.append(f"{one.direction.replace('_', ' ')} {more}{value:.1f}{unit}")
        return ", ".join(parts)

    share = f"{100 * placement.share:g} % of the cells"
    return (
        f"Put on within {words('good')}, {share} stay good; "
        f"within {words('fair')}, {share} stay at least fair (one error at a time)."
    )
