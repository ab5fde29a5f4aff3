"""Drawings read back by programs that are not ours: ezdxf, svgelements, svgpathtools.

Each reader gives the strokes it sees, in mm, y down, in the order of the file. Nothing of the
writers is used here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from kiribench.errors import DataError, Fault
from kiribench.fabrication.strokes import FloatArray
from kiribench.fabrication.svg_guard import MOST_BYTES, look_into

SHORTEST_MM = 1e-7
"""A stroke of this length or less is no stroke."""


@dataclass(frozen=True, eq=False)
class ReadStroke:
    """A stroke as a reader sees it.

    Attributes:
        points_mm: (n, 2) flattened, mm, y down; a closed one repeats its start.
        length_mm: as the reader computes it.
        layer: name of the layer (DXF), or class of the path (SVG); empty where there is none.
        colour: ``#rrggbb``, empty where there is none.
    """

    points_mm: FloatArray
    length_mm: float
    layer: str
    colour: str

    @property
    def closed(self) -> bool:
        """Whether the stroke ends where it begins."""
        return len(self.points_mm) > 2 and bool(
            np.linalg.norm(self.points_mm[0] - self.points_mm[-1]) < 1e-4
        )


@dataclass(frozen=True, eq=False)
class ReadDrawing:
    """A file as one reader sees it.

    Attributes:
        reader: name of the library.
        strokes: in the order of the file.
        faults: what the file says that a laser's program may take amiss.
    """

    reader: str
    strokes: tuple[ReadStroke, ...]
    faults: tuple[Fault, ...]

    @property
    def length_mm(self) -> float:
        """Total length, mm."""
        return math.fsum(stroke.length_mm for stroke in self.strokes)

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """Bounding box (x0, y0, x1, y1), mm."""
        points = np.concatenate([stroke.points_mm for stroke in self.strokes])
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)


def read_drawing(path: Path) -> tuple[ReadDrawing, ...]:
    """The file as each independent reader of its format sees it: two for SVG, one for DXF.

    Raises:
        DataError: no such file, another format, or a file that no reader should be given
            (see :func:`svg_guard.look_into`) or can read; no strokes at all.
    """
    if not path.is_file():
        raise DataError(
            "drawing-missing", "There is no such file.", remedy="Check the path.", file=path
        )
    if path.stat().st_size > MOST_BYTES:
        raise DataError(
            "drawing-too-large",
            "The file is larger than any drawing here.",
            remedy="Save the drawing with nothing but its paths.",
            file=path,
            got=f"{path.stat().st_size} bytes",
        )
    from kiribench.fabrication.read_dxf import with_ezdxf
    from kiribench.fabrication.read_svg import with_svgelements, with_svgpathtools

    data = path.read_bytes()
    suffix = path.suffix.lower()
    drawings: tuple[ReadDrawing, ...]
    if suffix == ".svg":
        head = look_into(data, file=path)
        drawings = (with_svgelements(data, head, path), with_svgpathtools(data, head, path))
    elif suffix == ".dxf":
        drawings = (with_ezdxf(data, path),)
    else:
        raise DataError(
            "drawing-format",
            "Only SVG and DXF files can be verified.",
            remedy="Export the drawing as SVG or DXF.",
            file=path,
            got=path.suffix or "no suffix",
        )
    if not any(drawing.strokes for drawing in drawings):
        raise DataError(
            "drawing-empty",
            "No reader finds any line in the file.",
            remedy="Export the drawing again, with all layers switched on.",
            file=path,
        )
    return drawings


LIBRARY_ERRORS = (ValueError, KeyError, IndexError, AttributeError, TypeError, ZeroDivisionError)
"""What the reading libraries raise on content that they do not understand."""


def unreadable(path: Path, reader: str, error: Exception) -> DataError:
    """The error of a file that a reader gives up on."""
    return DataError(
        "drawing-unreadable",
        f"{reader} cannot read the file: {type(error).__name__}: {str(error)[:80]}.",
        remedy="Export it again; as plain SVG, or as DXF R2000 or R12.",
        file=path,
    )
