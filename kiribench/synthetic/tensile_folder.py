"""A folder of rendered frames, as a camera and a test machine would leave it, with its truth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from kiribench.synthetic.tensile_camera import Camera
from kiribench.synthetic.tensile_frames import Look, SheetMotion, render
from kiribench.synthetic.tensile_pattern import Pattern

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pulled:
    """A test to be rendered; s steps, R x C cells.

    Attributes:
        motions: the sheet at every step; the first is at rest.
        corner_mm: (s, R + 1, C + 1, 2) where the corners of the followed cells are.
        displacement_mm, force_n, time_s: (s,) of the machine.
    """

    motions: Sequence[SheetMotion]
    corner_mm: FloatArray
    displacement_mm: FloatArray
    force_n: FloatArray
    time_s: FloatArray


def true_stretches(corner_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(s, R, C) stretches along and across: mean of two opposite edges, over those at rest."""
    along = np.linalg.norm(np.diff(corner_mm, axis=1), axis=3)
    across = np.linalg.norm(np.diff(corner_mm, axis=2), axis=3)
    along, across = along / along[:1], across / across[:1]
    return 0.5 * (along[:, :, :-1] + along[:, :, 1:]), 0.5 * (across[:, :-1] + across[:, 1:])


def write_tensile_folder(
    folder: Path,
    pulled: Pulled,
    camera: Camera,
    pattern: Pattern,
    look: Look,
    sidecar: dict[str, Any],
    *,
    seed: int,
    kind: str = "png",
) -> Path:
    """Write frames, ``tensile.json``, ``machine.csv`` and ``truth.json``.

    Args:
        folder: made if it is not there. pulled: the test. camera, pattern, look: of the pictures.
        sidecar: what is not known from the rest: marker, cut, pitch_mm and the like; the block's
            corners, the times and the load table are added.
        seed: of the sensor's noise. kind: ``png``, ``tif`` or ``jpg``.
    """
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    names = [f"frame_{k:03d}.{kind}" for k in range(len(pulled.motions))]
    for k, (name, motion) in enumerate(zip(names, pulled.motions, strict=True)):
        picture = render(camera, motion, pattern, look, seed=seed + k)
        quality = [cv2.IMWRITE_JPEG_QUALITY, 97] if kind == "jpg" else []
        cv2.imwrite(str(folder / name), picture, quality)
    rest = pulled.corner_mm[0]
    four = np.array([rest[0, 0], rest[0, -1], rest[-1, -1], rest[-1, 0]])
    cells = {
        "rows": rest.shape[0] - 1,
        "columns": rest.shape[1] - 1,
        "corners_px": np.round(camera.project(four), 2).tolist(),
        **sidecar.get("cells", {}),
    }
    content = {
        "frame_times_s": pulled.time_s.tolist(),
        "load": {"file": "machine.csv", "event": {"frame": names[0], "time_s": 2.0}},
        **sidecar,
        "cells": cells,
    }
    _write_json(folder / "tensile.json", content)
    _write_machine(folder / "machine.csv", pulled)
    along, across = true_stretches(pulled.corner_mm)
    _write_json(
        folder / "truth.json",
        {
            "frames": names,
            "longitudinal_stretch": np.round(along, 7).tolist(),
            "lateral_stretch": np.round(across, 7).tolist(),
            "displacement_mm": pulled.displacement_mm.tolist(),
            "force_n": np.round(pulled.force_n, 6).tolist(),
        },
    )
    return folder


def _write_machine(path: Path, pulled: Pulled) -> None:
    """As an Instron exports it in Germany; the machine's clock runs 2 s ahead of the camera's."""
    lines = ["Specimen;1", "Time;Extension;Load", "(s);(mm);(N)"]
    fine = np.linspace(pulled.time_s[0] - 1, pulled.time_s[-1] + 1, 20 * len(pulled.time_s))
    fine = np.union1d(fine, pulled.time_s)
    for t in fine:
        way = np.interp(t, pulled.time_s, pulled.displacement_mm)
        force = np.interp(t, pulled.time_s, pulled.force_n)
        lines.append(f"{t + 2.0:.4f};{way:.5f};{force:.6f}".replace(".", ","))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="\n")


def _write_json(path: Path, content: dict[str, Any]) -> None:
    text = json.dumps(content, indent=1)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")
