"""Broken datasets, each made from the good small one, and what must be said about them.

Science and the format's rules decide the code and the exit code; no case is here because a
program happened to behave so. ``harmless`` cases must give the numbers of the good dataset.
"""

from __future__ import annotations

import json
import os
import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from small_limb import Limb, write_nodes, write_obj

SURF = "sub-A/surf"
LIMB = Limb()
Damage = Callable[[Path], None]


@dataclass(frozen=True)
class Case:
    """One broken dataset.

    Attributes:
        name: for the test's id.
        damage: changes the good dataset in place.
        code: the fault that ``validate`` must report.
        validate, measure, conform: exit codes.
        harmless: the numbers of measure and conform must be those of the good dataset.
        rounded: coordinates are rounded, or faces cut or turned another way, so that cells
            are flattened about another face of the coarse mesh.
    """

    name: str
    damage: Damage
    code: str
    validate: int = 3
    measure: int = 3
    conform: int = 3
    harmless: bool = False
    rounded: bool = False


def scan(root: Path, pose: str = "flex090", suffix: str = ".obj") -> Path:
    return root / SURF / f"sub-A_acq-{pose}_scan{suffix}"


def sidecar(root: Path, pose: str = "flex090") -> Path:
    return root / SURF / f"sub-A_acq-{pose}_scan.json"


def nodes(root: Path, pose: str = "flex090") -> Path:
    return root / SURF / f"sub-A_acq-{pose}_nodes.tsv"


# --- building blocks ------------------------------------------------------------------------


def bytes_at(place: Callable[[Path], Path], data: bytes) -> Damage:
    return lambda root: void(place(root).write_bytes(data))


def void(_: object) -> None:
    return None


def edit_json(place: Callable[[Path], Path], **keys: object) -> Damage:
    def damage(root: Path) -> None:
        value = json.loads(place(root).read_text(encoding="utf-8")) | keys
        place(root).write_text(
            json.dumps({k: v for k, v in value.items() if v is not None}), encoding="utf-8"
        )

    return damage


def edit_text(place: Callable[[Path], Path], change: Callable[[str], str]) -> Damage:
    def damage(root: Path) -> None:
        path = place(root)
        text = path.read_text(encoding="utf-8")
        changed = change(text)
        assert changed != text
        path.write_text(changed, encoding="utf-8")

    return damage


def edit_cell(line: int, column: str, value: str, pose: str = "flex090") -> Damage:
    """Set one field of a nodes table; ``line`` as in an editor."""

    def damage(root: Path) -> None:
        lines = nodes(root, pose).read_text(encoding="utf-8").splitlines()
        fields = lines[line - 1].split("\t")
        fields[lines[0].split("\t").index(column)] = value
        lines[line - 1] = "\t".join(fields)
        nodes(root, pose).write_text("\n".join(lines), encoding="utf-8")

    return damage


def add_columns(header: str, fields: Callable[[int], str], pose: str = "flex090") -> Damage:
    """Append columns to a nodes table; ``fields`` of the data row's index."""

    def damage(root: Path) -> None:
        first, *rest = nodes(root, pose).read_text(encoding="utf-8").splitlines()
        lines = [f"{first}\t{header}"]
        lines += [f"{line}\t{fields(index)}" for index, line in enumerate(rest)]
        nodes(root, pose).write_text("\n".join(lines), encoding="utf-8")

    return damage


def move_nodes(change: Callable[[NDArray[np.float64]], NDArray[np.float64]], *poses: str) -> Damage:
    def damage(root: Path) -> None:
        for pose in poses or ("flex000", "flex090", "flex090worn"):
            grid = LIMB.patch_nodes(0.97) if pose == "flex090worn" else LIMB.nodes(pose)
            write_nodes(nodes(root, pose), change(grid))

    return damage


Meshes = Callable[
    [NDArray[np.float64], NDArray[np.int64]], tuple[NDArray[np.float64], NDArray[np.int64]]
]


def move_mesh(change: Meshes, *poses: str) -> Damage:
    def damage(root: Path) -> None:
        for pose in poses or ("flex090",):
            write_obj(scan(root, pose), *change(*LIMB.mesh(pose.removesuffix("worn"))))

    return damage


