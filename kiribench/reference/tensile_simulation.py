"""What the simulator predicts for a tensile test, and how that moves with what may be wrong."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from kiribench.errors import NotConvergedError, TableError
from kiribench.fem.facet import MeshSpec
from kiribench.fem.material import Material, NeoHookean, Ogden
from kiribench.fem.patch import simulate_patch
from kiribench.lattice import CutMap
from kiribench.schema.patch_design import PatchDesign
from kiribench.tensile.result import TensileTest

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]

Ends = Literal["held", "sliding"]

LONGEST_CUT = 0.97
"""Changed cut lengths stay below this part of the cell."""
SMALLEST_EXPONENT = 0.5
"""Changed Ogden exponents stay above this."""
STEPS = 9
"""Load steps that are simulated; between them all curves are cubic."""


@dataclass(frozen=True)
class Specimen:
    """What is pulled, as it is believed to be.

    Attributes:
        grip_mm: uncut band between the cells and the clamp, at either end, mm.
        ends: ``held``: the clamps keep the width, ``sliding``: the ends are free to narrow.
        material: the law.
        mesh: of a facet.
        row, column: cell of the design at which the followed block begins; None is centred.
    """

    grip_mm: float = 0.0
    ends: Ends = "held"
    material: Material = field(default_factory=NeoHookean)
    mesh: MeshSpec = field(default_factory=MeshSpec)
    row: int | None = None
    column: int | None = None


@dataclass(frozen=True, eq=False)
class Measured:
    """The frames of a test that are compared; T frames, k cells.

    Attributes:
        frame: (T,) index of the frame in the test.
        along, across: (T, k) log strains; NaN where a cell was not measured.
        displacement_mm, force_n: (T,) from the first frame on; None where not known.
        row, col: (k,) cell of the design.
    """

    frame: IntArray
    along: FloatArray
    across: FloatArray
    displacement_mm: FloatArray | None
    force_n: FloatArray | None
    row: IntArray
    col: IntArray

    @property
    def seen(self) -> BoolArray:
        """(T, k) where a cell was measured."""
        return np.isfinite(self.along)

    @property
    def strain(self) -> FloatArray:
        """(T,) mean log strain along the pull over the measured cells."""
        return np.asarray(np.nanmean(self.along, axis=1))

    def mean(self, cells: FloatArray) -> FloatArray:
        """(T,) mean of (T, k) over the measured cells of each frame."""
        return np.asarray(np.where(self.seen, cells, 0).sum(axis=1) / self.seen.sum(axis=1))


def measured_part(
    design: PatchDesign, test: TensileTest, specimen: Specimen, min_strain: float
) -> Measured:
    """The frames that are pulled far enough, the cells placed in the design.

    Raises:
        TableError: ``tensile-block-outside``, ``tensile-too-few-frames``.
    """
    rows, columns = design.shape
    high, wide = int(test.row.max()) + 1, int(test.col.max()) + 1
    first = (rows - high) // 2 if specimen.row is None else specimen.row
    left = (columns - wide) // 2 if specimen.column is None else specimen.column
    if first < 0 or left < 0 or first + high > rows or left + wide > columns:
        raise TableError(
            "tensile-block-outside",
            "The followed block of cells does not lie in the design.",
            remedy="Check that the design is that of the sample, and where the block begins.",
            file=design.file,
            got=f"{high} x {wide} cells from row {first}, column {left}",
            expected=f"within {rows} x {columns} cells",
        )
    seen = test.measured
    along = np.where(seen, np.log(np.where(seen, test.longitudinal_stretch, 1.0)), np.nan)
    across = np.where(seen, np.log(np.where(seen, test.lateral_stretch, 1.0)), np.nan)
    enough = seen.sum(axis=1) >= max(1, seen.shape[1] // 3)
    mean = np.full(len(seen), -np.inf)
    mean[enough] = np.nanmean(along[enough], axis=1)
    used = enough & (mean >= min_strain)
    used[0] = False  # the reference: zero by definition
    travel = test.displacement_mm - test.displacement_mm[0]
    has_travel = bool(np.isfinite(travel[used]).all() and used.any())
    has_force = bool(np.isfinite(test.force_n[used]).all() and used.any())
    frames = np.flatnonzero(used)
    frames = frames[np.argsort(mean[frames], kind="stable")]
    if len(frames) < 3:
        raise TableError(
            "tensile-too-few-frames",
            "Too few frames are pulled far enough to be compared.",
            remedy="Photograph more load steps, or lower the smallest strain.",
            got=f"{len(frames)} frames with a mean log strain of {min_strain:g} or more",
            expected="3 or more",
        )
    force0 = test.force_n[0] if np.isfinite(test.force_n[0]) else 0.0
    return Measured(
        frames,
        along[frames],
        across[frames],
        travel[frames] if has_travel else None,
        test.force_n[frames] - force0 if has_force else None,
        test.row + first,
        test.col + left,
    )


@dataclass(frozen=True, eq=False)
class Response:
    """A simulated pull; n load steps from rest, k followed cells.

    Attributes:
        displacement_mm: (n,) from 0.
        along, across: (n, k) log strains of the cells.
        force_n: (n,) the pull.
        face_overlap_mm: the largest.
    """

    displacement_mm: FloatArray
    along: FloatArray
    across: FloatArray
    force_n: FloatArray
    face_overlap_mm: float


@dataclass(frozen=True, eq=False)
class Predicted:
    """What a response says for the frames of a test: (T, k), (T, k), (T,).

    Attributes:
        across: log strain across, where the mean strain along the pull is the measured one.
        along: log strain along the pull at the same state.
        slope: d across / d along of each cell there.
        along_by_travel: log strain along the pull at the measured displacement; None without.
        force_n: at the measured displacement, or at the measured strain where there is none.
    """

    across: FloatArray
    along: FloatArray
    slope: FloatArray
    along_by_travel: FloatArray | None
    force_n: FloatArray


def load_steps(design: PatchDesign, specimen: Specimen, measured: Measured) -> FloatArray:
    """(STEPS,) displacements, mm, that cover the test; dense at the start."""
    length = design.shape[0] * design.cell_mm + 2 * specimen.grip_mm
    far = float(np.exp(measured.strain.max()) - 1) * length * 1.15
    if measured.displacement_mm is not None:
        far = max(far, 1.1 * float(measured.displacement_mm.max()))
    return np.asarray(far * (np.arange(1, STEPS + 1) / STEPS) ** 1.5)


def predict(
    response: Response, measured: Measured, *, slip: float = 0.0, slack_mm: float = 0.0
) -> Predicted:
    """The response at the states of the frames.

    Args:
        response: of the simulator.
        measured: the frames.
        slip: part of the displacement that is lost in the grips.
        slack_mm: displacement before the sample is taut, mm.

    Raises:
        NotConvergedError: ``tensile-beyond-simulation``: a frame lies beyond the last step.
    """
    from scipy.interpolate import CubicSpline

    at = response.displacement_mm
    along, across = CubicSpline(at, response.along), CubicSpline(at, response.across)
    force = CubicSpline(at, response.force_n)
    dense = np.linspace(0, at[-1], 1500)
    table = along(dense)
    state = np.empty(len(measured.frame))
    for t, seen in enumerate(measured.seen):
        curve = table[:, seen].mean(axis=1)
        target = float(measured.strain[t])
        if target > curve.max():
            raise NotConvergedError(
                "tensile-beyond-simulation",
                "The test goes further than the simulation could follow.",
                remedy="Compare the frames below that strain only.",
                got=f"mean log strain {target:.3f}",
                expected=f"at most {curve.max():.3f}",
            )
        state[t] = np.interp(target, curve, dense)
    rate = along(state, 1)
    travel = measured.displacement_mm
    by_travel = None
    if travel is not None:
        reached = np.clip(travel * (1 - slip) - slack_mm, 0.0, at[-1])
        by_travel = along(reached)
        pull = force(reached)
    else:
        pull = force(state)
    return Predicted(
        across(state),
        along(state),
        across(state, 1) / np.where(np.abs(rate) > 1e-12, rate, 1e-12),
        by_travel,
        pull,
    )


def with_longer_cuts(design: PatchDesign, longer_a: float, longer_b: float) -> PatchDesign:
    """The design with every cut longer by a part of the cell; uncut cells stay uncut."""
    if longer_a == 0 and longer_b == 0:
        return design
    a = np.where(design.a > 0, np.clip(design.a + longer_a, 0, LONGEST_CUT), 0.0)
    b = np.where(design.b > 0, np.clip(design.b + longer_b, 0, LONGEST_CUT), 0.0)
    return replace(design, a=a, b=b, quantities={})


def other_exponent(material: Material, change: float) -> Material:
    """The law with another exponent and the same initial shear modulus."""
    return Ogden(material.mu_mpa, float(max(material.alpha + change, SMALLEST_EXPONENT)))


@dataclass(frozen=True)
class Amounts:
    """By how much the sample differs from what is believed; all 0 is the belief.

    Attributes:
        longer_a, longer_b: of the cuts across and along the pull, parts of the cell.
        exponent: change of the law's Ogden exponent.
        stiffness: change of the force, as a part of it: shear modulus, thickness or load cell.
        ends: 1 where the ends are of the other kind (free to narrow instead of held), between
            0 and 1 a mixture of the two pulls.
        slip: part of the displacement that is lost in the grips.
        slack_mm: displacement before the sample is taut.
    """

    longer_a: float = 0.0
    longer_b: float = 0.0
    exponent: float = 0.0
    stiffness: float = 0.0
    ends: float = 0.0
    slip: float = 0.0
    slack_mm: float = 0.0


class Simulator:
    """Pulls of one design, each simulated once.

    Args:
        design: the cuts of the whole sample.
        specimen: what is believed to be pulled.
        measured: the frames whose cells are followed.
        displacements_mm: (n,) load steps, growing from above 0.
    """

    def __init__(
        self,
        design: PatchDesign,
        specimen: Specimen,
        measured: Measured,
        displacements_mm: FloatArray,
    ) -> None:
        self._design, self._specimen = design, specimen
        self._row, self._col = measured.row, measured.col
        self._steps = displacements_mm
        self._known: dict[tuple[float, float, float, bool], Response] = {}

    def response(self, amounts: Amounts | None = None) -> Response:
        """The simulated pull; slip and slack are no part of it.

        Raises:
            NotConvergedError: the first steps have no answer.
        """
        at = amounts or Amounts()
        believed = self._pull(at, False) if at.ends < 1 else self._pull(at, True)
        if 0 < at.ends < 1:
            other = self._pull(at, True)
            n = min(len(believed.force_n), len(other.force_n))
            believed = replace(
                believed,
                displacement_mm=believed.displacement_mm[:n],
                along=(1 - at.ends) * believed.along[:n] + at.ends * other.along[:n],
                across=(1 - at.ends) * believed.across[:n] + at.ends * other.across[:n],
                force_n=(1 - at.ends) * believed.force_n[:n] + at.ends * other.force_n[:n],
            )
        return replace(believed, force_n=(1 + at.stiffness) * believed.force_n)

    def predict(self, measured: Measured, amounts: Amounts | None = None) -> Predicted:
        """What the pull says for the frames; see :func:`predict`."""
        at = amounts or Amounts()
        return predict(self.response(at), measured, slip=at.slip, slack_mm=at.slack_mm)

    def _pull(self, at: Amounts, other_ends: bool) -> Response:
        key = (at.longer_a, at.longer_b, at.exponent, other_ends)
        if key not in self._known:
            self._known[key] = self._simulated(at, other_ends)
        return self._known[key]

    def _simulated(self, at: Amounts, other_ends: bool) -> Response:
        specimen = self._specimen
        design = with_longer_cuts(self._design, at.longer_a, at.longer_b)
        ends: Ends = specimen.ends
        if other_ends:
            ends = "sliding" if ends == "held" else "held"
        material = specimen.material
        if at.exponent:
            material = other_exponent(material, at.exponent)
        found = simulate_patch(
            CutMap(design.a, design.b, design.cell_mm),
            self._steps,
            grip_mm=specimen.grip_mm,
            ends=ends,
            mesh=specimen.mesh,
            material=material,
        )
        good = found.path.converged
        if good.sum() < 4:
            found.path.require_converged()
            raise NotConvergedError(
                "fem-not-converged",
                "The simulated pull has too few load steps.",
                remedy="Compare fewer, smaller strains.",
            )
        width = design.shape[1] * design.cell_mm
        cells = (slice(None), self._row, self._col)
        zero = np.zeros((1, len(self._row)))
        pull = found.path.nominal_stress_mpa[good] * width * design.thickness_mm
        return Response(
            np.concatenate([[0.0], found.path.displacement_mm[good]]),
            np.concatenate([zero, np.log(found.longitudinal_stretch[good][cells])]),
            np.concatenate([zero, np.log(found.lateral_stretch[good][cells])]),
            np.concatenate([[0.0], pull]),
            float(np.nanmax(found.path.face_overlap_mm[good])),
        )
