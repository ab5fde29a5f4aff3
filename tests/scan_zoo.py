"""Broken scans: builders that write one into a folder, and what must come of it.

Every case names the fault code that reading, checking and repairing the scan must end with, and
the exit code of a command that meets it: 3 for an error, 0 where a warning is all.
"""

from __future__ import annotations

import gzip
import json
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scan_shapes import on_knee, surface_mesh

from kiribench.surface.mesh import Mesh

Writer = Callable[[Path, Mesh], Path]


@dataclass(frozen=True)
class Case:
    """A broken scan.

    Attributes:
        name: of the case.
        write: given a path without ending and a sound mesh (mm), writes the broken scan and
            returns its path, whose ending may differ from .obj.
        code: of the fault.
        exit_code: 3 for an error, 0 for a warning.
    """

    name: str
    write: Writer
    code: str
    exit_code: int = 3

    def __str__(self) -> str:
        return self.name


def sound_mesh() -> Mesh:
    """A knee-like surface without any fault."""
    return surface_mesh(on_knee(110, 150), 110, 150, 6.0, seed=3)


def obj_text(mesh: Mesh, *, header: str = "") -> str:
    lines = [header] if header else []
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices_mm]
    if mesh.uv is not None and mesh.face_uv is not None:
        lines += [f"vt {u:.6f} {v:.6f}" for u, v in mesh.uv]
        lines += [
            "f " + " ".join(f"{v + 1}/{t + 1}" for v, t in zip(face, uv, strict=True))
            for face, uv in zip(mesh.faces, mesh.face_uv, strict=True)
        ]
    else:
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces]
    return "\n".join(lines) + "\n"


def write_obj(base: Path, mesh: Mesh, *, header: str = "") -> Path:
    path = base.with_suffix(".obj")
    path.write_text(obj_text(mesh, header=header))
    return path


# Text edits -------------------------------------------------------------------------------


def _edited(change: Callable[[str], str | bytes]) -> Writer:
    def write(base: Path, mesh: Mesh) -> Path:
        path = base.with_suffix(".obj")
        content = change(obj_text(mesh))
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def _line(start: str, new: str) -> Writer:
    """Replace the third line that starts with ``start``."""

    def change(text: str) -> str:
        lines = text.split("\n")
        rows = [row for row, line in enumerate(lines) if line.startswith(start)]
        lines[rows[2]] = new
        return "\n".join(lines)

    return _edited(change)


def _cut_inside_last_index(base: Path, mesh: Mesh) -> Path:
    """The last face is at the scan's far end; its cut index names a vertex at the near end."""
    faces = mesh.faces[np.argsort(mesh.faces.max(axis=1), kind="stable")]
    text = obj_text(replace(mesh, faces=faces)).rstrip("\n")
    path = base.with_suffix(".obj")
    path.write_text(text[: text.rindex(" ") + 2])
    return path


# Meshes -----------------------------------------------------------------------------------


def _meshed(change: Callable[[Mesh], Mesh]) -> Writer:
    return lambda base, mesh: write_obj(base, change(mesh))


def _vertex(value: float) -> Writer:
    def change(mesh: Mesh) -> Mesh:
        xyz = mesh.vertices_mm.copy()
        xyz[inner_vertex(mesh), 1] = value
        return replace(mesh, vertices_mm=xyz)

    return _meshed(change)


def inner_vertex(mesh: Mesh) -> int:
    """A vertex near the middle of the scan."""
    centre = mesh.vertices_mm.mean(axis=0)
    return int(np.argmin(np.linalg.norm(mesh.vertices_mm - centre, axis=1)))


def _faces_at(mesh: Mesh, vertex: int) -> np.ndarray:
    return np.flatnonzero((mesh.faces == vertex).any(axis=1))


def _stacked(mesh: Mesh, xyz: object, faces: object) -> Mesh:
    """``mesh`` with vertices and faces appended; the new faces index the whole."""
    return Mesh(
        np.concatenate([mesh.vertices_mm, np.asarray(xyz, dtype=float).reshape(-1, 3)]),
        np.concatenate([mesh.faces, np.asarray(faces, dtype=np.int32).reshape(-1, 3)]),
    )


def with_fin(mesh: Mesh) -> Mesh:
    """A third face on the edges around an inner vertex, each larger than a speck."""
    vertex = inner_vertex(mesh)
    ring = np.setdiff1d(mesh.faces[_faces_at(mesh, vertex)], [vertex])
    tips = mesh.vertices_mm[ring] + np.array([0.0, 200.0, 0.0])
    new = len(mesh.vertices_mm) + np.arange(len(ring))
    return _stacked(mesh, tips, np.column_stack([np.full(len(ring), vertex), ring, new]))


