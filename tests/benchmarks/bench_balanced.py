"""`balanced` on patches of 72 to 10,000 cells: CPU seconds, memory, and whether a start matters.

Smooth targets are those of smooth maps of cuts; rough ones have errors of .1 in Poisson's ratio and
of 15 % in strain, drawn cell by cell, so that not all can be met together. Reachable ranges and the
table of results are part of the time, files and figures are not. On the patch of 72 cells the sum
is minimised from drawn cuts too. Exit code 1 where a limit is missed or a start ends lower.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from dataclasses import replace
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import numpy as np
from bench_design import TABLE, problem

from kiribench.design.balance_search import descend, look_around
from kiribench.design.balanced import balance, tabulated, terms_of
from kiribench.design.cells import cells_of
from kiribench.design.limits import Limits
from kiribench.design.methods import design_patch
from kiribench.design.options import DesignOptions
from kiribench.design.problem import DesignProblem
from kiribench.design.reachable import reachable
from kiribench.design.surrogates import Surrogates
from kiribench.schema.design_space import read_design_space
from kiribench.surrogate import fit_table
from kiribench.surrogate.keep import load

SIZES = ((12, 6, 10.0), (30, 30, 60.0), (50, 50, 60.0), (100, 100, 60.0), (1000, 10, 60.0))
STARTS = 20
LOWER = 1e-5  # relative


def roughened(asked: DesignProblem, seed: int) -> DesignProblem:
    """The same with errors of every cell's own."""
    rng = np.random.default_rng(seed)
    strain = asked.longitudinal_strain * np.exp(0.15 * rng.normal(size=asked.shape))
    nu = asked.poisson_ratio + 0.1 * rng.normal(size=asked.shape)
    return replace(asked, longitudinal_strain=strain, poisson_ratio=nu)


def other_starts(asked: DesignProblem, surrogates: Surrogates) -> bool:
    """Whether no drawn start ends lower than the method does."""
    cells = cells_of(asked, surrogates, Limits(), DesignOptions())
    span = reachable(cells.poisson, cells.high)
    ours = balance(cells, span).objective
    terms = terms_of(cells, span)
    rough = tabulated(terms, cells)
    values = []
    for start in np.random.default_rng(0).uniform(0, cells.high, (STARTS, len(terms.target), 2)):
        x, moved = start, 1
        while moved:
            x, moved = look_around(rough, descend(rough, x).at.x)
        values.append(descend(terms, x).at.value)
    same = int(np.sum(np.abs(np.array(values) - ours) <= LOWER * ours))
    print(
        f"  sum {ours:.5f}; from {STARTS} drawn starts {min(values):.5f} to {max(values):.5f}, "
        f"{same} the same"
    )
    return min(values) >= ours * (1 - LOWER)


def main() -> int:
    """Print the table; 1 where a limit is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surrogate", type=Path, help="a model of kiribench fit; fitted if absent")
    arguments = parser.parse_args()
    kept = load(arguments.surrogate) if arguments.surrogate else fit_table(read_design_space(TABLE))
    surrogates = Surrogates(kept)
    good = True
    for rows, columns, most in SIZES:
        smooth = problem(surrogates, rows, columns, 1)
        for kind, asked in (("smooth", smooth), ("rough", roughened(smooth, 1))):
            start = time.process_time()
            result = design_patch("balanced", asked, surrogates)
            seconds = time.process_time() - start
            told = result.design.settings["MethodSettings"]
            good &= seconds < most and told["Converged"]
            memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
            print(
                f"{rows:5} x {columns:<4} {kind:6} {seconds:7.2f} CPU s (limit {most:.0f}), "
                f"{told['Iterations']:3} steps, {told['CellsMoved']} moved, "
                f"{'at rest' if told['Converged'] else 'NOT AT REST'}, error rms "
                f"{np.sqrt(np.nanmean(result.error**2)):.4f}, force "
                f"{100 * told['ForceDifferenceRms']:.2f} % rms, peak {memory:.2f} GB so far",
                flush=True,
            )
            if rows == 12:
                good &= other_starts(asked, surrogates)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