def both(*damages: Damage) -> Damage:
    def damage(root: Path) -> None:
        for one in damages:
            one(root)

    return damage


def converted(suffix: str) -> Damage:
    """Rewrite a scan in another format."""

    def damage(root: Path) -> None:
        import trimesh

        vertices, faces = LIMB.mesh("flex090")
        scan(root).unlink()
        trimesh.Trimesh(vertices, faces, process=False).export(scan(root, suffix=suffix))

    return damage


def replaced(suffix: str, data: bytes) -> Damage:
    """Replace a scan by ``data`` under another suffix."""

    def damage(root: Path) -> None:
        scan(root).unlink()
        scan(root, suffix=suffix).write_bytes(data)

    return damage


# --- the folder -----------------------------------------------------------------------------


def description(root: Path) -> Path:
    return root / "dataset_description.json"


def participants(root: Path) -> Path:
    return root / "participants.tsv"


def rename_subject(root: Path, name: str) -> None:
    (root / "sub-A").rename(root / name)


def subject_elsewhere(root: Path) -> None:
    shutil.move(root / "sub-A", root.parent / "elsewhere")
    (root / "sub-A").symlink_to(root.parent / "elsewhere", target_is_directory=True)


def scan_elsewhere(root: Path) -> None:
    shutil.move(scan(root), root.parent / "elsewhere.obj")
    scan(root).symlink_to(root.parent / "elsewhere.obj")


def scan_is_a_folder(root: Path) -> None:
    scan(root).unlink()
    scan(root).mkdir()


def scan_is_a_pipe(root: Path) -> None:
    scan(root).unlink()
    os.mkfifo(scan(root))


def files_swapped(root: Path) -> None:
    for place in (scan, nodes):
        one, other = place(root, "flex000"), place(root, "flex090")
        one.rename(root / "spare")
        other.rename(one)
        (root / "spare").rename(other)


def acquisition_gone(root: Path) -> None:
    for place in (scan, nodes, sidecar):
        place(root).unlink()


