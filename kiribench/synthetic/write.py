"""Synthetic subjects as a subject folder: scans, textures, nodes and truth tables.

Every byte follows from the parameters and the seed: floats have fixed decimals, keys and
rows have a fixed order, and nothing records a date or a machine.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from kiribench import __version__
from kiribench.errors import UsageError
from kiribench.schema.layout import ACQUISITIONS, NOMINAL_FLEXION_DEG
from kiribench.synthetic.knees import Knee
from kiribench.synthetic.subject import (
    Imperfections,
    Nodes,
    Scan,
    SyntheticSubject,
    subject,
)
from kiribench.synthetic.texture import texture_png
from kiribench.synthetic.truth_tables import (
    Table,
    edges_table,
    number,
    overlap_sidecar,
    overlap_table,
    strain_sidecar,
    strain_table,
)

README = """\
Synthetic knees with known truth, made by `kiribench synth`. No person was scanned.

Each subject has two bare scans (acq-flex000, acq-flex090) and one with a patch on the skin
(acq-flex090worn), each with a texture whose coordinates are the material coordinates of the
skin, and the nodes of the drawn grid or of the patch's cell corners. The worn scan is in a
frame of its own; the truth records the motion. Scans are different triangulations of smooth
closed-form surfaces; with the default options they have no noise.

derivatives/truth/sub-*/ holds the truth from the closed forms: sub-*_strain.tsv and
sub-*_edges.tsv (geodesic stretches), sub-*_overlap.tsv (areal overlap of the worn patch),
each with a JSON file that defines the columns and states the accuracy.