def moebius(_: Mesh) -> Mesh:
    """A strip with one side."""
    around, across = 60, 4
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    offset = np.linspace(-15, 15, across)
    a, o = np.meshgrid(angle, offset, indexing="ij")
    radius = 60 + o * np.cos(a / 2)
    xyz = np.stack([radius * np.cos(a), radius * np.sin(a), o * np.sin(a / 2)], -1)
    faces = []
    for i in range(around):
        for j in range(across - 1):
            p, q = i * across + j, i * across + j + 1
            if i + 1 < around:
                r, s = p + across, q + across
            else:
                r, s = across - 1 - j, across - 2 - j
            faces += [(p, r, s), (p, s, q)]
    return Mesh(xyz.reshape(-1, 3), np.array(faces, dtype=np.int32))


def with_flat_faces(mesh: Mesh) -> Mesh:
    """A tenth of the faces have their corners on one line."""
    number = len(mesh.faces) // 10
    count = len(mesh.vertices_mm)
    start = np.arange(number) * [[1.0], [0.0], [0.0]]
    rows = np.stack(
        [start.T, start.T + np.array([0.3, 0, 0]), start.T + np.array([0.9, 0, 0])], axis=1
    )
    return _stacked(mesh, rows, count + np.arange(3 * number).reshape(-1, 3))


def unwelded(mesh: Mesh) -> Mesh:
    """Every face with its own three vertices."""
    faces = np.arange(3 * len(mesh.faces), dtype=np.int32).reshape(-1, 3)
    return Mesh(mesh.corners_mm.reshape(-1, 3), faces)


def with_bow_tie(mesh: Mesh) -> Mesh:
    """All faces around a vertex but two opposite ones removed."""
    around = _faces_at(mesh, inner_vertex(mesh))
    vertex = inner_vertex(mesh)
    others = [set(mesh.faces[face]) - {vertex} for face in around]
    first = 0
    second = next(k for k in range(1, len(around)) if not others[0] & others[k])
    gone = np.delete(around, [first, second])
    return replace(mesh, faces=np.delete(mesh.faces, gone, axis=0))


def with_hole(mesh: Mesh) -> Mesh:
    """Without the faces around one inner vertex, which stays without a face."""
    gone = _faces_at(mesh, inner_vertex(mesh))
    return replace(mesh, faces=np.delete(mesh.faces, gone, axis=0))


def with_speck(mesh: Mesh) -> Mesh:
    """One small triangle in the air."""
    count = len(mesh.vertices_mm)
    corner = mesh.vertices_mm.max(axis=0)
    xyz = corner + np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0]])
    return _stacked(mesh, xyz, [[count, count + 1, count + 2]])


def with_turned_faces(mesh: Mesh) -> Mesh:
    """A tenth of the faces wound the other way."""
    faces = mesh.faces.copy()
    faces[::10] = faces[::10][:, ::-1]
    return replace(mesh, faces=faces)


def two_pieces(mesh: Mesh) -> Mesh:
    """The same surface twice, far apart."""
    return _stacked(
        mesh, mesh.vertices_mm + np.array([300, 0, 0]), mesh.faces + len(mesh.vertices_mm)
    )


def with_needle(mesh: Mesh) -> Mesh:
    """A face split by a point on its longest side: one part has no area."""
    face = int(_faces_at(mesh, inner_vertex(mesh))[0])
    a, b, c = mesh.faces[face]
    count = len(mesh.vertices_mm)
    middle = mesh.vertices_mm[[a, b]].mean(axis=0)
    split = _stacked(mesh, middle, [[count, b, c], [a, count, c], [a, b, count]])
    return replace(split, faces=np.delete(split.faces, face, axis=0))


# Companions and hostile names ---------------------------------------------------------------


def _textured(mesh: Mesh) -> Mesh:
    xyz = mesh.vertices_mm
    uv = (xyz[:, [0, 2]] - xyz[:, [0, 2]].min(axis=0)) / np.ptp(xyz[:, [0, 2]], axis=0)
    return replace(mesh, uv=uv, face_uv=mesh.faces)


def _library(name: str) -> Writer:
    return lambda base, mesh: write_obj(base, _textured(mesh), header=f"mtllib {name}")


def _picture(name: str) -> Writer:
    def write(base: Path, mesh: Mesh) -> Path:
        library = base.with_suffix(".mtl")
        library.write_text(f"newmtl skin\nmap_Kd {name}\n")
        return write_obj(base, _textured(mesh), header=f"mtllib {library.name}\nusemtl skin")

    return write


