"""Broken nodes tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from zoo.damage import (
    LIMB,
    Case,
    add_columns,
    bytes_at,
    edit_cell,
    edit_text,
    move_nodes,
    nodes,
    void,
)


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
