"""Broken scans, and harmless ones that look so."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zoo.damage import (
    LIMB,
    Case,
    Damage,
    Meshes,
    both,
    bytes_at,
    converted,
    edit_json,
    move_mesh,
    move_nodes,
    replaced,
    scan,
    sidecar,
)

Vertices, Faces = NDArray[np.float64], NDArray[np.int64]


def unwelded(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    return v[f].reshape(-1, 3), np.arange(3 * len(f)).reshape(-1, 3)


def mirrored_scan(root: Path) -> None:
    flip = np.array([-1.0, 1.0, 1.0])
    poses = ("flex000", "flex090", "flex090worn")
    move_nodes(lambda g: g * flip)(root)
    move_mesh(lambda v, f: (v * flip, f[:, ::-1]), *poses)(root)


def mirrored_scan_with_old_winding(root: Path) -> None:
    flip = np.array([-1.0, 1.0, 1.0])
    move_nodes(lambda g: g * flip)(root)
    move_mesh(lambda v, f: (v * flip, f), "flex000", "flex090", "flex090worn")(root)


def with_vertex(index: int, value: float) -> Meshes:
    def change(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
        v = v.copy()
        v[index] = value
        return v, f

    return change


def cut_in_two(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    """Remove one ring of faces in the middle."""
    lines = LIMB.mesh_columns + 1
    row = f.min(axis=1) // lines
    return v, f[row != row.max() // 2 + 1]


def hole(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    """Remove the faces about the middle of an edge between two nodes of the grid."""
    place = 0.5 * (LIMB.nodes("flex090")[8, 6] + LIMB.nodes("flex090")[8, 7])
    gone = np.linalg.norm(v[f].mean(axis=1) - place, axis=1) < 6.0
    assert gone.any()
    return v, f[~gone]


def flap(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    """One third face on an inner edge: small enough to be dropped as a speck."""
    edge = f[len(f) // 4 + 12][:2]
    tip = v[edge].mean(axis=0) + np.array([0.0, 30.0, 0.0])
    return np.vstack([v, tip]), np.vstack([f, [*edge, len(v)]])


def wall(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    """A wall on an inner mesh line: its edges have three faces, and it is no speck."""
    lines = LIMB.mesh_columns + 1
    foot = np.arange(3 * lines, 4 * lines)
    top = np.arange(lines) + len(v)
    quads = np.stack([foot[:-1], foot[1:], top[1:], top[:-1]], axis=1)
    faces = np.vstack([f, quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return np.vstack([v, 1.5 * v[foot]]), faces


def bow_tie(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    """Two fans that touch in a corner of the margin: faces around it removed."""
    around = np.flatnonzero((f == LIMB.mesh_columns + 40).any(axis=1))
    assert len(around) == 6
    return v, np.delete(f, [around[0], around[-1]], axis=0)


def half_flipped(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    f = f.copy()
    f[::2] = f[::2, ::-1]
    return v, f


def speck(v: Vertices, f: Faces) -> tuple[Vertices, Faces]:
    triangle = np.array([[300.0, 0, 0], [301.0, 0, 0], [300.0, 1.0, 0]])
    return np.vstack([v, triangle]), np.vstack([f, np.arange(3) + len(v)])


def coloured(root: Path) -> None:
    lines = scan(root).read_text(encoding="ascii").splitlines()
    lines = [f"{line} 0.8 0.6 0.5" if line.startswith("v ") else line for line in lines]
    scan(root).write_text("\n".join(lines), encoding="ascii")


def hostile_library(root: Path) -> None:
    text = scan(root).read_text(encoding="ascii")
    scan(root).write_text(
        "mtllib ../../../../../../etc/passwd\nmtllib /dev/zero\n" + text, encoding="ascii"
    )


def cut_off(fraction: float, suffix: str = ".obj") -> Damage:
    def damage(root: Path) -> None:
        if suffix != ".obj":
            converted(suffix)(root)
        path = scan(root, suffix=suffix)
        data = path.read_bytes()
        path.write_bytes(data[: int(len(data) * fraction)])

    return damage


def ply(header: str, body: bytes = b"") -> bytes:
    return f"ply\nformat binary_little_endian 1.0\n{header}end_header\n".encode() + body


PLY_PROPERTIES = "property float x\nproperty float y\nproperty float z\n"
PLY_FACES = "property list uchar int vertex_indices\n"


def glb(document: dict[str, object], body: bytes = b"\0" * 16) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf(count: int, uri: str | None = None) -> dict[str, object]:
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3"},
            {"bufferView": 0, "componentType": 5125, "count": count, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 16}],
        "buffers": [{"byteLength": 16} | ({"uri": uri} if uri else {})],
    }


FINE = {"validate": 0, "measure": 0, "conform": 0, "harmless": True}

SCANS = (
    Case("empty scan", bytes_at(scan, b""), "scan-empty"),
    Case("text for a scan", bytes_at(scan, b"the scanner was out of order\n"), "obj-no-vertices"),
    Case("cut off in the vertices", cut_off(0.2), "obj-few-coordinates"),
    Case("cut off in the faces", cut_off(0.8), "obj-few-corners"),
    Case("cut off between two lines", move_mesh(lambda v, f: (v, f[: len(f) // 4])),
         "nodes-off-surface"),
    Case("NaN vertex", move_mesh(with_vertex(700, np.nan)), "mesh-nan-vertex"),
    Case("infinite vertex", move_mesh(with_vertex(700, np.inf)), "mesh-nan-vertex"),
    Case("huge coordinates", move_mesh(with_vertex(700, 1e30)), "mesh-huge"),
    Case("index out of range", move_mesh(lambda v, f: (v[:-5], f)), "obj-index-range"),
    Case("no faces", move_mesh(lambda v, f: (v, f[:0])), "obj-no-faces"),
    Case("all on one line", move_mesh(lambda v, f: (v * [0, 0, 1], f)), "mesh-no-area"),
    Case("three faces on an edge", move_mesh(wall), "mesh-nonmanifold"),
    Case("in two pieces", move_mesh(cut_in_two), "nodes-on-pieces"),
    Case("metres for millimetres", move_mesh(lambda v, f: (v / 1000, f)), "scan-units"),
    Case("millimetres for metres", edit_json(sidecar, Units="m"), "scan-units"),
    Case("inches for millimetres", move_mesh(lambda v, f: (v / 25.4, f)), "scan-units"),
    Case("mirrored scan", mirrored_scan, "grid-mirrored"),
    Case("mirrored scan, old winding", mirrored_scan_with_old_winding, "grid-mirrored"),
    Case("PLY with wrong counts", replaced(".ply", ply(
        f"element vertex 10\n{PLY_PROPERTIES}element face 100\n{PLY_FACES}", b"\0" * 50)),
        "mesh-unreadable"),
    Case("PLY that promises a terabyte", replaced(".ply", ply(
        f"element vertex 100000000000\n{PLY_PROPERTIES}element face 1\n{PLY_FACES}", b"\0" * 50)),
        "mesh-unreadable"),
    Case("STL that promises four thousand million faces", replaced(
        ".stl", b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 100), "mesh-unreadable"),
    Case("glTF that promises more than it holds", replaced(".glb", glb(gltf(10**9))),
         "mesh-unreadable"),
    Case("glTF that names files outside", replaced(
        ".gltf", json.dumps(gltf(1, "../../../../etc/passwd")).encode()), "scan-path-outside"),
    Case("GLB cut off", cut_off(0.5, ".glb"), "mesh-unreadable"),
    Case("STL cut off", cut_off(0.5, ".stl"), "mesh-unreadable"),
    Case("noise named PLY", replaced(".ply", bytes(range(256)) * 40), "mesh-unreadable"),
    Case("noise named GLB", replaced(".glb", bytes(range(256)) * 40), "mesh-unreadable"),
    Case("noise named STL", replaced(".stl", bytes(range(1, 256)) * 40), "mesh-unreadable"),
    Case("noise named OBJ", replaced(".obj", bytes(range(256)) * 40), "obj-not-text"),
    # Mended or harmless: the numbers must be those of the good scan.
    Case("unwelded", move_mesh(unwelded), "mesh-unwelded", **FINE, rounded=True),
    Case("duplicate faces", move_mesh(lambda v, f: (v, np.vstack([f, f[5:9]]))),
         "mesh-duplicate-faces", **FINE),
    Case("bow-tie", move_mesh(bow_tie), "mesh-bow-ties", **FINE),
    Case("half the faces turned", move_mesh(half_flipped), "mesh-winding", **FINE, rounded=True),
    Case("reversed winding", move_mesh(lambda v, f: (v, f[:, ::-1])), "mesh-inside-out",
         **FINE, rounded=True),
    Case("a flap", move_mesh(flap), "mesh-specks", **FINE),
    Case("a speck", move_mesh(speck), "mesh-specks", **FINE),
    Case("vertex colours only", coloured, "", **FINE),
    Case("hostile material library", hostile_library, "scan-path-outside", **FINE),
    Case("PLY", converted(".ply"), "", **FINE, rounded=True),
    Case("STL", converted(".stl"), "mesh-unwelded", **FINE, rounded=True),
    Case("GLB", converted(".glb"), "", **FINE, rounded=True),
    Case("centimetres that say so", both(
        move_mesh(lambda v, f: (v / 10, f)), edit_json(sidecar, Units="cm")), "",
        **FINE, rounded=True),
    Case("a hole under a path", move_mesh(hole), "mesh-holes", 0, 0, 0),
)  # fmt: skip
