"""Travel of the cutting head against a proved bound, on patches of 12 x 6 cells.

The peer is a linear programme with connectivity cuts (HiGHS): no tour can undercut its bound, the
best known one neither. Unordered is the order of the lattice.
Exits with 1 where a travel is more than 10 % above the bound.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from patch_cases import random_design, uniform_design
from tolerances import TRAVEL_RATIO
from tour_oracle import shortest_tour

from kiribench.fabrication.patch import PatchOptions, plan_patch
from kiribench.fabrication.route import shortest_route, travel_mm
from kiribench.fabrication.strokes import polyline
from kiribench.schema.patch_design import read_design

CASES = {
    "uniform 80 / 70 %": uniform_design(0.8, 0.7),
    "uniform 90 / 90 %": uniform_design(0.9, 0.9),
    "uniform 35 / 85 %": uniform_design(0.35, 0.85),
    "random, seed 0": random_design(0),
    "random, seed 1": random_design(1, low=0.05),
}


def main(tables: list[str]) -> int:
    cases = dict(CASES)
    for table in tables:
        design = read_design(Path(table))
        cases[f"{design.participant}, {design.method}"] = design
    shortest_route(np.random.default_rng(0).uniform(0, 9, (9, 2, 2)), (0.0, 0.0))  # compile
    worst = 0.0
    print(f"{'patch':28}{'slits':>6}{'unordered':>11}{'ours':>9}{'bound':>9}"
          f"{'ratio':>8}{'ours CPU':>10}{'bound CPU':>10}")  # fmt: skip
    for name, design in cases.items():
        slits = plan_patch(design, PatchOptions(0.15)).slits
        ends = np.stack([slits.start_mm, slits.end_mm], axis=1)
        unordered = travel_mm([polyline("slit", pair) for pair in ends], (0.0, 0.0))
        t0 = time.process_time()
        ours = shortest_route(ends, (0.0, 0.0)).travel_mm
        t1 = time.process_time()
        peer = shortest_tour(ends, np.zeros(2), seconds=0)
        t2 = time.process_time()
        ratio = ours / peer.bound_mm
        worst = max(worst, ratio)
        print(f"{name:28}{len(ends):6d}{unordered:11.1f}{ours:9.1f}{peer.bound_mm:9.1f}"
              f"{ratio:8.4f}{t1 - t0:9.2f}s{t2 - t1:9.2f}s")  # fmt: skip
    print(f"travel in mm; worst ratio to the bound {worst:.4f} (required: {TRAVEL_RATIO})")
    return int(worst > TRAVEL_RATIO)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
