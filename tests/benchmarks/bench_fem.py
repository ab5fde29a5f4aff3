"""The finite elements against CalculiX, scikit-fem and felupe; growth with cells and mesh.

Run as a script: ``python tests/benchmarks/bench_fem.py [--repeats 5] [--growth]``. Peers and ours
take turns on one thread; medians of processor time are compared. Exit code 1 where a bound is
missed: 7 times less than CalculiX for the same cell and mesh, 5 times less than scikit-fem and
felupe for one stiffness and force of the same mesh.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np  # noqa: E402
from facet_models import FacetModel, run_calculix, supported, uniform_triangles  # noqa: E402

from kiribench.fem.assembly import POINTS, WEIGHTS, AssembledSystem  # noqa: E402
from kiribench.fem.cell import cell_mesh, simulate_cell  # noqa: E402
from kiribench.fem.equilibrium import LoadStepper, Solved  # noqa: E402
from kiribench.fem.facet import MeshSpec  # noqa: E402
from kiribench.fem.material import NeoHookean  # noqa: E402
from kiribench.fem.sheet import SheetSpec, simulate_sheet  # noqa: E402

MU = 0.207


def system_of(model: FacetModel) -> AssembledSystem:
    return AssembledSystem(model.points, model.elements, model.equation, NeoHookean(MU))


def follow(model: FacetModel, stretches: np.ndarray) -> np.ndarray:
    """Lateral stretches; the set-up is part of the cost, as it is for CalculiX."""
    stepper = LoadStepper(system_of(model), model.pattern)
    lateral = []
    for stretch in stretches:
        solved = stepper.advance(float(stretch) - 1)
        assert isinstance(solved, Solved)
        lateral.append(solved.x[model.right[0], 0] / 5)
    return np.array(lateral)


def cpu(run: Callable[[], object]) -> float:
    began = time.process_time()
    run()
    return time.process_time() - began


def against_calculix(repeats: int) -> bool:
    """Same nodes, same elements, same end of the path; ours reports more steps than it."""
    a, b, last = 0.6, 0.4, 1.6
    graded = cell_mesh(a, b, 10.0, MeshSpec())
    models = {
        "graded, quarter points": supported(graded.points_mm, graded.triangles(), a, b),
        "uniform .25 mm": uniform_triangles(20, a, b),
    }
    fine = simulate_cell(a, b, [last], mesh=MeshSpec().scaled(0.25), estimate_error=False)
    truth = fine.poisson("engineering")[-1]
    passed = True
    print(f"CalculiX CPS6, ({a:.0%}, {b:.0%}) to strain {last - 1:.1f}, one thread")
    stretches = np.linspace(1.1, last, 6)
    for name, model in models.items():
        follow(model, stretches)
        ours, theirs, errors = [], [], (0.0, 0.0)
        for _ in range(repeats):
            kept: list[np.ndarray] = []
            ours.append(cpu(lambda model=model, kept=kept: kept.append(follow(model, stretches))))
            with tempfile.TemporaryDirectory() as folder:
                ran = run_calculix(
                    model, Path(folder), largest_strain=last - 1, steps=6, bulk_over_mu=500.0
                )
            theirs.append(ran.cpu_seconds)
            errors = (
                abs(-(kept[0][-1] - 1) / (last - 1) - truth),
                abs(-(ran.lateral_stretch[-1] - 1) / (ran.longitudinal_stretch[-1] - 1) - truth),
            )
        ratio = float(np.median(theirs) / np.median(ours))
        good = ratio >= 7 and errors[0] <= errors[1] + 1e-3
        passed &= good
        print(
            f"  {name:24s} {model.equation.max() + 1:6d} dof  ours {np.median(ours):6.3f} s  "
            f"ccx {np.median(theirs):6.2f} s  ratio {ratio:5.1f} (>= 7)  nu error ours "
            f"{errors[0]:.4f} ccx {errors[1]:.4f}  {'ok' if good else 'MISSED'}"
        )
    return passed


def scikit_fem_assembly(model: FacetModel, x: np.ndarray) -> Callable[[], tuple[object, object]]:
    """Force and stiffness of the same mesh by scikit-fem, forms in numpy."""
    import skfem
    from skfem.helpers import grad

    corners = model.elements[:, :3]
    used, flat = np.unique(corners, return_inverse=True)
    mesh = skfem.MeshTri(model.points[used].T, flat.reshape(corners.shape).T)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()), intorder=4)
    where = {tuple(np.round(point, 9)): i for i, point in enumerate(model.points)}
    nodes = np.array([where[tuple(np.round(point, 9))] for point in basis.doflocs.T])
    u = (x - model.points)[nodes, np.tile([0, 1], basis.N // 2)]

    def state(w: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        f = grad(w["u"]) + np.eye(2)[:, :, None, None]  # type: ignore[index]
        det = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        cof = np.array([[f[1, 1], -f[1, 0]], [-f[0, 1], f[0, 0]]])
        return f, det, cof

    @skfem.LinearForm
    def force(v, w):  # type: ignore[no-untyped-def]
        f, det, cof = state(w)
        return np.einsum("ij...,ij...", MU * (f - cof / det**3), grad(v))

    @skfem.BilinearForm
    def stiffness(d, v, w):  # type: ignore[no-untyped-def]
        _, det, cof = state(w)
        g, h = grad(d), grad(v)
        turned = np.array([[g[1, 1], -g[1, 0]], [-g[0, 1], g[0, 0]]])
        moved = g + 3 / det**4 * np.einsum("ij...,ij...", cof, g) * cof - turned / det**3
        return MU * np.einsum("ij...,ij...", moved, h)

    def run() -> tuple[object, object]:
        at = basis.interpolate(u)
        return stiffness.assemble(basis, u=at), force.assemble(basis, u=at)

    return run


def felupe_assembly(model: FacetModel, x: np.ndarray) -> Callable[[], tuple[object, object]]:
    """Force and stiffness of the same mesh by felupe, the law as a user material."""
    import felupe as fem

    class Law:
        x = (np.zeros((2, 2)), np.zeros(0))

        def gradient(self, values: list) -> list:
            f = values[0]
            det = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
            cof = np.array([[f[1, 1], -f[1, 0]], [-f[0, 1], f[0, 0]]])
            return [MU * (f - cof / det**3), None]

        def hessian(self, values: list) -> list:
            f = values[0]
            det = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
            cof = np.array([[f[1, 1], -f[1, 0]], [-f[0, 1], f[0, 0]]])
            swap = np.zeros((2, 2, 2, 2))
            swap[0, 0, 1, 1] = swap[1, 1, 0, 0] = 1
            swap[0, 1, 1, 0] = swap[1, 0, 0, 1] = -1
            unit = np.einsum("ik,jl->ijkl", np.eye(2), np.eye(2))
            return [
                MU
                * (
                    unit[..., None, None]
                    + 3 / det**4 * np.einsum("ij...,kl...->ijkl...", cof, cof)
                    - swap[..., None, None] / det**3
                )
            ]

    class Corrected(fem.element.QuadraticTriangle):
        """felupe 11.3 differentiates three of the six shape functions wrongly."""

        def gradient(self, rs: np.ndarray) -> np.ndarray:
            r, s = rs
            t = 1 - r - s
            return np.array(
                [
                    [1 - 4 * t, 1 - 4 * t],
                    [4 * r - 1, 0 * r],
                    [0 * r, 4 * s - 1],
                    [4 * (t - r), -4 * r],
                    [4 * s, 4 * r],
                    [-4 * s, 4 * (t - s)],
                ]
            )

    mesh = fem.Mesh(model.points, model.elements, "triangle6")
    # felupe has rules of 3 and 4 points; ours of 6 is given to it.
    rule = fem.quadrature.Scheme(points=POINTS, weights=WEIGHTS)
    region = fem.Region(mesh, Corrected(), rule)
    field = fem.FieldContainer([fem.Field(region, dim=2)])
    field[0].values[:] = x - model.points
    body = fem.SolidBody(Law(), field)

    def run() -> tuple[object, object]:
        return body.assemble.matrix(field), body.assemble.vector(field)

    return run


def against_assemblers(repeats: int) -> bool:
    """One force vector and one stiffness matrix; patterns are set up beforehand by all."""
    model = uniform_triangles(60, 0.6, 0.4)
    rng = np.random.default_rng(0)
    x = model.points * [0.97, 1.1] + 0.002 * rng.normal(size=model.points.shape)
    ours_system = system_of(model)

    def ours() -> tuple[object, object]:
        return ours_system.assemble(x)

    passed = True
    print(f"one stiffness and force, {model.points.size} displacements")
    expected = ours_system.forces(x)
    for name, peer in (
        ("scikit-fem", scikit_fem_assembly(model, x)),
        ("felupe", felupe_assembly(model, x)),
    ):
        _, vector = peer()
        dense = np.asarray(vector.toarray() if hasattr(vector, "toarray") else vector)
        # scikit-fem numbers its nodes in its own way: compare the sorted entries.
        same = bool(np.allclose(np.sort(dense.ravel()), np.sort(expected.ravel()), atol=1e-9))
        ours()
        mine, theirs = [], []
        for _ in range(repeats):
            mine.append(cpu(ours))
            theirs.append(cpu(peer))
        ratio = float(np.median(theirs) / np.median(mine))
        good = ratio >= 5 and same
        passed &= good
        print(
            f"  {name:12s} ours {np.median(mine):6.3f} s  peer {np.median(theirs):6.3f} s  "
            f"ratio {ratio:5.1f} (>= 5)  same forces {same}  {'ok' if good else 'MISSED'}"
        )
    return passed


def growth() -> None:
    """Cost of a sheet as cells and mesh grow, with the fitted exponents."""
    print("growth: (60 %, 60 %) to 60 % of the length in 6 steps, CPU s")
    sizes, spent = [], []
    for rows, columns in ((6, 4), (12, 8), (18, 12), (24, 16)):
        sheet = SheetSpec(rows=rows, columns=columns)
        steps = np.linspace(0.1, 0.6, 6) * (10 * rows + 40)
        simulate_sheet(0.6, 0.6, steps[:1], sheet=sheet, estimate_error=False)
        path = simulate_sheet(0.6, 0.6, steps, sheet=sheet, estimate_error=False)
        sizes.append(rows * columns)
        spent.append(path.cpu_seconds)
        print(f"  {rows:3d} x {columns:2d} cells {path.degrees_of_freedom:7d} dof {spent[-1]:7.2f}")
    print(f"  exponent with cells {np.polyfit(np.log(sizes), np.log(spent), 1)[0]:.2f}")
    sizes, spent = [], []
    for factor in (1.4, 1.0, 0.7, 0.5):
        sheet = SheetSpec(rows=6, columns=4)
        path = simulate_sheet(
            0.6,
            0.6,
            np.linspace(0.1, 0.6, 6) * 100,
            sheet=sheet,
            mesh=MeshSpec().scaled(factor),
            estimate_error=False,
        )
        sizes.append(path.degrees_of_freedom)
        spent.append(path.cpu_seconds)
        print(f"  mesh x {factor:3.1f} {path.degrees_of_freedom:7d} dof {spent[-1]:7.2f}")
    print(f"  exponent with dof of the mesh {np.polyfit(np.log(sizes), np.log(spent), 1)[0]:.2f}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--growth", action="store_true", help="also the growth exponents")
    options = parser.parse_args()
    passed = against_assemblers(options.repeats)
    passed &= against_calculix(options.repeats)
    if options.growth:
        growth()
    return 0 if passed else 1


if __name__ == "__main__":
    raise SystemExit(main())
