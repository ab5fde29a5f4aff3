"""Ways to damage the good small dataset."""

from __future__ import annotations

import json
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
