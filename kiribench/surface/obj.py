"""Wavefront OBJ by a fast path: one buffer of fixed size, two passes, compiled loops.

The format: http://paulbourke.net/dataformats/obj/ (Appendix B1 of the Advanced Visualizer
manual). Read are ``v`` (with vertex colours, as scanners write them), ``vt`` and ``f`` with
its four forms of corner, negative indices and polygons of any length (as a fan, like
trimesh); ``mtllib`` and ``usemtl`` lead to the texture. Normals, groups, lines and curves are
passed over.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import Fault, MeshError
from kiribench.surface import obj_state as slots
from kiribench.surface.files import regular_file
from kiribench.surface.mesh import FloatArray, IntArray
from kiribench.surface.mtl import texture_of
from kiribench.surface.obj_blocks import BLOCK_BYTES, blocks, count_lines

_MOST_NAMES = 256


@dataclass(frozen=True, eq=False)
class ObjContent:
    """An OBJ file as arrays, in the file's own unit.

    Attributes:
        vertices: (n, 3) float64.
        faces: (m, 3) int32, 0-based.
        uv: (k, 2) float64, or None.
        face_uv: (m, 3) int32 into ``uv``, or None.
        colours: (n, 3) uint8, or None.
        texture: the picture named by the materials, inside the scan's folder, or None.
        faults: warnings, never errors.
    """

    vertices: FloatArray
    faces: IntArray
    uv: FloatArray | None
    face_uv: IntArray | None
    colours: NDArray[np.uint8] | None
    texture: Path | None
    faults: tuple[Fault, ...]


def read_obj(path: Path, *, block_bytes: int = BLOCK_BYTES) -> ObjContent:
    """Read the OBJ file at ``path``; lengths stay in the file's unit.

    Args:
        path: the file.
        block_bytes: size of the read buffer; the result does not depend on it.

    Raises:
        MeshError: with the line number: ``obj-bad-number``, ``obj-few-coordinates``,
            ``obj-bad-corner``, ``obj-index-range``, ``obj-few-corners``,
            ``obj-mixed-corners``, ``obj-not-text``, ``obj-line-too-long``,
            ``obj-truncated``; or ``obj-no-vertices``, ``obj-no-faces``.
    """
    from kiribench.surface.obj_kernels import parse

    regular_file(path)
    lines = count_lines(path)
    # Pages of these arrays that are never written to take no memory.
    xyz = np.empty((lines, 3))
    rgb = np.empty((lines, 3), dtype=np.float32)
    uv = np.empty((lines, 2))
    faces = np.empty((lines, 3), dtype=np.int32)
    face_uv = np.empty((lines, 3), dtype=np.int32)
    state = np.zeros(slots.STATE_SIZE, dtype=np.int64)
    state[[slots.FORWARD, slots.FORWARD_UV]] = -1
    names = _Names()
    ends_in_newline = True
    for block, size in blocks(path, block_bytes):
        start = 0
        state[slots.NAMES] = 0
        while True:
            start = parse(block, start, size, state, xyz, rgb, uv, faces, face_uv)
            if state[slots.ERROR] != slots.FULL:
                break
            state[slots.ERROR] = slots.OK
            if max(int(state[slots.VERTICES]), int(state[slots.UVS])) >= lines:
                raise _changed(path)
            # More triangles than lines: polygons. (resize moves pages, it does not copy.)
            faces.resize((2 * len(faces) + size, 3), refcheck=False)
            face_uv.resize(faces.shape, refcheck=False)
        _raise_if_failed(path, state, block, size)
        if state[slots.NAMES]:
            names.collect(block, size)
        ends_in_newline = bool(block[size - 1] in (10, 13))
    vertices, uvs, triangles = (
        int(state[slot]) for slot in (slots.VERTICES, slots.UVS, slots.TRIANGLES)
    )
    if vertices == 0:
        raise MeshError(
            "obj-no-vertices",
            "The OBJ file holds no vertex (no line that starts with 'v').",
            remedy="Export the scan again as a triangle mesh in OBJ format.",
            file=path,
        )
    if triangles == 0:
        raise MeshError(
            "obj-no-faces",
            f"The OBJ file holds {vertices} vertices but no face.",
            remedy="Export the scan as a mesh, not as a point cloud; or the file was cut off.",
            file=path,
        )
    for largest, line, count, what in (
        (slots.FORWARD, slots.FORWARD_LINE, vertices, "vertices"),
        (slots.FORWARD_UV, slots.FORWARD_UV_LINE, uvs, "texture coordinates"),
    ):
        if state[largest] >= count:
            raise _out_of_range(path, int(state[line]), str(state[largest] + 1), count, what)
    xyz.resize((vertices, 3), refcheck=False)
    uv.resize((uvs, 2), refcheck=False)
    faces.resize((triangles, 3), refcheck=False)
    face_uv.resize((triangles, 3), refcheck=False)
    coloured = int(state[slots.COLOURED])
    rgb.resize((vertices if coloured else 0, 3), refcheck=False)
    rgb[: int(state[slots.FIRST_COLOURED])] = np.nan
    if not ends_in_newline and int(state[slots.LAST_ITEM]) == ord("f"):
        _refuse_cut_last_face(path, xyz, faces, int(state[slots.FACE_LINE]))
    faults: list[Fault] = []
    texture, texture_faults = texture_of(path, names.libraries, names.materials)
    faults += texture_faults
    bare = int(state[slots.BARE])
    textured = uvs > 0 and bare < triangles
    if textured and bare:
        face_uv[face_uv < 0] = uvs
        uv = np.concatenate([uv, np.zeros((1, 2))])
        faults.append(
            Fault(
                "obj-partial-uv",
                f"{bare} of {triangles} triangles have no texture coordinates; they get (0, 0).",
                remedy="Export the scan with texture coordinates on every face.",
                file=str(path),
                severity="warning",
            )
        )
    colours, colour_faults = _colours(path, rgb, coloured, vertices)
    faults += colour_faults
    return ObjContent(
        vertices=xyz,
        faces=faces,
        uv=uv if textured else None,
        face_uv=face_uv if textured else None,
        colours=colours,
        texture=texture if textured else None,
        faults=tuple(faults),
    )


def _changed(path: Path) -> MeshError:
    return MeshError(
        "obj-changed",
        "The file changed while it was being read.",
        remedy="Wait until it is written completely, then read it again.",
        file=path,
    )


class _Names:
    """The material libraries and materials that the file names, in order, once each."""

    def __init__(self) -> None:
        self.libraries: list[str] = []
        self.materials: list[str] = []

    def collect(self, block: NDArray[np.uint8], size: int) -> None:
        data = bytes(block[:size])
        for keyword, listed in ((b"mtllib", self.libraries), (b"usemtl", self.materials)):
            at = -1
            while len(listed) < _MOST_NAMES and (at := data.find(keyword, at + 1)) >= 0:
                start = max(data.rfind(b"\n", 0, at), data.rfind(b"\r", 0, at)) + 1
                if data[start:at].strip():
                    continue
                rest = data[at + len(keyword) : at + len(keyword) + 4096]
                if rest[:1] not in (b" ", b"\t"):
                    continue
                line = rest.splitlines()[0].decode("utf-8", errors="replace").strip()
                if line and line not in listed:
                    listed.append(line)


def _raise_if_failed(
    path: Path, state: NDArray[np.int64], block: NDArray[np.uint8], size: int
) -> None:
    code = int(state[slots.ERROR])
    if code == slots.OK:
        return
    row = int(state[slots.ERROR_LINE])
    at = int(state[slots.ERROR_AT])
    if (block[:size] == 0).any():
        code = slots.BINARY
    token = bytes(block[at : min(at + 24, size)]).split(maxsplit=1)
    got = repr(token[0].decode("utf-8", errors="replace")) if token else "the line's end"
    if code == slots.OUT_OF_RANGE:
        raise _out_of_range(path, row, got, int(state[slots.VERTICES]), "vertices")
    name, what, expected, remedy = {
        slots.BAD_NUMBER: (
            "obj-bad-number",
            "This is no number.",
            "a decimal number with a point",
            "Export with a decimal point (English number format).",
        ),
        slots.FEW_COORDINATES: (
            "obj-few-coordinates",
            "The vertex has too few coordinates.",
            "three numbers after v, one or two after vt",
            "The file is cut off or damaged here; export it again.",
        ),
        slots.BAD_CORNER: (
            "obj-bad-corner",
            "This is no corner of a face.",
            "v, v/vt, v//vn or v/vt/vn with whole numbers",
            "The file is damaged here; export it again.",
        ),
        slots.FEW_CORNERS: (
            "obj-few-corners",
            "The face has fewer than three corners.",
            "three corners or more",
            "The file is cut off or damaged here; export it again.",
        ),
        slots.MIXED_CORNERS: (
            "obj-mixed-corners",
            "Some corners of the face have texture coordinates and some have none.",
            "the same form for every corner of a face",
            "The file is cut off or damaged here; export it again.",
        ),
        slots.BINARY: (
            "obj-not-text",
            "The file holds binary data.",
            "OBJ text",
            "Export it as OBJ text, or give it the right ending.",
        ),
    }[code]
    raise MeshError(name, what, remedy=remedy, file=path, row=row, got=got, expected=expected)


def _out_of_range(path: Path, row: int, got: str, count: int, what: str) -> MeshError:
    return MeshError(
        "obj-index-range",
        "The face names a vertex or a texture coordinate that does not exist.",
        remedy="The file is damaged or cut off; export it again.",
        file=path,
        row=row,
        got=got,
        expected=f"1 to {count} ({what}), or negative to count backwards",
    )


def _refuse_cut_last_face(path: Path, xyz: FloatArray, faces: IntArray, row: int) -> None:
    """Refuse a last face whose last index was cut short (``12345`` read as ``12``).

    Without a final newline nothing else tells. Such a face jumps across the scan, so it is
    refused when its longest edge is over 8 times the longest of the 1,000 faces before it.
    """
    if len(faces) < 20:
        return

    def longest(rows: IntArray) -> float:
        corners = xyz[rows]
        edges = corners - np.roll(corners, -1, axis=1)
        return float(np.sqrt((edges**2).sum(axis=2).max()))

    if longest(faces[-1:]) > 8 * longest(faces[-1001:-1]):
        raise MeshError(
            "obj-truncated",
            "The file ends inside a face: its last index was cut short.",
            remedy="The copy is incomplete; copy or export the scan again.",
            file=path,
            row=row,
            got=f"a face with a {longest(faces[-1:]):.3g} long edge and no line end after it",
        )


def _colours(
    path: Path, rgb: NDArray[np.float32], coloured: int, vertices: int
) -> tuple[NDArray[np.uint8] | None, list[Fault]]:
    """Vertex colours as bytes: values up to 1 are fractions, otherwise they are bytes."""
    if not coloured:
        return None, []
    faults = []
    if coloured < vertices:
        faults.append(
            Fault(
                "obj-partial-colours",
                f"{vertices - coloured} of {vertices} vertices have no colour; "
                "they are shown white.",
                remedy="Export colours for every vertex, or for none.",
                file=str(path),
                severity="warning",
            )
        )
    missing = ~np.isfinite(rgb)
    scale = 255.0 if np.nanmax(rgb, initial=0.0) <= 1.0 else 1.0
    scaled = np.where(missing, 255.0, np.rint(rgb * np.float32(scale)))
    return np.clip(scaled, 0, 255).astype(np.uint8), faults