FOLDER = (
    Case("no such folder", lambda root: shutil.rmtree(root), "dataset-missing"),
    Case(
        "a file for a folder",
        lambda root: (shutil.rmtree(root), void(root.write_text("x")))[1],
        "dataset-missing",
    ),
    Case("no description", lambda root: description(root).unlink(), "description-missing"),
    Case("empty description", bytes_at(description, b""), "json-empty"),
    Case("key twice", bytes_at(description, b'{"Name": "a", "Name": "b"}'), "json-duplicate-key"),
    Case("NaN in JSON", bytes_at(description, b'{"Name": "a", "X": NaN}'), "json-not-finite"),
    Case("name is a number", bytes_at(description, b'{"Name": 1}'), "json-value"),
    Case("UTF-16", bytes_at(description, '{"Name": "a"}'.encode("utf-16")), "text-encoding"),
    Case("nested too deep", bytes_at(description, b'{"a":' * 50_000), "json-syntax"),
    Case(
        "byte order mark",
        bytes_at(description, b'\xef\xbb\xbf{"Name": "a"}'),
        "text-bom",
        0,
        0,
        0,
        harmless=True,
    ),
    Case("no subject", lambda root: shutil.rmtree(root / "sub-A"), "dataset-empty"),
    Case(
        "HTML in a folder's name",
        lambda root: rename_subject(root, "sub-<img src=x onerror=alert(1)>"),
        "participant-id",
    ),
    Case("dots in a folder's name", lambda root: rename_subject(root, "sub-.."), "participant-id"),
    Case(
        "HTML in the table",
        bytes_at(participants, b"participant_id\n<script>alert(1)</script>\n"),
        "participant-id",
    ),
    Case(
        "path in the table",
        bytes_at(participants, b"participant_id\nA\n../../etc/passwd\n"),
        "participant-id",
    ),
    Case(
        "listed twice",
        bytes_at(participants, b"participant_id\nA\nsub-A\n"),
        "participant-duplicate",
    ),
    Case(
        "no table of participants",
        lambda root: participants(root).unlink(),
        "participants-missing",
        0,
        0,
        0,
        harmless=True,
    ),
    Case("subject linked from outside", subject_elsewhere, "path-outside"),
    Case("scan linked from outside", scan_elsewhere, "path-outside"),
    Case("scan missing", lambda root: scan(root).unlink(), "scan-missing"),
    Case("scan is a folder", scan_is_a_folder, "path-not-a-file"),
    Case("scan is a pipe", scan_is_a_pipe, "path-not-a-file"),
    Case(
        "two scans",
        lambda root: void(shutil.copy(scan(root), scan(root, suffix=".ply"))),
        "scan-ambiguous",
    ),
    Case("sidecar missing", lambda root: sidecar(root).unlink(), "sidecar-missing"),
    Case("no unit", edit_json(sidecar, Units=None), "json-key-missing"),
    Case("unknown unit", edit_json(sidecar, Units="furlong"), "json-value"),
    Case(
        "no side",
        both(
            bytes_at(participants, b"participant_id\nA\n"),
            *(
                edit_json(lambda root, p=pose: sidecar(root, p), Side=None)
                for pose in ("flex000", "flex090", "flex090worn")
            ),
        ),
        "side-missing",
    ),
    Case("two sides", edit_json(sidecar, Side="left"), "side-contradiction"),
    Case(
        "0 and 90 swapped in the sidecars",
        both(
            edit_json(sidecar, FlexionAngle=0),
            edit_json(lambda root: sidecar(root, "flex000"), FlexionAngle=90),
        ),
        "flexion-contradiction",
    ),
    Case("0 and 90 swapped in the files", files_swapped, "poses-swapped"),
    Case("no second pose", acquisition_gone, "acquisition-missing"),
    Case(
        "patch larger than the grid",
        bytes_at(description, b'{"Name": "a", "Patch": {"Rows": 20}}'),
        "patch-outside-grid",
    ),
    Case(
        "misspelt key of the grid",
        bytes_at(description, b'{"Name": "a", "Grid": {"Pitch": 10}}'),
        "json-key-unknown",
    ),
    Case(
        "absurd grid",
        bytes_at(description, b'{"Name": "a", "Grid": {"Rows": 1000000000}}'),
        "json-value",
    ),
    Case(
        "another grid than drawn",
        bytes_at(description, b'{"Name": "a", "Grid": {"Rows": 18}}'),
        "nodes-edge-missing",
    ),
    Case(
        "region table of another patch",
        bytes_at(description, b'{"Name": "a", "Regions": [["a", "b"], ["c", "d"]]}'),
        "regions-shape",
    ),
)

# --- the nodes ------------------------------------------------------------------------------


def commas(text: str) -> str:
    return text.replace("\t", ",")


def decimal_commas(text: str) -> str:
    return text.replace(".", ",")


def without_first_row(text: str) -> str:
    header, *rest = text.splitlines()
    return "\n".join([header, *(line for line in rest if not line.startswith("0\t"))])


def renumbered_after_loss(text: str) -> str:
    """Row 0 lost and the others counted from 0 again: the worst silent error."""
    header, *rest = text.splitlines()
    kept = [line.split("\t", 1) for line in rest if not line.startswith("0\t")]
    return "\n".join([header, *(f"{int(row) - 1}\t{fields}" for row, fields in kept)])


