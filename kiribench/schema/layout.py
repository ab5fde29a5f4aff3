"""The drawn grid, the patch on it and the regions of the patch, as metadata.

Nothing here is a constant of the analysis: a dataset's ``dataset_description.json`` or a
subject's ``sub-X_layout.json`` may hold the keys ``BodyPart``, ``Grid``, ``Patch`` and
``Regions``, and what they leave out takes the knee's defaults (arXiv 2511.13941: a grid of
16 x 12 cells of 15 mm, a patch of 12 x 6 cells; the patch's place in the grid and the
region table are our choices, the paper gives none).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic.alias_generators import to_pascal

from kiribench.errors import DatasetError

_Count = Annotated[int, Field(ge=1, le=400)]
_Offset = Annotated[int, Field(ge=0, le=400)]
_Length = Annotated[float, Field(gt=0.0, le=1000.0)]
_Label = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,15}$")]

GRID_ACQUISITIONS = ("flex000", "flex090")
"""Bare scans: their nodes are the nodes of the drawn grid."""

PATCH_ACQUISITIONS = ("flex090worn",)
"""Worn scans: their nodes are the corners of the patch's cells."""

ACQUISITIONS = (*GRID_ACQUISITIONS, *PATCH_ACQUISITIONS)

NOMINAL_FLEXION_DEG = {"flex000": 0.0, "flex090": 90.0, "flex090worn": 90.0}


class _Metadata(BaseModel):
    """JSON keys in CamelCase, as in BIDS; wrong types and unknown keys are faults."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="forbid",
        alias_generator=to_pascal,
        populate_by_name=True,
        allow_inf_nan=False,
    )


class Grid(_Metadata):
    """The grid drawn on the skin.

    Attributes:
        rows, columns: number of cells; there are (rows + 1) x (columns + 1) nodes.
        pitch_mm: distance of neighbouring nodes as drawn, in the reference pose.
    """

    rows: _Count = 16
    columns: _Count = 12
    pitch_mm: _Length = 15.0

    @property
    def node_shape(self) -> tuple[int, int]:
        """(rows + 1, columns + 1)."""
        return self.rows + 1, self.columns + 1


class Patch(_Metadata):
    """The patch and its place in the grid.

    Attributes:
        rows, columns: number of cells.
        cell_mm: edge of a cell.
        row_offset, column_offset: the grid node under the patch's corner (0, 0);
            None centres the patch in the grid.
        thickness_mm: thickness of the sheet; the scanned face may lie this far above skin.
    """

    rows: _Count = 12
    columns: _Count = 6
    cell_mm: _Length = 15.0
    row_offset: _Offset | None = None
    column_offset: _Offset | None = None
    thickness_mm: Annotated[float, Field(ge=0.0, le=100.0)] = 2.0

    @property
    def node_shape(self) -> tuple[int, int]:
        """(rows + 1, columns + 1)."""
        return self.rows + 1, self.columns + 1


class Regions(_Metadata):
    """The region that each cell of the patch belongs to.

    Attributes:
        labels: one tuple a patch row of one label a patch column.
    """

    labels: tuple[tuple[_Label, ...], ...]

    @field_validator("labels", mode="before")
    @classmethod
    def _tuples(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return tuple(tuple(row) if isinstance(row, list) else row for row in value)
        return value

    @model_validator(mode="after")
    def _rectangular(self) -> Regions:
        if not self.labels or not self.labels[0]:
            raise ValueError("the region table is empty")
        if len({len(row) for row in self.labels}) != 1:
            raise ValueError("the region table's rows differ in length")
        return self

    @property
    def shape(self) -> tuple[int, int]:
        """(patch rows, patch columns)."""
        return len(self.labels), len(self.labels[0])

    @property
    def names(self) -> tuple[str, ...]:
        """The labels, each once, in the order in which the table first shows them."""
        return tuple(dict.fromkeys(label for row in self.labels for label in row))

    @classmethod
    def knee(cls, patch: Patch) -> Regions:
        """The knee's seven regions: S, I, LS, MS, LI, MI, P.

        For 12 x 6 cells: S = rows 0-1, I = rows 10-11, P = the two middle columns between
        them, LS and MS = the two lateral and medial columns of rows 2-5, LI and MI of rows
        6-9. Other sizes take the same proportions. Patches too small for that have one
        region, ``all``. The table is our choice (the paper names regions, not cells).
        """
        rows, columns = patch.rows, patch.columns
        if rows < 4 or columns < 3:
            return cls.single(patch)
        cap = max(1, round(rows / 6))
        side = max(1, round(columns / 3))
        if 2 * side >= columns:
            side = (columns - 1) // 2
        middle = (rows + 1) // 2
        table: list[tuple[str, ...]] = []
        for row in range(rows):
            if row < cap:
                table.append(("S",) * columns)
            elif row >= rows - cap:
                table.append(("I",) * columns)
            else:
                level = "S" if row < middle else "I"
                table.append(
                    (f"L{level}",) * side + ("P",) * (columns - 2 * side) + (f"M{level}",) * side
                )
        return cls(labels=tuple(table))

    @classmethod
    def single(cls, patch: Patch) -> Regions:
        """One region, ``all``: what a body part without a region table gets."""
        return cls(labels=(("all",) * patch.columns,) * patch.rows)


class LayoutMetadata(BaseModel):
    """The layout keys of a JSON file, each optional; other keys are someone else's."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="ignore",
        alias_generator=to_pascal,
        populate_by_name=True,
        allow_inf_nan=False,
    )

    body_part: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _-]{0,39}$")] | None = None
    grid: Grid | None = None
    patch: Patch | None = None
    regions: Regions | None = None

    @field_validator("regions", mode="before")
    @classmethod
    def _bare_table(cls, value: Any) -> Any:
        return {"labels": value} if isinstance(value, list) else value


