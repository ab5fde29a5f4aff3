"""What a patch is to do: the strain and Poisson's ratio that every cell is asked for."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.dataset import Subject
from kiribench.design.target_table import TargetTable, read_targets
from kiribench.errors import UsageError
from kiribench.schema.layout import Layout
from kiribench.strain.measure import measure_subject
from kiribench.strain.measures import check_measure, strain_of
from kiribench.strain.result import StrainField, StrainMeasure
from kiribench.surface.acquisition import Denoise

FloatArray = NDArray[np.float64]
TextArray = NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """The targets of a patch; arrays are (R, C), row 0 proximal, column 0 lateral.

    Attributes:
        participant: id of the subject without ``sub-``; empty where there is none.
        side: of the body: ``left``, ``right`` or empty.
        cell_mm: cell edge, mm.
        thickness_mm: of the sheet, mm.
        strain_measure: of every strain and Poisson's ratio here.
        region: label of the cell's region; empty where there is none.
        longitudinal_strain: fraction; NaN where it was not measured.
        poisson_ratio: minus lateral over longitudinal strain; NaN where there is none.
        longitudinal_stretch, lateral_stretch: length ratios; NaN where unknown.
        reason: why the target is missing, as a code; empty where it is there.
        files: what was read, for the provenance.
        notes: facts that a reader needs, as sentences.
        measured_strain: whether the source gave strains; False where it gave stretches alone,
            which have no measure.
    """

    participant: str
    side: str
    cell_mm: float
    thickness_mm: float
    strain_measure: str
    region: TextArray
    longitudinal_strain: FloatArray
    poisson_ratio: FloatArray
    longitudinal_stretch: FloatArray
    lateral_stretch: FloatArray
    reason: TextArray
    files: tuple[Path, ...] = ()
    notes: tuple[str, ...] = field(default=())
    measured_strain: bool = True

    @property
    def shape(self) -> tuple[int, int]:
        """(R, C) cells down and across."""
        rows, columns = self.longitudinal_strain.shape
        return int(rows), int(columns)

    @property
    def wanted(self) -> NDArray[np.bool_]:
        """(R, C) whether the cell has a target: a strain and a Poisson's ratio."""
        return np.isfinite(self.longitudinal_strain) & np.isfinite(self.poisson_ratio)

    def in_measure(self, measure: str, *, min_strain: float = 1e-6) -> DesignProblem:
        """The same targets in another strain measure, by their stretches.

        Raises:
            UsageError: a target has no stretches, so there is nothing to convert.
        """
        check_measure(measure)
        if measure == self.strain_measure:
            return self
        known = np.isfinite(self.longitudinal_stretch) & np.isfinite(self.lateral_stretch)
        if (self.wanted & ~known).any():
            raise UsageError(
                "targets-without-stretches",
                "The targets have no stretches, so their strains cannot be converted.",
                remedy="Give longitudinal_stretch and lateral_stretch, as kiribench measure does.",
            )
        longitudinal = strain_of(self.longitudinal_stretch, measure)
        lateral = strain_of(self.lateral_stretch, measure)
        large = self.wanted & (np.abs(longitudinal) > min_strain)
        return replace(
            self,
            strain_measure=measure,
            longitudinal_strain=longitudinal,
            poisson_ratio=np.where(large, -lateral / np.where(large, longitudinal, 1.0), np.nan),
        )


def problem_from_strain(
    strain: StrainField, layout: Layout, *, side: str = "", files: tuple[Path, ...] = ()
) -> DesignProblem:
    """The cells under the patch of a measured grid."""
    rows, columns = layout.patch_offset
    part = (slice(rows, rows + layout.patch.rows), slice(columns, columns + layout.patch.columns))
    reason = np.where(strain.reason[part] != "", strain.reason[part], strain.poisson_reason[part])
    nu = strain.poisson_ratio.value[part]
    return DesignProblem(
        participant=strain.participant,
        side="" if side == "none" else side,
        cell_mm=layout.patch.cell_mm,
        thickness_mm=layout.patch.thickness_mm,
        strain_measure=strain.strain_measure,
        region=np.array(layout.regions.labels),
        longitudinal_strain=strain.longitudinal_strain.value[part],
        poisson_ratio=nu,
        longitudinal_stretch=strain.longitudinal_stretch.value[part],
        lateral_stretch=strain.lateral_stretch.value[part],
        # A ratio without a finite interval is a target all the same.
        reason=np.where(np.isfinite(nu), "", reason),
        files=files,
        notes=strain.notes,
    )


def problem_from_subject(
    subject: Subject,
    *,
    strain_measure: StrainMeasure = "log",
    min_strain: float = 0.03,
    denoise: Denoise = "auto",
) -> DesignProblem:
    """Measure the two bare scans of a subject and take the cells under the patch.

    Args:
        subject: with flex000 and flex090 complete.
        strain_measure: of the strains and of Poisson's ratio.
        min_strain: Poisson's ratio is masked below this longitudinal strain.
        denoise: ``auto``, ``always`` or ``never``.

    Raises:
        DatasetError, MeshError, NodesError, PathError: what is wrong with the input.
    """
    strain = measure_subject(
        subject, strain_measure=strain_measure, min_strain=min_strain, denoise=denoise
    )
    return problem_from_strain(
        strain, subject.layout, side=subject.side or "", files=tuple(subject.files)
    )


def problem_from_table(
    path: Path, *, strain_measure: str | None = None, cell_mm: float | None = None
) -> DesignProblem:
    """Read a table of targets: of ``kiribench measure``, or row, col, strain, Poisson's ratio.

    Args:
        path: TSV, CSV or Parquet, with a JSON sidecar of the same stem or without one.
        strain_measure: of the table's strains where it does not say so itself.
        cell_mm: cell edge where the table does not say it.

    Raises:
        TableError: with every fault found (see :mod:`kiribench.design.target_table`).
    """
    table = read_targets(path, strain_measure=strain_measure, cell_mm=cell_mm)
    return _of_table(table)


def _of_table(table: TargetTable) -> DesignProblem:
    part: tuple[slice, slice] = (slice(None), slice(None))
    layout = table.layout
    shape = table.longitudinal_strain.shape
    region = np.full(shape, "", dtype="<U16") if table.region is None else table.region
    if layout is not None:
        row, column = layout.patch_offset
        part = (slice(row, row + layout.patch.rows), slice(column, column + layout.patch.columns))
        region = np.array(layout.regions.labels)
    else:
        region = region[part]
    return DesignProblem(
        participant=table.participant,
        side=table.side,
        cell_mm=table.cell_mm,
        thickness_mm=table.thickness_mm,
        strain_measure=table.strain_measure,
        region=region,
        longitudinal_strain=table.longitudinal_strain[part],
        poisson_ratio=table.poisson_ratio[part],
        longitudinal_stretch=table.longitudinal_stretch[part],
        lateral_stretch=table.lateral_stretch[part],
        reason=table.reason[part],
        files=table.files,
        notes=table.notes,
        measured_strain=table.has_strain,
    )


def problem_settings(problem: DesignProblem) -> dict[str, Any]:
    """What a sidecar should say of the targets."""
    return {
        "TargetCells": int(problem.wanted.sum()),
        "TargetFiles": [path.name for path in problem.files],
    }
