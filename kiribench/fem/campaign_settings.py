"""What a campaign computes: model, load steps, mesh, material; and the paper's designs."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, Literal

from kiribench import __version__
from kiribench.errors import UsageError
from kiribench.fem.cell import CELL_MESH
from kiribench.fem.equilibrium import MOST_WORK
from kiribench.fem.facet import MeshSpec
from kiribench.fem.material import NeoHookean
from kiribench.fem.sheet import SheetSpec

NUMERICS = 1
"""Raised whenever a change of the solver moves its numbers: old results are not mixed in."""

MESH_ERROR_LIMIT = 0.01
"""Estimated mesh error of Poisson's ratio above which the mesh of a design is refined."""

REFINEMENT = 0.7
"""Element edges of a refined mesh / those before."""

MOST_REFINEMENTS = 3

PAPER_LEVELS = (1, *range(5, 100, 5), 99)
"""The paper's 21 cut lengths, percent of the cell."""

PAPER_DISPLACEMENTS_MM = tuple(10.0 * k for k in range(1, 26))
"""The paper's load steps of a sheet."""

CELL_STRETCHES = tuple(round(1 + 0.056 * k, 3) for k in range(1, 26))
"""Load steps of a cell: 25 equal ones to 2.4, the stretch of the sheets' middle at 250 mm."""

Model = Literal["cell", "sheet"]


@dataclass(frozen=True)
class Design:
    """One uniform cut pattern.

    Attributes:
        a_percent: length of the cuts across the pull, percent of the cell.
        b_percent: length of the cuts along the pull, percent of the cell.

    Raises:
        UsageError: a length is not within 0 <= length < 100.
    """

    a_percent: float
    b_percent: float

    def __post_init__(self) -> None:
        for name, value in (("a", self.a_percent), ("b", self.b_percent)):
            if not 0 <= value < 100:
                raise UsageError(
                    "cut-length-range",
                    f"Cut length {name} of a design is out of range.",
                    remedy="Give percent of the cell edge; neighbouring cuts meet at 100.",
                    got=f"{value:g}",
                    expected="0 <= length < 100",
                )

    @property
    def name(self) -> str:
        """``a-b`` in percent, such as ``35-85``; also the name of its file."""
        return f"{self.a_percent:.12g}-{self.b_percent:.12g}"


def paper_designs() -> tuple[Design, ...]:
    """The 441 designs of the paper: every pair of 1, 5, 10, ..., 95, 99 percent."""
    return tuple(Design(float(a), float(b)) for a in PAPER_LEVELS for b in PAPER_LEVELS)