def _linked_library(base: Path, mesh: Mesh) -> Path:
    outside = base.parent.parent / "outside.mtl"
    outside.write_text("newmtl skin\nmap_Kd skin.png\n")
    base.with_suffix(".mtl").symlink_to(outside)
    return write_obj(base, _textured(mesh), header=f"mtllib {base.with_suffix('.mtl').name}")


def _pipe_library(base: Path, mesh: Mesh) -> Path:
    os.mkfifo(base.with_suffix(".mtl"))
    return write_obj(base, _textured(mesh), header=f"mtllib {base.with_suffix('.mtl').name}")


# Other formats --------------------------------------------------------------------------------


def write_other(base: Path, mesh: Mesh, suffix: str) -> Path:
    """The sound mesh as .ply, .stl or .glb."""
    import trimesh

    path = base.with_suffix(suffix)
    shape = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    path.write_bytes(shape.export(file_type=suffix[1:]))
    return path


def _cut_other(suffix: str, share: float) -> Writer:
    def write(base: Path, mesh: Mesh) -> Path:
        path = write_other(base, mesh, suffix)
        content = path.read_bytes()
        path.write_bytes(content[: int(share * len(content))])
        return path

    return write


def _boastful_ply(base: Path, mesh: Mesh) -> Path:
    path = write_other(base, mesh, ".ply")
    old = f"element vertex {len(mesh.vertices_mm)}".encode()
    path.write_bytes(path.read_bytes().replace(old, b"element vertex 900000000000"))
    return path


def _boastful_stl(base: Path, mesh: Mesh) -> Path:
    path = write_other(base, mesh, ".stl")
    content = bytearray(path.read_bytes())
    content[80:84] = struct.pack("<I", 4_000_000_000)
    path.write_bytes(bytes(content))
    return path


def _point_ply(base: Path, mesh: Mesh) -> Path:
    path = base.with_suffix(".ply")
    head = "ply\nformat ascii 1.0\nelement vertex 3\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.write_text(head + "0 0 0\n10 0 0\n0 10 0\n")
    return path


def _outside_gltf(base: Path, mesh: Mesh) -> Path:
    size = mesh.vertices_mm.astype(np.float32).nbytes
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "../../../../../../etc/passwd", "byteLength": size}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": size}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": len(mesh.vertices_mm),
                "type": "VEC3",
            }
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    path = base.with_suffix(".gltf")
    path.write_text(json.dumps(document))
    return path


def _folder(base: Path, _: Mesh) -> Path:
    path = base.with_suffix(".obj")
    path.mkdir()
    return path


def _pipe(base: Path, _: Mesh) -> Path:
    path = base.with_suffix(".obj")
    os.mkfifo(path)
    return path


def _dangling(base: Path, _: Mesh) -> Path:
    path = base.with_suffix(".obj")
    path.symlink_to(base.parent / "moved-away.obj")
    return path


def _unknown(base: Path, mesh: Mesh) -> Path:
    path = base.with_suffix(".xyz")
    np.savetxt(path, mesh.vertices_mm)
    return path


