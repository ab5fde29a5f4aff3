"""A campaign: many designs, each finished one kept at once, one table at the end.

A campaign that is cut short, by whatever means, goes on where it was when it is started again
in the same folder, and ends with the table that an undisturbed one gives.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kiribench.errors import DataError, NotConvergedError, UsageError
from kiribench.fem.campaign_piece import NUMBERS, Piece, read_piece, write_piece
from kiribench.fem.campaign_settings import CampaignSettings, Design
from kiribench.fem.campaign_workers import Pieces, run_cluster, run_here, run_processes
from kiribench.fem.loadpath import OVERLAP_FLAG_MM
from kiribench.schema.design_space_table import (
    DIGITS,
    TABLE_FILE,
    table_of,
    write_design_space,
    write_whole,
)

if TYPE_CHECKING:
    import pandas as pd

PIECES = "designs"
SETTINGS_FILE = "campaign.json"


@dataclass(frozen=True, eq=False)
class Campaign:
    """What a campaign gave.

    Attributes:
        settings: what was computed.
        pieces: one a design, in the order asked for.
        resumed: how many of them were there from an earlier start.
        table, sidecar: the files.
    """

    settings: CampaignSettings
    pieces: tuple[Piece, ...]
    resumed: int
    table: Path
    sidecar: Path

    @property
    def frame(self) -> pd.DataFrame:
        """The table."""
        return campaign_table(self.pieces)

    @property
    def incomplete(self) -> tuple[Piece, ...]:
        """Designs with steps that have no answer."""
        return tuple(piece for piece in self.pieces if piece.reason is not None)

    @property
    def overlapping(self) -> tuple[Piece, ...]:
        """Designs whose crack faces interpenetrate by more than ``OVERLAP_FLAG_MM``."""
        return tuple(
            piece
            for piece in self.pieces
            if np.nanmax(np.nan_to_num(piece.columns["face_overlap_mm"])) > OVERLAP_FLAG_MM
        )

    @property
    def largest_mesh_error(self) -> float | None:
        """Largest estimated mesh error of Poisson's ratio (log); None if there is none."""
        errors = [piece.largest_mesh_error for piece in self.pieces]
        return max((error for error in errors if error is not None), default=None)

    @property
    def cpu_seconds(self) -> float:
        """Processor time of all designs, whenever they were computed."""
        return float(sum(piece.cpu_seconds for piece in self.pieces))


def run_campaign(
    settings: CampaignSettings,
    designs: Sequence[Design],
    folder: Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Campaign:
    """Simulate the designs that are not there yet, and write the table of all.

    Every finished design is written to ``folder/designs`` at once. Designs that the solver
    could not finish are rows with a status, their reasons are in the sidecar; those whose
    solver raised an error are tried again at the next start.

    Args:
        settings: what to compute.
        designs: each once.
        folder: made if it is not there; may hold the pieces of an earlier start.
        jobs: local processes; 1 works in this process.
        scheduler: address of a Dask scheduler, instead of local processes.
        progress: called with the designs done and to do in this start.

    Raises:
        UsageError: no designs, one twice, jobs < 1, or the folder holds designs that were
            computed with other settings; the message says which.
        NotConvergedError: a worker died; start again.
    """
    _check(designs, jobs)
    pieces_at = folder / PIECES
    pieces_at.mkdir(parents=True, exist_ok=True)
    _claim(pieces_at / SETTINGS_FILE, settings)
    for left_over in pieces_at.glob(".*.part"):
        left_over.unlink(missing_ok=True)
    kept = {design: read_piece(pieces_at, design) for design in designs}
    found = {
        design: piece
        for design, piece in kept.items()
        if piece is not None and _answers(piece, settings)
    }
    missing = [design for design in designs if design not in found]
    resumed = len(found)
    progress(0, len(missing))
    with closing(_work(settings, missing, jobs, scheduler)) as work:
        for done, content in enumerate(work, start=1):
            piece = Piece.from_dict(content)
            if piece.fingerprint != settings.fingerprint:
                raise NotConvergedError(
                    "worker-version",
                    "A worker computes with another version of kiribench.",
                    remedy="Install the same version on all machines.",
                    got=piece.fingerprint,
                    expected=settings.fingerprint,
                )
            write_piece(pieces_at, piece)
            found[piece.design] = piece
            progress(done, len(missing))
    pieces = tuple(found[design] for design in designs)
    table, sidecar = write_design_space(
        folder / TABLE_FILE, campaign_table(pieces), campaign_sidecar(settings, pieces)
    )
    return Campaign(settings, pieces, resumed, table, sidecar)


def _work(
    settings: CampaignSettings, designs: Sequence[Design], jobs: int, scheduler: str | None
) -> Pieces:
    if not designs:
        return run_here(settings, ())
    if scheduler is not None:
        return run_cluster(settings, designs, scheduler)
    if jobs == 1 or len(designs) == 1:
        return run_here(settings, designs)
    return run_processes(settings, designs, min(jobs, len(designs)))


def _check(designs: Sequence[Design], jobs: int) -> None:
    twice = sorted({design.name for design in designs if list(designs).count(design) > 1})
    if not designs or twice:
        raise UsageError(
            "designs-once",
            "Every design must be there once." if twice else "There are no designs.",
            remedy="Name each pair (a, b) once, as in 35,85;90,90.",
            got=", ".join(twice) or "none",
        )
    if jobs < 1:
        raise UsageError("jobs-range", "No process, no work.", remedy="Give 1 or more.", got=jobs)


def _claim(path: Path, settings: CampaignSettings) -> None:
    """Write the settings beside the pieces, or compare them with those that are there."""
    wanted = settings.as_dict()
    if not path.exists():
        write_whole(path, json.dumps(wanted, indent=2, allow_nan=False) + "\n")
        return
    try:
        there = json.loads(path.read_text(encoding="utf-8"))
        differing = sorted(
            key for key in wanted.keys() | there.keys() if wanted.get(key) != there.get(key)
        )
    except (ValueError, AttributeError) as error:
        raise DataError(
            "campaign-settings-unreadable",
            "The settings of the designs in this folder cannot be read.",
            remedy="Give another --out, or remove its folder 'designs'.",
            file=path,
        ) from error
    if differing:
        raise UsageError(
            "campaign-settings-changed",
            "The folder holds designs that were computed with other settings.",
            remedy="Give another --out, or remove its folder 'designs' to start afresh.",
            file=path,
            got="; ".join(f"{key} {_short(wanted.get(key))}" for key in differing),
            expected="; ".join(f"{key} {_short(there.get(key))}" for key in differing),
        )


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) < 100 else f"{text[:60]} ... {text[-25:]}"