@dataclass(frozen=True)
class CampaignSettings:
    """All that decides the numbers of a design.

    Attributes:
        model: periodic cell or tensile sheet.
        steps: displacements (mm) of a sheet, longitudinal stretches of a cell.
        mesh_mm: longest element edge, mm; None is the model's default mesh.
        specimen: the sheet; of a cell only its ``cell_mm`` counts.
        material: the law.
        mesh_error_limit: a design whose estimated mesh error of Poisson's ratio (log) exceeds
            this at any step is computed again with edges ``REFINEMENT`` times as long, at most
            ``MOST_REFINEMENTS`` times; None: never.
        most_work: Newton iterations for a design on one mesh; the steps not reached then have no
            answer.

    Raises:
        UsageError: steps that do not lead away from rest, or an edge or a limit that is not
            positive.
    """

    model: Model = "cell"
    steps: tuple[float, ...] = CELL_STRETCHES
    mesh_mm: float | None = None
    specimen: SheetSpec = field(default_factory=SheetSpec)
    material: NeoHookean = field(default_factory=NeoHookean)
    mesh_error_limit: float | None = MESH_ERROR_LIMIT
    most_work: int = MOST_WORK

    def __post_init__(self) -> None:
        check_steps(self.model, self.steps)
        if self.mesh_error_limit is not None and not self.mesh_error_limit > 0:
            raise UsageError(
                "mesh-error-range",
                "The limit of the mesh error is out of range.",
                remedy="Give a positive change of Poisson's ratio, such as 0.01.",
                got=f"{self.mesh_error_limit:g}",
                expected="more than 0",
            )
        if self.most_work < 1:
            raise UsageError(
                "work-range",
                "No iteration, no work.",
                remedy="Give 1 or more, such as 1500.",
                got=self.most_work,
            )
        longest = self.specimen.cell_mm / 2
        if self.mesh_mm is not None and not 0 < self.mesh_mm <= longest:
            raise UsageError(
                "mesh-edge-range",
                "The longest element edge is out of range.",
                remedy="Give a length of at most half a cell.",
                got=f"{self.mesh_mm:g}",
                expected=f"0 < edge <= {longest:g} mm",
            )

    @classmethod
    def of(
        cls,
        model: Model,
        steps: tuple[float, ...] | None = None,
        mesh_mm: float | None = None,
        mesh_error_limit: float | None = None,
        most_work: int = MOST_WORK,
    ) -> CampaignSettings:
        """The settings with the model's default steps where none are given.

        A mesh that is asked for is refined only where a limit is asked for too.
        """
        default = PAPER_DISPLACEMENTS_MM if model == "sheet" else CELL_STRETCHES
        limit = mesh_error_limit
        if limit is None and mesh_mm is None:
            limit = MESH_ERROR_LIMIT
        return cls(
            model,
            default if steps is None else steps,
            mesh_mm,
            mesh_error_limit=limit,
            most_work=most_work,
        )

    @property
    def mesh(self) -> MeshSpec:
        """The mesh of a facet."""
        if self.mesh_mm is not None:
            return MeshSpec.of_edge(self.mesh_mm, self.specimen.cell_mm)
        return CELL_MESH if self.model == "cell" else MeshSpec()

    @property
    def longest_edge_mm(self) -> float:
        """Longest element edge, mm."""
        return self.mesh.longest * self.specimen.cell_mm / 2

    def as_dict(self) -> dict[str, Any]:
        """The settings as a JSON object; equal objects give equal numbers.

        Without the limit of the work: it decides how far a design gets, and more work goes on
        with the designs that it ended.
        """
        specimen = asdict(self.specimen)
        return {
            "Model": self.model,
            "StepsAre": "displacement_mm" if self.model == "sheet" else "longitudinal_stretch",
            "Steps": list(self.steps),
            "Specimen": specimen if self.model == "sheet" else {"cell_mm": specimen["cell_mm"]},
            "Mesh": {
                "longest_edge_mm": self.longest_edge_mm,
                "growth": self.mesh.growth,
                "tip": self.mesh.tip,
                "element": "six-node triangles",
            },
            "Material": {
                "law": "incompressible neo-Hookean, plane stress",
                "mu_mpa": self.material.mu_mpa,
            },
            "MeshErrorLimit": self.mesh_error_limit,
            "SoftwareVersion": __version__,
            "Numerics": NUMERICS,
        }

    @property
    def fingerprint(self) -> str:
        """The first 16 digits of the SHA-256 of the settings, but for the limit of the mesh error.

        The limit decides which mesh a design needs, not what it gives on a mesh.
        """
        settings = self.as_dict()
        del settings["MeshErrorLimit"]
        text = json.dumps(settings, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def check_steps(model: Model, steps: tuple[float, ...]) -> None:
    """Refuse steps that do not lead strictly away from rest.

    Raises:
        UsageError: none, or in the wrong order, or on both sides of rest, or no stretch.
    """
    rest = 0.0 if model == "sheet" else 1.0
    path = [step - rest for step in steps]
    away = all(abs(b) > abs(a) and a * b > 0 for a, b in pairwise(path))
    finite = all(abs(step) < 1e6 for step in steps)
    if not steps or not finite or path[0] == 0 or not away or (model == "cell" and min(steps) <= 0):
        kind = "displacements in mm" if model == "sheet" else "longitudinal stretches"
        raise UsageError(
            "steps-order",
            f"The load steps of a {model} are {kind} that lead away from rest ({rest:g}).",
            remedy="Give them in growing order, all on one side of rest, each once.",
            got=", ".join(f"{step:g}" for step in steps[:8]) or "none",
            expected="10,20,30" if model == "sheet" else "1.1,1.2,1.3",
        )
