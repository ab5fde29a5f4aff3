"""The 3-D view: the flexed skin with both grids, loaded on click, without any network.

The plotly.js gl3d bundle (MIT, see ``vendor/LICENSE.plotly``) and the drawing travel in the
page, gzipped and in base64; a few lines of script inflate them when the reader asks. The page
allows exactly these two scripts, by their hashes.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.report.html import Html, tag
from kiribench.report.palette import GRADE_FILL, GRADE_LETTER, GRADES, INK, SKIN

PLOTLY = "plotly-gl3d-4.1.1.min.js.gz"
DIV_ID = "knee-3d"


@dataclass(frozen=True)
class Viewer:
    """The parts of the page that make the 3-D view.

    Attributes:
        html: the stage with its button; to be placed in a section.
        payload: the packed data and the script; to be placed at the end of the body.
        script_hashes: what a Content-Security-Policy has to allow.
    """

    html: Html
    payload: Html
    script_hashes: tuple[str, ...]


def viewer(
    vertices_mm: NDArray[np.float64],
    faces: NDArray[np.int32],
    skin_mm: NDArray[np.float64],
    patch_mm: NDArray[np.float64],
    grades: NDArray[np.str_],
    hover: list[list[str]],
    slits_mm: NDArray[np.float64] | None = None,
) -> Viewer:
    """The 3-D view of one subject.

    Args:
        vertices_mm, faces: decimated skin, (n, 3) and (m, 3), in the front view's frame.
        skin_mm, patch_mm: (R, C, n, 3) outlines in the same frame; NaN where not scored.
        grades: (R, C) grade, or empty.
        hover: R x C words that appear over a cell's letter.
        slits_mm: (k, 2, 3) ends of the cuts in the same frame, or None.
    """
    drawn = traces(vertices_mm, faces, skin_mm, patch_mm, grades, hover)
    if slits_mm is not None and len(slits_mm):
        gap = np.full((len(slits_mm), 1, 3), np.nan)
        ends = np.concatenate([slits_mm, gap], axis=1).reshape(-1, 3)
        drawn.append(_line(ends, INK, 3, "cuts"))
    spec = {
        "data": drawn,
        "layout": _layout(vertices_mm),
        "config": {
            "displaylogo": False,
            "responsive": True,
            "modeBarButtonsToRemove": ["toImage", "resetCameraLastSave3d", "hoverClosest3d"],
        },
    }
    packed = json.dumps(spec, separators=(",", ":"), allow_nan=False).encode()
    script = _resource("viewer.js")
    payload = [
        _packed("view-library", files("kiribench.report").joinpath("vendor", PLOTLY).read_bytes()),
        _packed("view-data", gzip.compress(packed, 9, mtime=0)),
        tag("script", Html(script)),
    ]
    stage = tag(
        "div",
        tag("button", "Load the 3-D view", type="button", id="view-load", hidden=""),
        # The script empties this line when it runs.
        tag(
            "p",
            "The turning view needs scripts; the picture shows the same cells.",
            id="view-status",
            role="status",
            class_="quiet",
        ),
        tag("div", id=DIV_ID, class_="stage", hidden="", aria_label="3-D view of the patch cells"),
        class_="viewer",
    )
    return Viewer(stage, Html("\n".join(payload)), (_hash(script.encode()), _library_hash()))


def traces(
    vertices_mm: NDArray[np.float64],
    faces: NDArray[np.int32],
    skin_mm: NDArray[np.float64],
    patch_mm: NDArray[np.float64],
    grades: NDArray[np.str_],
    hover: list[list[str]],
) -> list[dict[str, Any]]:
    """The plotly traces: skin, skin cells, patch cells by grade, and one letter a cell."""
    index = np.uint16 if len(vertices_mm) <= np.iinfo(np.uint16).max else np.uint32
    skin: dict[str, Any] = {
        "type": "mesh3d",
        "color": "#e9e2dc",
        "hoverinfo": "skip",
        "name": "skin",
        "lighting": {"ambient": 0.55, "diffuse": 0.6, "specular": 0.05, "roughness": 0.9},
        "lightposition": {"x": -2000, "y": 3000, "z": 6000},
        **_xyz(vertices_mm),
    }
    skin |= {key: _typed(faces[:, i].astype(index)) for i, key in enumerate("ijk")}
    lines = [skin, _line(_loops(skin_mm, grades != ""), SKIN, 2, "skin cells")]
    for grade in GRADES:
        if np.any(grades == grade):
            loops = _loops(patch_mm, grades == grade)
            lines.append(_line(loops, _strong(grade), 6, f"patch cells, {grade}"))
    scored = np.argwhere(grades != "")
    if len(scored):
        lines.append(
            {
                "type": "scatter3d",
                "mode": "text",
                "textposition": "middle center",
                "name": "grades",
                "showlegend": False,
                "text": [GRADE_LETTER[str(grades[r, c])] for r, c in scored],
                "hovertext": [hover[r][c] for r, c in scored],
                "hoverinfo": "text",
                "textfont": {"size": 13, "color": INK, "weight": "bold"},
                **_xyz(np.array([_above(patch_mm[r, c]) for r, c in scored])),
            }
        )
    return lines


def _above(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """A point above the middle of a cell, clear of the skin that bulges inside it."""
    about = outline - outline.mean(axis=0)
    normal = np.cross(about, np.roll(about, -1, axis=0)).sum(axis=0)
    normal *= np.sign(normal[2]) / np.linalg.norm(normal)
    lift = 0.25 * float(np.linalg.norm(about, axis=1).max())
    return np.asarray(outline.mean(axis=0) + lift * normal)


def _strong(grade: str) -> str:
    """Line colours: the fills are too pale for lines on skin."""
    return {"good": "#2a78b5", "fair": "#e0a200"}.get(grade, GRADE_FILL[grade])


def _line(points: NDArray[np.float64], colour: str, width: int, name: str) -> dict[str, Any]:
    return {
        "type": "scatter3d",
        "mode": "lines",
        "name": name,
        "hoverinfo": "skip",
        "line": {"color": colour, "width": width},
        "connectgaps": False,
        **_xyz(points),
    }


def _loops(outlines: NDArray[np.float64], which: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(k, 3) closed outlines one after the other, a NaN row between two."""
    gap = np.full((1, 3), np.nan)
    parts = [np.vstack([outlines[r, c], outlines[r, c][:1], gap]) for r, c in np.argwhere(which)]
    return np.vstack(parts) if parts else gap