CASES: tuple[Case, ...] = (
    # Files
    Case("empty file", _edited(lambda _: ""), "mesh-file-empty"),
    Case("dangling link", _dangling, "mesh-file-missing"),
    Case("folder", _folder, "mesh-file-not-regular"),
    Case("pipe", _pipe, "mesh-file-not-regular"),
    Case("unknown format", _unknown, "mesh-unknown-format"),
    Case("gzip", _edited(lambda text: gzip.compress(text.encode())), "obj-not-text"),
    Case("UTF-16", _edited(lambda text: text.encode("utf-16")), "obj-not-text"),
    Case("binary", _edited(lambda text: text[:90].encode() + bytes(400)), "obj-not-text"),
    Case("random bytes", _edited(lambda _: bytes(range(250, 0, -1)) * 9), "obj-no-vertices"),
    Case("comments only", _edited(lambda _: "# nothing\n# here\n"), "obj-no-vertices"),
    # Cut off
    Case("cut after vertices", _edited(lambda text: text[: text.index("f ")]), "obj-no-faces"),
    Case(
        "cut in a vertex",
        _edited(lambda text: text[:4000].rsplit(" ", 1)[0]),
        "obj-few-coordinates",
    ),
    Case("cut in a face", _edited(lambda text: text.rstrip().rsplit(" ", 1)[0]), "obj-few-corners"),
    Case("cut in an index", _cut_inside_last_index, "obj-truncated"),
    # Lines
    Case("decimal comma", _line("v ", "v 1,5 2,5 3,5"), "obj-bad-number"),
    Case("word for a number", _line("v ", "v 1.5 two 3"), "obj-bad-number"),
    Case("two signs", _line("v ", "v --1 2 3"), "obj-bad-number"),
    Case("two coordinates", _line("v ", "v 1 2"), "obj-few-coordinates"),
    Case("letters in a face", _line("f ", "f 1 2 c"), "obj-bad-corner"),
    Case("decimal in a face", _line("f ", "f 1 2 3.5"), "obj-bad-corner"),
    Case("two corners", _line("f ", "f 1 2"), "obj-few-corners"),
    Case("index too large", _line("f ", "f 1 2 999999"), "obj-index-range"),
    Case("index beyond 64 bits", _line("f ", "f 1 2 99999999999999999999"), "obj-index-range"),
    Case("index zero", _line("f ", "f 0 1 2"), "obj-index-range"),
    Case("negative too far", _line("f ", "f -1 -2 -999999"), "obj-index-range"),
    Case("texture index too large", _line("f ", "f 1/1 2/1 3/1"), "obj-index-range"),
    Case("mixed corners", _line("f ", "f 1/1 2 3/1"), "obj-mixed-corners"),
    # Geometry
    Case("NaN vertex", _vertex(float("nan")), "mesh-nan-vertex"),
    Case("infinite vertex", _vertex(float("inf")), "mesh-nan-vertex"),
    Case("one vertex far off", _vertex(1e300), "mesh-huge"),
    Case(
        "micrometres", _meshed(lambda m: replace(m, vertices_mm=1e3 * m.vertices_mm)), "mesh-huge"
    ),
    Case("metres", _meshed(lambda m: replace(m, vertices_mm=1e-3 * m.vertices_mm)), "mesh-tiny"),
    Case(
        "far from origin",
        _meshed(lambda m: replace(m, vertices_mm=m.vertices_mm + 4e6)),
        "mesh-far-off",
    ),
    Case(
        "no area",
        _meshed(lambda m: replace(m, vertices_mm=m.vertices_mm * [1, 0, 0])),
        "mesh-no-area",
    ),
    Case("many flat faces", _meshed(with_flat_faces), "mesh-degenerate"),
    Case("fins", _meshed(with_fin), "mesh-nonmanifold"),
    Case("one-sided", _meshed(moebius), "mesh-one-sided"),
    # Other formats
    Case("cut PLY", _cut_other(".ply", 0.6), "mesh-unreadable"),
    Case("boastful PLY", _boastful_ply, "mesh-unreadable"),
    Case("PLY of points", _point_ply, "mesh-no-faces"),
    Case("cut STL", _cut_other(".stl", 0.6), "mesh-unreadable"),
    Case("boastful STL", _boastful_stl, "mesh-unreadable"),
    Case("cut GLB", _cut_other(".glb", 0.6), "mesh-unreadable"),
    Case("GLB header only", _cut_other(".glb", 0.003), "mesh-unreadable"),
    Case("glTF that reads a system file", _outside_gltf, "scan-path-outside"),
    # Warnings: the scan is used, and the reader is told
    Case("library upwards", _library("../../../../../../etc/passwd"), "scan-path-outside", 0),
    Case("library absolute", _library("/etc/passwd"), "scan-path-outside", 0),
    Case("library on a drive", _library("C:\\Windows\\win.ini"), "scan-path-outside", 0),
    Case("library by link", _linked_library, "scan-path-outside", 0),
    Case("library is a pipe", _pipe_library, "scan-companion-missing", 0),
    Case("library missing", _library("gone.mtl"), "scan-companion-missing", 0),
    Case("picture upwards", _picture("../../../etc/hostname"), "scan-path-outside", 0),
    Case("picture from the net", _picture("http://example.org/skin.png"), "scan-path-outside", 0),
    Case("picture missing", _picture("gone.png"), "scan-companion-missing", 0),
    Case("unwelded", _meshed(unwelded), "mesh-unwelded", 0),
    Case(
        "duplicate faces",
        _meshed(lambda m: replace(m, faces=np.concatenate([m.faces, m.faces[:9]]))),
        "mesh-duplicate-faces",
        0,
    ),
    Case("flat face", _meshed(with_needle), "mesh-degenerate-faces", 0),
    Case("turned faces", _meshed(with_turned_faces), "mesh-winding", 0),
    Case("inside out", _meshed(lambda m: replace(m, faces=m.faces[:, ::-1])), "mesh-inside-out", 0),
    Case("bow-tie", _meshed(with_bow_tie), "mesh-bow-ties", 0),
    Case("speck", _meshed(with_speck), "mesh-specks", 0),
    Case("hole", _meshed(with_hole), "mesh-holes", 0),
    Case(
        "loose vertex", _meshed(lambda m: _stacked(m, [np.nan, 0, 0], [])), "mesh-unreferenced", 0
    ),
    Case("two pieces", _meshed(two_pieces), "mesh-pieces", 0),
)