def _answers(piece: Piece, settings: CampaignSettings) -> bool:
    """The piece is what would be computed: settings, version, mesh fine enough, work allowed."""
    return (
        piece.fingerprint == settings.fingerprint
        and not piece.crashed
        and (piece.reason is None or piece.most_work >= settings.most_work)
        and not piece.needs_refinement(settings.mesh_error_limit)
    )


def campaign_table(pieces: Sequence[Piece]) -> pd.DataFrame:
    """The table of some designs: one row a design and step, in their order."""
    counts = [len(piece.status) for piece in pieces]
    columns: dict[str, Any] = {
        "design": np.repeat([piece.design.name for piece in pieces], counts),
        "a_percent": np.repeat([piece.design.a_percent for piece in pieces], counts),
        "b_percent": np.repeat([piece.design.b_percent for piece in pieces], counts),
        "step": np.concatenate([np.arange(1, count + 1) for count in counts]),
        "status": [status for piece in pieces for status in piece.status],
    }
    for name in NUMBERS:
        columns[name] = np.concatenate([np.array(piece.columns[name]) for piece in pieces])
    return table_of(columns)


def campaign_sidecar(settings: CampaignSettings, pieces: Sequence[Piece]) -> dict[str, Any]:
    """What the table does not say: settings, failures with their reasons, and the cost."""
    errors = np.concatenate([piece.columns["mesh_error_poisson"] for piece in pieces])
    overlap = [np.nanmax(np.nan_to_num(piece.columns["face_overlap_mm"])) for piece in pieces]
    cpu = np.array([piece.cpu_seconds for piece in pieces])
    known = errors[np.isfinite(errors)]
    return {
        "Schema": "kiribench.design-space/1",
        **settings.as_dict(),
        "Fingerprint": settings.fingerprint,
        "SignificantDigits": DIGITS,
        "Designs": len(pieces),
        "StepsOk": sum(piece.status.count("ok") for piece in pieces),
        "Incomplete": {
            piece.design.name: piece.reason for piece in pieces if piece.reason is not None
        },
        "MostIterations": settings.most_work,
        "FacesOverlap": {
            "MoreThanMm": OVERLAP_FLAG_MM,
            "Designs": [
                piece.design.name
                for piece, depth in zip(pieces, overlap, strict=True)
                if depth > OVERLAP_FLAG_MM
            ],
        },
        "MeshErrorPoisson": {
            "Largest": float(known.max()) if len(known) else None,
            "Rms": float(np.sqrt(np.mean(known**2))) if len(known) else None,
        },
        "RefinedMeshes": {
            piece.design.name: {
                "EdgesTimes": round(piece.mesh_scale, 6),
                "MeshErrorPoisson": piece.largest_mesh_error,
            }
            for piece in pieces
            if piece.mesh_scale < 1.0
        },
        "Cost": {
            "CpuSeconds": round(float(cpu.sum()), 1),
            "CpuSecondsPerDesign": {
                "Median": round(float(np.median(cpu)), 3),
                "Largest": round(float(cpu.max()), 3),
            },
            "DegreesOfFreedomLargest": max(piece.degrees_of_freedom for piece in pieces),
            "NewtonIterations": sum(piece.newton_iterations for piece in pieces),
            "NewtonIterationsLargest": max(piece.newton_iterations for piece in pieces),
        },
    }