def _layout(vertices_mm: NDArray[np.float64]) -> dict[str, Any]:
    # The same scale along all axes; the longest side is one unit of the camera.
    extent = np.ptp(vertices_mm, axis=0)
    ratio = [round(float(side), 6) for side in extent / extent.max()]
    axis = {
        "visible": False,
        "showspikes": False,
    }
    return {
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": INK},
        "legend": {"orientation": "h", "x": 0, "y": 0, "yanchor": "top"},
        "scene": {
            "xaxis": axis,
            "yaxis": axis,
            "zaxis": axis,
            "aspectmode": "manual",
            "aspectratio": dict(zip("xyz", ratio, strict=True)),
            "dragmode": "orbit",
            "camera": {
                "eye": {"x": 0.0, "y": 0.0, "z": 1.3},
                "up": {"x": 0.0, "y": 1.0, "z": 0.0},
                "projection": {"type": "perspective"},
            },
        },
    }


def _xyz(points: NDArray[np.float64]) -> dict[str, Any]:
    return {key: _typed(points[:, i].astype(np.float32)) for i, key in enumerate("xyz")}


def _typed(array: NDArray[Any]) -> dict[str, str]:
    """A typed array as plotly.js reads it."""
    code = {"float32": "f4", "uint16": "u2", "uint32": "u4"}[array.dtype.name]
    little = np.ascontiguousarray(array.astype(array.dtype.newbyteorder("<")))
    return {"dtype": code, "bdata": base64.b64encode(little.tobytes()).decode("ascii")}


def _packed(name: str, data: bytes) -> Html:
    words = base64.b64encode(data).decode("ascii")
    return tag("script", Html(words), type="application/octet-stream", id=name)


def _resource(name: str) -> str:
    return files("kiribench.report").joinpath(name).read_text(encoding="utf-8")


def _hash(data: bytes) -> str:
    return "'sha256-" + base64.b64encode(hashlib.sha256(data).digest()).decode("ascii") + "'"


@cache
def _library_hash() -> str:
    packed = files("kiribench.report").joinpath("vendor", PLOTLY).read_bytes()
    return _hash(gzip.decompress(packed))
