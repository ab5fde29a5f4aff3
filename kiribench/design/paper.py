"""The paper's way: CMA-ES on its objective in every cell (arXiv 2511.13941, eq. 5).

``min (nu_scan - GP(a, b, strain_scan))^2 + lambda (a^2 + b^2)``, 0 <= a, b <= 90 %. The paper
gives no lambda: ours is 1e-3 for a and b as fractions of the cell edge, which moves Poisson's ratio
by some .001; the same number on percents would weigh 10,000 times as much and leave no cuts.
All cells take their steps side by side, so that the surrogate is asked once a generation.
"""

from __future__ import annotations

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from kiribench.design.cells import Cells
from kiribench.design.result import Generations

FloatArray = NDArray[np.float64]

PENALTY = 1e-3


def search(cells: Cells) -> tuple[FloatArray, Generations]:
    """The best cuts that CMA-ES has seen in each cell, (n, 2), and every generation.

    Mean of the first generation: the middle of the allowed square; step size: ``options.sigma``
    of its edge. It ends by the library's criteria (objective flat to 1e-12 of its scale, step
    sizes of 1e-12) or after ``options.max_generations``.
    """
    options, n = cells.options, len(cells)
    penalty = PENALTY if options.penalty is None else options.penalty
    seeds = np.random.SeedSequence(options.seed).generate_state(n)
    searches = [
        CMA(
            mean=np.full(2, cells.high / 2),
            sigma=options.sigma * cells.high,
            bounds=np.array([[0.0, cells.high]] * 2),
            seed=int(seed),
            population_size=options.population,
        )
        for seed in seeds
    ]
    size = searches[0].population_size
    best = np.full((n, 2), np.nan)
    least = np.full(n, np.inf)
    stopped = np.full(n, options.max_generations, dtype=np.int64)
    populations, objectives = [], []
    live = np.arange(n)
    for generation in range(1, options.max_generations + 1):
        tried = np.full((n, size, 2), np.nan)
        for k in live:
            tried[k] = [searches[k].ask() for _ in range(size)]
        value = np.full((n, size), np.nan)
        who = np.repeat(live, size)
        points = tried[live].reshape(-1, 2)
        miss = cells.target[who] - cells.poisson.jet(points, who).value
        # eq. 5
        value[live] = (miss**2 + penalty * (points**2).sum(axis=1)).reshape(-1, size)
        for k in live:
            searches[k].tell([(x, float(f)) for x, f in zip(tried[k], value[k], strict=True)])
            first = int(np.argmin(value[k]))
            if value[k, first] < least[k]:
                least[k], best[k] = value[k, first], tried[k, first]
        populations.append(tried)
        objectives.append(value)
        ended = np.array([searches[k].should_stop() for k in live])
        stopped[live[ended]] = generation
        live = live[~ended]
        if not len(live):
            break
    return best, Generations(np.array(populations), np.array(objectives), stopped)
