"""One design of a campaign: simulated by a worker, kept in a file of its own.

What travels between processes and machines is a plain JSON object, and so is the file.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from kiribench.errors import KiribenchError
from kiribench.fem.campaign_settings import (
    MOST_REFINEMENTS,
    REFINEMENT,
    CampaignSettings,
    Design,
)
from kiribench.fem.cell import simulate_cell
from kiribench.fem.equilibrium import MOST_WORK
from kiribench.fem.sheet import simulate_sheet
from kiribench.schema.design_space_table import write_whole

NUMBERS = (
    "displacement_mm",
    "longitudinal_stretch",
    "lateral_stretch",
    "nominal_stress_mpa",
    "energy_mpa",
    "face_overlap_mm",
    "mesh_error_poisson",
)


@dataclass(frozen=True)
class Piece:
    """The result of one design.

    Attributes:
        design: the cut lengths.
        fingerprint: of the settings that it was computed with.
        columns: name -> one number a step; NaN where there is none.
        status: one a step: ``ok``, ``not-converged``, ``not-reached`` or ``failed``.
        reason: why not every step is ok, or None.
        newton_iterations: spent in all.
        degrees_of_freedom: unknowns of the model.
        cpu_seconds: processor time, that of coarser meshes included.
        mesh_scale: element edges / those of the settings' mesh; below 1 where the estimated mesh
            error exceeded the limit.
        finest_tried: the finest mesh tried, likewise; a mesh that gave no answer is not kept.
        most_work: Newton iterations that were allowed on one mesh.
    """

    design: Design
    fingerprint: str
    columns: dict[str, tuple[float, ...]]
    status: tuple[str, ...]
    reason: str | None
    newton_iterations: int
    degrees_of_freedom: int
    cpu_seconds: float
    mesh_scale: float = 1.0
    finest_tried: float = 1.0
    most_work: int = MOST_WORK

    @property
    def largest_mesh_error(self) -> float | None:
        """Largest estimated mesh error of Poisson's ratio; None where none is known."""
        errors = np.array(self.columns["mesh_error_poisson"])
        return float(np.nanmax(errors)) if np.isfinite(errors).any() else None

    def needs_refinement(self, limit: float | None) -> bool:
        """The mesh error exceeds the limit, and the mesh may still be refined."""
        error = self.largest_mesh_error
        finest = REFINEMENT**MOST_REFINEMENTS * (1 + 1e-9)
        return (
            limit is not None
            and self.reason is None
            and error is not None
            and error > limit
            and self.finest_tried > finest
        )

    @property
    def crashed(self) -> bool:
        """The solver raised an error: no answer, and worth another attempt."""
        return "failed" in self.status

    def as_dict(self) -> dict[str, Any]:
        """As a JSON object; numbers are exact, NaN is null."""
        return {
            "schema": "kiribench.design/1",
            "a_percent": self.design.a_percent,
            "b_percent": self.design.b_percent,
            "fingerprint": self.fingerprint,
            "columns": {
                name: [None if np.isnan(value) else value for value in values]
                for name, values in self.columns.items()
            },
            "status": list(self.status),
            "reason": self.reason,
            "newton_iterations": self.newton_iterations,
            "degrees_of_freedom": self.degrees_of_freedom,
            "cpu_seconds": self.cpu_seconds,
            "mesh_scale": self.mesh_scale,
            "finest_tried": self.finest_tried,
            "most_work": self.most_work,
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Piece:
        """The inverse of :meth:`as_dict`; KeyError, TypeError or ValueError where it is none."""
        columns = {
            name: tuple(
                np.nan if value is None else float(value) for value in content["columns"][name]
            )
            for name in NUMBERS
        }
        status = tuple(str(value) for value in content["status"])
        if any(len(values) != len(status) for values in columns.values()):
            raise ValueError("columns of unequal length")
        return cls(
            design=Design(float(content["a_percent"]), float(content["b_percent"])),
            fingerprint=str(content["fingerprint"]),
            columns=columns,
            status=status,
            reason=content["reason"],
            newton_iterations=int(content["newton_iterations"]),
            degrees_of_freedom=int(content["degrees_of_freedom"]),
            cpu_seconds=float(content["cpu_seconds"]),
            mesh_scale=float(content.get("mesh_scale", 1.0)),
            finest_tried=float(content.get("finest_tried", 1.0)),
            most_work=int(content.get("most_work", MOST_WORK)),
        )


def simulate_design(settings: CampaignSettings, design: Design) -> dict[str, Any]:
    """Simulate one design; the task of a worker, here or on another machine.

    A design without an answer is a result too: its reason is kept, and nothing is raised for
    failures of the numerical kind. Where the mesh error exceeds the limit of the settings, the
    design is computed again on a finer mesh; a finer mesh without an answer does not replace a
    coarser one with an answer.

    Returns:
        ``Piece.as_dict()``.
    """
    piece = _simulate(settings, design, 1.0)
    spent, iterations = piece.cpu_seconds, piece.newton_iterations
    while piece.needs_refinement(settings.mesh_error_limit):
        finer = _simulate(settings, design, REFINEMENT * piece.finest_tried)
        spent += finer.cpu_seconds
        iterations += finer.newton_iterations
        kept = finer if finer.reason is None else piece
        piece = replace(kept, finest_tried=finer.mesh_scale)
    return replace(piece, cpu_seconds=spent, newton_iterations=iterations).as_dict()


def _simulate(settings: CampaignSettings, design: Design, mesh_scale: float) -> Piece:
    """One design on one mesh, ``mesh_scale`` times the edges of the settings' mesh."""
    a, b = design.a_percent / 100, design.b_percent / 100
    steps = np.array(settings.steps)
    mesh = settings.mesh if mesh_scale == 1.0 else settings.mesh.scaled(mesh_scale)
    law, work = settings.material, settings.most_work
    try:
        if settings.model == "sheet":
            path = simulate_sheet(
                a, b, steps, sheet=settings.specimen, mesh=mesh, material=law, most_work=work
            )
        else:
            path = simulate_cell(
                a,
                b,
                steps,
                cell_mm=settings.specimen.cell_mm,
                mesh=mesh,
                material=law,
                most_work=work,
            )
    except (KiribenchError, ArithmeticError, RuntimeError, ValueError, MemoryError) as error:
        return replace(_failed(settings, design, error), mesh_scale=mesh_scale)
    return Piece(
        design=design,
        fingerprint=settings.fingerprint,
        columns={name: tuple(getattr(path, name).tolist()) for name in NUMBERS},
        status=path.status,
        reason=path.reason,
        newton_iterations=int(path.newton_iterations.sum()),
        degrees_of_freedom=path.degrees_of_freedom,
        cpu_seconds=path.cpu_seconds,
        mesh_scale=mesh_scale,
        finest_tried=mesh_scale,
        most_work=settings.most_work,
    )


def _failed(settings: CampaignSettings, design: Design, error: Exception) -> Piece:
    count = len(settings.steps)
    return Piece(
        design=design,
        fingerprint=settings.fingerprint,
        columns=dict.fromkeys(NUMBERS, (np.nan,) * count),
        status=("failed",) * count,
        reason=f"{type(error).__name__}: {error}",
        newton_iterations=0,
        degrees_of_freedom=0,
        cpu_seconds=0.0,
    )


def piece_path(folder: Path, design: Design) -> Path:
    """Where the result of a design is kept."""
    return folder / f"{design.name}.json"


def write_piece(folder: Path, piece: Piece) -> Path:
    """Write one result, whole or not at all."""
    path = piece_path(folder, piece.design)
    write_whole(path, json.dumps(piece.as_dict(), allow_nan=False) + "\n")
    return path


def read_piece(folder: Path, design: Design) -> Piece | None:
    """The kept result of a design; None where there is none that can be read."""
    path = piece_path(folder, design)
    try:
        piece = Piece.from_dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return piece if piece.design == design else None
