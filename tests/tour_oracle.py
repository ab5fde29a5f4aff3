"""The shortest way through slits, with proof: linear programmes with cuts (HiGHS).

Shares no code with the product. Each slit has two gates; a tour is a perfect matching of gates
that is connected through the slits. The start and the free end are the two gates of one further
slit of no length. Degree and connectivity constraints give a lower bound (Dantzig, Fulkerson &
Johnson 1954; all pairs that are left out are priced with the duals), branching on the pairs of
that programme a tour, whose length is the optimum where it equals the bound.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, maximum_flow
from scipy.spatial import cKDTree

_FREE = -1


@dataclass(frozen=True)
class Tour:
    """``bound_mm`` proved from below; ``length_mm`` of the tour found, None if there is none."""

    bound_mm: float
    length_mm: float | None


class _Programme:
    def __init__(self, ends_mm: np.ndarray, start_mm: np.ndarray, near: int) -> None:
        self.gates = np.concatenate([ends_mm.reshape(-1, 2), [start_mm]])
        self.slits = len(ends_mm) + 1  # the last one: start and free end
        self.count = 2 * self.slits  # gates; the last is the free end, without a place
        found = cKDTree(self.gates).query(self.gates, k=min(near + 2, len(self.gates)))[1]
        pairs = {
            (min(i, j), max(i, j)) for i, row in enumerate(found) for j in row if i // 2 != j // 2
        }
        pairs |= {(i, self.count - 1) for i in range(self.count - 2)}
        self.set_pairs(np.array(sorted(pairs)))
        self.cuts: list[frozenset[int]] = []

    def set_pairs(self, pairs: np.ndarray) -> None:
        self.pairs = pairs
        self.cost = self.distance(pairs)

    def distance(self, pairs: np.ndarray) -> np.ndarray:
        free = (pairs == self.count - 1).any(axis=1)
        i, j = np.minimum(pairs, len(self.gates) - 1).T
        return np.where(free, 0.0, np.hypot(*(self.gates[i] - self.gates[j]).T))

    def degree(self) -> coo_matrix:
        m = len(self.pairs)
        return coo_matrix(
            (np.ones(2 * m), (self.pairs.T.ravel(), np.tile(np.arange(m), 2))),
            shape=(self.count, m),
        )

    def crossing(self, pairs: np.ndarray) -> csr_matrix:
        rows = []
        for cut in self.cuts:
            inside = np.zeros(self.slits, bool)
            inside[list(cut)] = True
            a, b = inside[pairs[:, 0] // 2], inside[pairs[:, 1] // 2]
            rows.append((a != b).astype(float))
        return csr_matrix(np.array(rows).reshape(len(rows), len(pairs)))

    def add_cuts(self, x: np.ndarray) -> bool:
        """Connectivity constraints that x breaks: components, then smallest cuts."""
        use = x > 1e-7
        i, j = (self.pairs[use] // 2).T
        graph = coo_matrix((x[use], (i, j)), shape=(self.slits,) * 2)
        number, label = connected_components(graph, directed=False)
        new = []
        if number > 1:
            new = [frozenset(np.flatnonzero(label == k)) for k in range(number)]
            new = [cut for cut in new if len(cut) <= self.slits // 2 or number == 2]
        else:
            scale = 10**6
            whole = (graph + graph.T).tocsr()
            capacity = csr_matrix(
                (np.rint(whole.data * scale).astype(np.int32), whole.indices, whole.indptr)
            )
            seen = np.zeros(self.slits, bool)
            for target in range(self.slits - 1):
                if seen[target]:
                    continue
                flow = maximum_flow(capacity, self.slits - 1, target)
                if flow.flow_value < 2 * scale - 100:
                    left = capacity - flow.flow
                    left.data = (left.data > 0).astype(np.int32)
                    left.eliminate_zeros()
                    order = _reached(left, self.slits - 1)
                    cut = frozenset(np.flatnonzero(~order))
                    seen[list(cut)] = True
                    new.append(cut)
        fresh = [cut for cut in new if cut and cut not in self.cuts]
        self.cuts += fresh
        return bool(fresh)


def _reached(graph: csr_matrix, start: int) -> np.ndarray:
    seen = np.zeros(graph.shape[0], bool)
    stack = [start]
    seen[start] = True
    while stack:
        row = stack.pop()
        for to in graph.indices[graph.indptr[row] : graph.indptr[row + 1]]:
            if not seen[to]:
                seen[to] = True
                stack.append(int(to))
    return seen


def shortest_tour(
    ends_mm: np.ndarray, start_mm: np.ndarray, *, near: int = 8, seconds: float = 120.0
) -> Tour:
    """Bound and, within the time, a tour of the way from ``start_mm`` through all slits."""
    begun = time.process_time()
    programme = _Programme(np.asarray(ends_mm, float), np.asarray(start_mm, float), near)
    every = np.array(np.triu_indices(programme.count, 1)).T
    every = every[every[:, 0] // 2 != every[:, 1] // 2]
    while True:
        cuts = programme.crossing(programme.pairs)
        answer = linprog(
            programme.cost,
            A_eq=programme.degree(),
            b_eq=np.ones(programme.count),
            A_ub=-cuts if cuts.shape[0] else None,
            b_ub=-2.0 * np.ones(cuts.shape[0]) if cuts.shape[0] else None,
            bounds=(0, 1),
            method="highs",
        )
        assert answer.status == 0, answer.message
        if programme.add_cuts(answer.x):
            continue
        price = programme.distance(every)
        price -= answer.eqlin.marginals[every].sum(axis=1)
        if cuts.shape[0]:
            price += programme.crossing(every).T @ answer.ineqlin.marginals
        wanted = every[price < -1e-7]
        known = set(map(tuple, programme.pairs))
        wanted = [tuple(pair) for pair in wanted if tuple(pair) not in known]
        if not wanted:
            break
        programme.set_pairs(np.array(sorted(known | set(wanted))))
    bound = float(answer.fun)
    while time.process_time() - begun < seconds:
        cuts = programme.crossing(programme.pairs)
        limits = [LinearConstraint(programme.degree(), 1, 1)]
        if cuts.shape[0]:
            limits.append(LinearConstraint(cuts, 2, np.inf))
        whole = milp(
            programme.cost,
            constraints=limits,
            bounds=Bounds(0, 1),
            integrality=np.ones(len(programme.pairs)),
            options={
                "time_limit": max(1.0, seconds - (time.process_time() - begun)),
                "mip_rel_gap": 1e-6,
            },
        )
        if whole.x is None:
            break
        # The programme's own bound would hold for these pairs of gates only.
        if not programme.add_cuts(np.rint(whole.x)):
            return Tour(bound, float(whole.fun))
    return Tour(bound, None)