@dataclass(frozen=True)
class Layout:
    """Grid, patch and regions of one subject; make it with :meth:`of` or :meth:`resolve`.

    Attributes:
        grid: the drawn grid.
        patch: the patch; its place in the grid is :attr:`patch_offset`.
        regions: table of patch.rows x patch.columns labels.
        body_part: lower-case name, such as ``knee``.
    """

    grid: Grid
    patch: Patch
    regions: Regions
    body_part: str = "knee"

    @classmethod
    def of(
        cls,
        grid: Grid | None = None,
        patch: Patch | None = None,
        regions: Regions | None = None,
        body_part: str = "knee",
    ) -> Layout:
        """A layout whose missing parts take their defaults.

        The default patch has cells as large as the grid's; the default regions are the
        knee's for a knee, else one region ``all``.

        Raises:
            DatasetError: ``regions-shape`` if the table does not match the patch.
        """
        grid = grid or Grid()
        patch = patch or Patch(cell_mm=grid.pitch_mm)
        if regions is None:
            regions = Regions.knee(patch) if body_part == "knee" else Regions.single(patch)
        if regions.shape != (patch.rows, patch.columns):
            raise DatasetError(
                "regions-shape",
                "The region table does not match the patch.",
                column="Regions",
                got=f"{regions.shape[0]} x {regions.shape[1]} labels",
                expected=f"{patch.rows} x {patch.columns}, one a patch cell",
                remedy="Give one list a patch row, with one label a patch column.",
            )
        return cls(grid, patch, regions, body_part)

    @classmethod
    def resolve(cls, *layers: LayoutMetadata) -> Layout:
        """The layout of a stack of metadata; later layers override earlier ones key by key.

        Raises:
            DatasetError: ``regions-shape``, or as :meth:`check_patch` if a patch is given.
        """
        grid: dict[str, Any] = {}
        patch: dict[str, Any] = {}
        regions: Regions | None = None
        body_part = "knee"
        for layer in layers:
            if layer.grid is not None:
                grid |= layer.grid.model_dump(exclude_unset=True)
            if layer.patch is not None:
                patch |= layer.patch.model_dump(exclude_unset=True)
            regions = layer.regions or regions
            body_part = (layer.body_part or body_part).strip().lower()
        drawn = Grid(**grid)
        layout = cls.of(drawn, Patch(**({"cell_mm": drawn.pitch_mm} | patch)), regions, body_part)
        if patch:
            layout.check_patch()
        return layout

    def check_patch(self) -> None:
        """Refuse a patch that does not fit the grid.

        Raises:
            DatasetError: ``patch-cell-size``, ``patch-not-centrable``, ``patch-outside-grid``.
        """
        self._offset("RowOffset", self.patch.row_offset, self.grid.rows, self.patch.rows)
        self._offset(
            "ColumnOffset", self.patch.column_offset, self.grid.columns, self.patch.columns
        )
        if abs(self.patch.cell_mm - self.grid.pitch_mm) > 1e-9 * self.grid.pitch_mm:
            raise DatasetError(
                "patch-cell-size",
                "The patch's cells are not as large as the grid's, so its corners have no nodes.",
                column="Patch.CellMm",
                got=f"{self.patch.cell_mm:g} mm",
                expected=f"{self.grid.pitch_mm:g} mm, the grid's pitch",
                remedy="Draw the grid with the patch's cell size, or correct the metadata.",
            )

    @property
    def patch_offset(self) -> tuple[int, int]:
        """(row, column) of the grid node under the patch's corner (0, 0).

        Raises:
            DatasetError: as :meth:`check_patch`.
        """
        self.check_patch()
        return (
            self._offset("RowOffset", self.patch.row_offset, self.grid.rows, self.patch.rows),
            self._offset(
                "ColumnOffset", self.patch.column_offset, self.grid.columns, self.patch.columns
            ),
        )

    def as_metadata(self) -> dict[str, Any]:
        """The layout as the keys of a JSON file, offsets and regions written out."""
        row, column = self.patch_offset
        patch = self.patch.model_copy(update={"row_offset": row, "column_offset": column})
        return {
            "BodyPart": self.body_part,
            "Grid": self.grid.model_dump(by_alias=True),
            "Patch": patch.model_dump(by_alias=True),
            "Regions": [list(row) for row in self.regions.labels],
        }

    def node_shape(self, acquisition: str) -> tuple[int, int]:
        """(node rows, node columns) of an acquisition: the grid's, or the patch's if worn."""
        if acquisition in PATCH_ACQUISITIONS:
            return self.patch.node_shape
        return self.grid.node_shape

    @staticmethod
    def _offset(key: str, given: int | None, cells: int, patch_cells: int) -> int:
        spare = cells - patch_cells
        if spare < 0 or (given is not None and given > spare):
            raise DatasetError(
                "patch-outside-grid",
                "The patch does not lie inside the grid.",
                column=f"Patch.{key}",
                got=f"offset {'centred' if given is None else given}, {patch_cells} patch cells",
                expected=f"at most {cells} grid cells",
                remedy="Describe the patch and its place under Patch (Rows, Columns, RowOffset, "
                "ColumnOffset), in grid cells from the proximal lateral corner.",
            )
        if given is not None:
            return given
        if spare % 2:
            raise DatasetError(
                "patch-not-centrable",
                "The patch cannot be centred on grid nodes: the spare cells are odd in number.",
                column=f"Patch.{key}",
                got=f"{patch_cells} patch cells in {cells} grid cells",
                expected="an offset",
                remedy=f"Give {key}: the grid node under the patch's proximal lateral corner.",
            )
        return spare // 2
