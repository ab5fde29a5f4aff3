"""``tensile.json`` (or ``.toml``): what the pictures of a tensile test show."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from kiribench.errors import DatasetError, Fault
from kiribench.schema.strict_json import parse_json, parse_model

Point = tuple[float, float]
NAMES = ("tensile.json", "tensile.toml")
EXAMPLE = (
    '{"marker": "speckle", "cut": true, "cells": {"rows": 4, "columns": 3, "pitch_mm": 10, '
    '"corners_px": [[812, 640], [1412, 640], [1412, 1440], [812, 1440]]}}'
)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Cells(_Strict):
    """The block of cells that is followed, in the first picture.

    Attributes:
        rows, columns: cells along and across the pull.
        pitch_mm: edge of a cell; None where it is not known (stretches do not need it).
        corners_px: four corners of the block: (row 0, column 0), (0, last), (last, last),
            (last, 0); or two opposite ones, (0, 0) and (last, last), of an upright block.
        outline: the block is the whole sheet: nothing is looked for around it.
    """

    rows: int = Field(ge=1, le=400)
    columns: int = Field(ge=1, le=400)
    pitch_mm: float | None = Field(default=None, gt=0)
    corners_px: tuple[Point, ...]
    outline: bool = False

    @model_validator(mode="after")
    def _corners(self) -> Cells:
        if len(self.corners_px) not in (2, 4):
            raise ValueError("two opposite corners or all four")
        return self


class Lens(_Strict):
    """A camera calibration (OpenCV's model)."""

    focal_px: float = Field(gt=0)
    principal_px: Point
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0


class Target(_Strict):
    """Points of a printed target in the sheet's plane."""

    points_px: tuple[Point, ...] = Field(min_length=4)
    points_mm: tuple[Point, ...] = Field(min_length=4)

    @model_validator(mode="after")
    def _pairs(self) -> Target:
        if len(self.points_px) != len(self.points_mm):
            raise ValueError("as many points_mm as points_px")
        return self


class Ruler(_Strict):
    """Two points of known distance."""

    points_px: tuple[Point, Point]
    length_mm: float = Field(gt=0)


class Event(_Strict):
    """A moment seen by camera and machine: a frame, and the machine's time of it.

    ``time_s`` None means the machine's start: the crosshead's first motion.
    """

    frame: str
    time_s: float | None = None


class Load(_Strict):
    """The machine's table, and how its clock goes with the camera's.

    Attributes:
        file: in the folder. offset_s: machine's time of the first frame.
        event: instead of the offset.
        columns: names of time, displacement and force where they are not recognised.
    """

    file: str
    offset_s: float | None = None
    event: Event | None = None
    columns: dict[Literal["time", "displacement", "force"], str] = Field(default_factory=dict)


class Sample(_Strict):
    """The sample as the simulation of a comparison has to know it; None is not said.

    Attributes:
        grip_mm: uncut band between the cells and the clamp, at either end, mm.
        ends: ``held``: the clamps keep the width, ``sliding``: the ends are free to narrow.
        mu_mpa, alpha: shear modulus and exponent of an Ogden law; 2 is neo-Hookean.
        row, column: cell of the design at which the followed block begins.
    """

    grip_mm: float | None = Field(default=None, ge=0, alias="GripMm")
    ends: Literal["held", "sliding"] | None = Field(default=None, alias="Ends")
    mu_mpa: float | None = Field(default=None, ge=1e-6, alias="MuMpa")
    alpha: float | None = Field(default=None, ge=0.5, alias="Alpha")
    row: int | None = Field(default=None, ge=0, alias="Row")
    column: int | None = Field(default=None, ge=0, alias="Column")


class Sidecar(_Strict):
    """What the pictures show; see ``docs/tensile.md``.

    Attributes:
        marker: what is followed. cells: where.
        cut: whether the half cells' lines are cut (speckle only).
        pull: direction of the rows, for a block given by two corners.
        frames: names in their order; None takes every picture of the folder by number.
        frame_times_s, frame_rate_hz: when they were taken, by the camera.
        bright: markers are bright on dark.
        tilt: what the perspective is corrected by: the block's own regular grid, a printed
            target, nothing; ``auto`` takes the target, else the markers' grid if it is regular.
        lens: a calibration. target, ruler, mm_per_px: the scale.
        still_px: corners (x0, y0, x1, y1) of things that do not move: camera shake is removed.
        path: ``loading`` (growing stretch) or ``any``, for the check of the frames' order.
        sample: the key ``Specimen``. specimen: anything else about the sample, kept.
    """

    marker: Literal["speckle", "dots", "grid", "slits"]
    cells: Cells
    cut: bool = False
    pull: Literal["down", "up", "right", "left"] = "down"
    frames: tuple[str, ...] | None = None
    frame_times_s: tuple[float, ...] | None = None
    frame_rate_hz: float | None = Field(default=None, gt=0)
    bright: bool = False
    tilt: Literal["auto", "block", "target", "none"] = "auto"
    lens: Lens | None = None
    target: Target | None = None
    ruler: Ruler | None = None
    mm_per_px: float | None = Field(default=None, gt=0)
    still_px: tuple[tuple[float, float, float, float], ...] = ()
    path: Literal["loading", "any"] = "loading"
    load: Load | None = None
    sample: Sample | None = Field(default=None, alias="Specimen")
    specimen: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _sample_apart(self) -> Sidecar:
        known = {str(field.alias) for field in Sample.model_fields.values()}
        if misplaced := sorted(known & set(self.specimen)):
            raise ValueError(f'{", ".join(misplaced)} belongs under "Specimen", not "specimen"')
        return self

    @model_validator(mode="after")
    def _one_scale(self) -> Sidecar:
        if sum(x is not None for x in (self.target, self.ruler, self.mm_per_px)) > 1:
            raise ValueError("one of target, ruler and mm_per_px")
        if self.tilt == "target" and self.target is None:
            raise ValueError("tilt by target needs a target")
        return self


def read_sidecar(folder: Path, given: Path | None = None) -> tuple[Sidecar, Path]:
    """The sidecar of a folder of pictures, and its path.

    Args:
        folder: of the pictures. given: another file than ``tensile.json`` in it.

    Raises:
        DatasetError: no folder, no sidecar, or every fault found in it.
    """
    if not folder.is_dir():
        raise DatasetError(
            "tensile-folder",
            "There is no such folder of pictures.",
            remedy="Give the folder that holds the pictures and their tensile.json.",
            file=folder,
        )
    found = [given] if given else [folder / name for name in NAMES if (folder / name).is_file()]
    if len(found) != 1 or found[0] is None or not found[0].is_file():
        raise DatasetError(
            "tensile-sidecar-missing" if len(found) < 2 else "tensile-sidecar-twice",
            "What the pictures show is not declared by one file.",
            remedy=f"Write {NAMES[0]} beside the pictures, such as {EXAMPLE}",
            file=given or folder / NAMES[0],
        )
    path = found[0]
    if path.suffix == ".toml":
        try:
            content: dict[str, Any] | None = tomllib.loads(path.read_text(encoding="utf-8"))
            faults: tuple[Fault, ...] = ()
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise DatasetError(
                "toml-syntax",
                f"The file is not TOML: {error}.",
                remedy="Correct the line.",
                file=path,
            ) from error
    else:
        content, faults = parse_json(path.read_bytes(), file=str(path))
    if content is None:
        raise DatasetError.of(faults)
    model, wrong = parse_model(Sidecar, content, file=str(path))
    if model is None:
        raise DatasetError.of(wrong)
    return model, path