def turned(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    return grid[..., [1, 2, 0]]


NODES = (
    Case("nodes missing", lambda root: nodes(root).unlink(), "nodes-missing"),
    Case("empty nodes", bytes_at(nodes, b""), "table-empty"),
    Case("header only", bytes_at(nodes, b"row\tcol\tx_mm\ty_mm\tz_mm\n"), "nodes-none"),
    Case("commas", edit_text(nodes, commas), "table-separator"),
    Case("decimal commas", edit_text(nodes, decimal_commas), "nodes-number"),
    Case(
        "not UTF-8",
        lambda root: void(nodes(root).write_bytes(nodes(root).read_bytes() + b"\xe4\t1\n")),
        "text-encoding",
    ),
    Case(
        "NUL bytes",
        lambda root: void(nodes(root).write_bytes(nodes(root).read_bytes() + b"\0\0\n")),
        "text-binary",
    ),
    Case("a picture", bytes_at(nodes, b"\x89PNG\r\n\x1a\n" + bytes(range(256))), "text-encoding"),
    Case(
        "no unit in the names",
        edit_text(nodes, lambda t: t.replace("_mm", "", 3)),
        "nodes-column-missing",
    ),
    Case("row short", edit_text(nodes, lambda t: t + "16\t12\t1.0\n"), "table-ragged"),
    Case("node twice", edit_text(nodes, lambda t: t + t.splitlines()[5] + "\n"), "nodes-duplicate"),
    Case("row out of the grid", edit_cell(7, "row", "17"), "nodes-index-range"),
    Case("border row lost", edit_text(nodes, without_first_row), "nodes-edge-missing"),
    Case(
        "border row lost and renumbered",
        edit_text(nodes, renumbered_after_loss),
        "nodes-edge-missing",
    ),
    Case("NaN coordinate", edit_cell(9, "y_mm", "nan"), "nodes-not-finite"),
    Case("huge coordinate", edit_cell(9, "y_mm", "1e30"), "nodes-coordinate-range"),
    Case("no coordinate", edit_cell(9, "y_mm", "n/a"), "nodes-coordinates-missing"),
    Case("text in a number", edit_cell(9, "x_mm", "<b>1</b>"), "nodes-number"),
    Case(
        "unknown status",
        add_columns("status", lambda i: "gone" if i == 3 else "ok"),
        "nodes-status",
    ),
    Case("negative sd", add_columns("sd_mm", lambda i: "-0.1" if i == 3 else "0.1"), "nodes-sd"),
    Case("half-given columns", add_columns("face\tb0", lambda i: "0\t1"), "nodes-columns-half"),
    Case(
        "half-given weights",
        add_columns("face\tb0\tb1\tb2", lambda i: "n/a\tn/a\tn/a\t" + ("1" if i == 3 else "n/a")),
        "nodes-barycentric-half",
    ),
    Case(
        "face out of range",
        add_columns(
            "face\tb0\tb1\tb2", lambda i: "99999999\t1\t0\t0" if i == 3 else "n/a\tn/a\tn/a\tn/a"
        ),
        "nodes-face-range",
    ),
    Case(
        "another face than the position",
        add_columns(
            "face\tb0\tb1\tb2", lambda i: "0\t1\t0\t0" if i == 99 else "n/a\tn/a\tn/a\tn/a"
        ),
        "nodes-face-mismatch",
    ),
    Case("nodes in metres", move_nodes(lambda g: g / 1000, "flex090"), "nodes-spacing"),
    Case("nodes in inches", move_nodes(lambda g: g / 25.4, "flex090"), "nodes-spacing"),
    Case(
        "nodes beside the scan",
        move_nodes(lambda g: g + np.array([0.0, 20.0, 0.0]), "flex090"),
        "nodes-off-surface",
    ),
    Case("nodes in another frame", move_nodes(turned, "flex090"), "nodes-off-surface"),
    Case(
        "nodes of another pose",
        move_nodes(lambda g: LIMB.nodes("flex000"), "flex090"),
        "nodes-off-surface",
    ),
    Case("columns from the medial side", move_nodes(lambda g: g[:, ::-1]), "grid-mirrored"),
    Case("rows from the distal side", move_nodes(lambda g: g[::-1]), "grid-mirrored"),
    Case(
        "all nodes in one place", move_nodes(lambda g: g * 0 + g[8, 6], "flex090"), "nodes-spacing"
    ),
    Case(
        "corners of the patch on the grid's table",
        edit_text(lambda root: nodes(root, "flex090worn"), lambda t: t + "13\t0\t1\t1\t1\n"),
        "nodes-index-range",
        measure=0,
    ),
)

# --- the scans ------------------------------------------------------------------------------

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
    Case("unwelded", move_mesh(unwelded), "mesh-unwelded", **FINE),
    Case("duplicate faces", move_mesh(lambda v, f: (v, np.vstack([f, f[5:9]]))),
         "mesh-duplicate-faces", **FINE),
    Case("bow-tie", move_mesh(bow_tie), "mesh-bow-ties", **FINE),
    Case("half the faces turned", move_mesh(half_flipped), "mesh-winding", **FINE),
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

CASES = (*FOLDER, *NODES, *SCANS)
