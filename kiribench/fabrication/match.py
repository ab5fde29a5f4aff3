"""Slits that were found, against the slits that were expected."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from shapely import LineString

from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.findings import Findings
from kiribench.fabrication.sheet import CleanSlits
from kiribench.fabrication.strokes import FloatArray


def slit_faults(slits: CleanSlits, found: Findings) -> None:
    """Doubles, overlaps and slits in pieces."""
    for code, places, what in (
        ("slit-duplicate", slits.twice, "slits are there twice: the beam would pass twice"),
        ("slit-overlap", slits.overlapping, "slits in one line cover each other in part"),
    ):
        if len(places):
            found.error(
                code,
                f"{len(places)} {what}.",
                "Delete the doubles.",
                f"around ({places[0][0]:.2f}, {places[0][1]:.2f}) mm",
            )
    if slits.split:
        found.warning(
            "slit-split",
            f"{slits.split} slits are drawn in several pieces: the beam stops within them.",
            "Join the pieces, or accept the stops.",
        )


def match_slits(
    slits: CleanSlits, expected: Drawing, tolerance_mm: float, found: Findings
) -> tuple[int, float]:
    """Find every expected slit among the slits; the number found and the largest error, mm."""
    wanted = np.array([s.points_mm[[0, -1]] for s in expected.of("slit", "tile")])
    wanted = wanted.reshape(-1, 2, 2)
    lines = slits.ends_mm
    if len(lines) == 0:
        if len(wanted):
            found.error("slit-missing", f"All {len(wanted)} slits are missing.", "Export them too.")
        return 0, 0.0
    free = np.ones(len(lines), bool)
    tree = cKDTree(lines.mean(axis=1))
    matched, worst = 0, 0.0
    open_slits = []
    for slit in wanted:
        best, error = -1, np.inf
        for k in tree.query_ball_point(slit.mean(axis=0), 2 * tolerance_mm + 1e-9):
            if not free[k]:
                continue
            off = min(_off(lines[k], slit), _off(lines[k][::-1], slit))
            if off < error:
                best, error = int(k), off
        # svgelements counts 25.39999 mm an inch: 1e-6 of the distances within a drawing.
        if best >= 0 and error <= tolerance_mm + 1e-6 * expected.height_mm:
            free[best] = False
            matched += 1
            worst = max(worst, error)
        else:
            open_slits.append(slit)
    _explain(open_slits, lines[free], found)
    return matched, worst


def _off(one: FloatArray, two: FloatArray) -> float:
    return float(np.max(np.linalg.norm(one - two, axis=1)))


def _explain(missing: list[FloatArray], extra: FloatArray, found: Findings) -> None:
    """Say what became of the slits that were not found, and what the unknown ones are."""
    lines = [LineString(pair) for pair in extra]
    owner: dict[int, list[FloatArray]] = {}
    gone = []
    for slit in missing:
        own = LineString(slit)
        cover = [
            k
            for k, line in enumerate(lines)
            if own.length > 0 and own.intersection(line.buffer(0.05)).length > 0.25 * own.length
        ]
        if cover:
            owner.setdefault(cover[0], []).append(slit)
        else:
            gone.append(slit)
    closed = {k: members for k, members in owner.items() if len(members) > 1}
    changed = {k: members[0] for k, members in owner.items() if len(members) == 1}
    if closed:
        k = next(iter(closed))
        place = extra[k].mean(axis=0)
        found.error(
            "gap-closed",
            f"{len(closed)} lines run over the gap between two slits or more: a program has "
            "joined them.",
            "Switch its geometry optimisation (closing of gaps) off.",
            f"{sum(map(len, closed.values()))} slits joined, around "
            f"({place[0]:.2f}, {place[1]:.2f}) mm",
        )
    if changed:
        k, slit = max(changed.items(), key=lambda item: abs(lines[item[0]].length - _long(item[1])))
        place = slit.mean(axis=0)
        found.error(
            "slit-length",
            f"{len(changed)} slits are too long, too short or shifted.",
            "Check kerf compensation and rounding; export them again.",
            f"{lines[k].length:.3f} mm around ({place[0]:.2f}, {place[1]:.2f}) mm",
            f"{_long(slit):.3f} mm",
        )
    if gone:
        place = gone[0].mean(axis=0)
        found.error(
            "slit-missing",
            f"{len(gone)} slits of the design are missing.",
            "Export them again, with all layers switched on.",
            None,
            f"the first around ({place[0]:.2f}, {place[1]:.2f}) mm",
        )
    unknown = [k for k in range(len(extra)) if k not in owner]
    if unknown:
        place = extra[unknown[0]].mean(axis=0)
        found.error(
            "slit-extra",
            f"{len(unknown)} lines are not in the design.",
            "Delete them, or verify with the design and options that they belong to.",
            f"the first around ({place[0]:.2f}, {place[1]:.2f}) mm",
        )


def _long(slit: FloatArray) -> float:
    return float(np.linalg.norm(slit[1] - slit[0]))