The strains imitate the heatmaps that arXiv 2511.13941 describes, and the patches' misfit was
chosen so that S1, S2 and S3 have 66, 58 and 56 of 72 cells at least fair, as the paper's
subjects had. They say nothing about real skin. Column sd_mm is the standard uncertainty that
an analysis should assume, also where the positions carry no noise. A file synth.json, where
there is one, is the record of the run and no part of the dataset.
"""

PARTICIPANT_COLUMNS = {
    "participant_id": "label of the subject folder",
    "side": "the leg: left or right",
    "description": "build, in words",
}


def write_dataset(
    root: Path,
    knees: Sequence[Knee],
    imperfections: Imperfections | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[SyntheticSubject, ...]:
    """Make the subjects and write them under ``root``.

    Args:
        root: a folder that does not exist or is empty.
        knees: the subjects.
        imperfections: resolution, noise, holes and the seed.
        progress: called with (done, total).

    Raises:
        UsageError: ``synth-not-empty``; choose an empty folder.
    """
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise UsageError(
            "synth-not-empty",
            "The output folder is not empty.",
            file=root,
            remedy="Choose a new folder: generated subjects are never mixed with other data.",
        )
    flaws = imperfections or Imperfections()
    root.mkdir(parents=True, exist_ok=True)
    made = []
    for index, knee in enumerate(knees):
        person = subject(knee, imperfections=flaws)
        _write_subject(root, person)
        made.append(person)
        if progress is not None:
            progress(index + 1, len(knees))
    _write_text(root / "README", README)
    _write_json(root / "dataset_description.json", _description(made[0], flaws))
    rows = [(f"sub-{p.knee.label}", p.knee.build.side, p.knee.description) for p in made]
    _write_table(root / "participants.tsv", (tuple(PARTICIPANT_COLUMNS), rows))
    described = {key: {"Description": text} for key, text in PARTICIPANT_COLUMNS.items()}
    _write_json(root / "participants.json", described)
    return tuple(made)


def _description(first: SyntheticSubject, flaws: Imperfections) -> dict[str, Any]:
    layout = first.layout
    row, column = layout.patch_offset
    return {
        "Name": "kiribench synthetic knees",
        "DatasetType": "raw",
        "License": "CC0-1.0",
        "ReferencesAndLinks": ["https://arxiv.org/abs/2511.13941"],
        "GeneratedBy": [{"Name": "kiribench synth", "Version": __version__}],
        "BodyPart": layout.body_part,
        "Grid": layout.grid.model_dump(by_alias=True),
        "Patch": {
            **layout.patch.model_dump(by_alias=True),
            "RowOffset": row,
            "ColumnOffset": column,
        },
        "Regions": [list(labels) for labels in layout.regions.labels],
        "Imperfections": asdict(flaws),
    }


def _write_subject(root: Path, person: SyntheticSubject) -> None:
    name = f"sub-{person.knee.label}"
    folder = root / name / "surf"
    truth = root / "derivatives" / "truth" / name
    folder.mkdir(parents=True)
    truth.mkdir(parents=True)
    for acquisition in ACQUISITIONS:
        stem = f"{name}_acq-{acquisition}"
        texture = f"{stem}_texture.png"
        (folder / texture).write_bytes(texture_png(person, acquisition))
        _write_text(
            folder / f"{stem}_scan.mtl",
            f"newmtl skin\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {texture}\n",
        )
        _write_text(
            folder / f"{stem}_scan.obj",
            obj_text(person.scans[acquisition], person.half_extent_mm, f"{stem}_scan.mtl"),
        )
        _write_json(folder / f"{stem}_scan.json", _scan_sidecar(person, acquisition))
        nodes = person.nodes[acquisition]
        _write_table(folder / f"{stem}_nodes.tsv", _nodes_table(nodes))
        _write_json(folder / f"{stem}_nodes.json", _nodes_sidecar(person, acquisition))
    _write_table(truth / f"{name}_strain.tsv", strain_table(person))
    _write_table(truth / f"{name}_edges.tsv", edges_table(person))
    _write_json(truth / f"{name}_strain.json", strain_sidecar())
    _write_table(truth / f"{name}_overlap.tsv", overlap_table(person))
    _write_json(truth / f"{name}_overlap.json", overlap_sidecar(person))


def obj_text(scan: Scan, half_extent_mm: tuple[float, float], material_file: str) -> str:
    """The scan as Wavefront OBJ: millimetres with 3 decimals, texture = material coordinates."""
    half = np.array(half_extent_mm)
    texture = 0.5 + 0.5 * scan.q / half
    texture[:, 1] = 1.0 - texture[:, 1]
    lines = [f"mtllib {material_file}", "usemtl skin"]
    for x, y, z in np.round(scan.vertices_mm, 3) + 0.0:
        lines.append(f"v {x:.3f} {y:.3f} {z:.3f}")
    for s, t in np.clip(np.round(texture, 4), 0.0, 1.0):
        lines.append(f"vt {s:.4f} {t:.4f}")
    for a, b, c in scan.faces + 1:
        lines.append(f"f {a}/{a} {b}/{b} {c}/{c}")
    return "\n".join(lines) + "\n"


def _scan_sidecar(person: SyntheticSubject, acquisition: str) -> dict[str, Any]:
    flaws = person.imperfections
    half_u, half_v = person.half_extent_mm
    return {
        "Units": "mm",
        "FlexionAngle": NOMINAL_FLEXION_DEG[acquisition],
        "Side": person.knee.build.side,
        "Scanner": "none: synthetic, kiribench synth",
        "Texture": f"sub-{person.knee.label}_acq-{acquisition}_texture.png",
        "TextureCoordinates": f"s = 0.5 + u / {2 * half_u:g}, t = 0.5 - v / {2 * half_v:g}; u "
        "lateral to medial, v proximal to distal, mm as drawn, from the grid's centre",
        "EdgeLengthMm": flaws.edge_mm,
        "ScanNoiseSdMm": flaws.noise_mm,
        "Holes": flaws.holes,
        "Worn": acquisition == "flex090worn",
    }


def _nodes_table(nodes: Nodes) -> Table:
    rows = []
    for row in range(nodes.xyz_mm.shape[0]):
        for col in range(nodes.xyz_mm.shape[1]):
            seen = not nodes.missing[row, col]
            place = [number(float(x), 4) if seen else "n/a" for x in nodes.xyz_mm[row, col]]
            status = "ok" if seen else "missing"
            rows.append((str(row), str(col), *place, number(nodes.sd_mm, 4), status))
    return ("row", "col", "x_mm", "y_mm", "z_mm", "sd_mm", "status"), rows


def _nodes_sidecar(person: SyntheticSubject, acquisition: str) -> dict[str, Any]:
    flaws = person.imperfections
    what = (
        "corners of the patch's cells, on top of the patch"
        if acquisition == "flex090worn"
        else "nodes of the grid drawn on the skin"
    )
    return {
        "Units": "mm",
        "NodeSdMm": person.nodes[acquisition].sd_mm,
        "Description": f"The {what}, on the smooth surface that the scan samples.",
        "row": "0 is proximal",
        "col": "0 is lateral",
        "sd_mm": "standard uncertainty along each surface direction that an analysis should "
        f"assume; the positions carry noise of standard deviation {flaws.node_noise_mm:g} mm",
        "status": "ok, or missing where the node was not found",
    }


def _write_table(path: Path, table: Table) -> None:
    columns, rows = table
    lines = ["\t".join(columns), *("\t".join(row) for row in rows)]
    _write_text(path, "\n".join(lines) + "\n")


def _write_json(path: Path, content: dict[str, Any]) -> None:
    _write_text(path, json.dumps(content, indent=2, ensure_ascii=True) + "\n")


def _write_text(path: Path, text: str) -> None:
    path.write_bytes(text.encode("utf-8"))
