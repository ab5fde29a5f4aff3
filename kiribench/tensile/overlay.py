"""What was followed, drawn into the pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from kiribench.tensile.frames import FrameList, decoded, list_frames, read_picture
from kiribench.tensile.result import MEASURED, TensileTest

FloatArray = npt.NDArray[np.float64]
UInt8Array = npt.NDArray[np.uint8]

FOLLOWED = (255, 150, 0)
LOST = (40, 60, 255)
LONGEST_PX = 900
"""Blue and red as OpenCV orders them; lost cells are also crossed out."""


def shown_frames(count: int) -> tuple[int, ...]:
    """First, middle and last frame."""
    return tuple(sorted({0, count // 2, count - 1}))


def overlay(picture: npt.NDArray[np.float32], test: TensileTest, frame: int) -> UInt8Array:
    """One picture with its cells: (h, w, 3) blue, green, red, at most ``LONGEST_PX`` long.

    Followed cells have a blue outline, lost ones a red cross where they were last seen.

    Args:
        picture: (h, w) brightness. test: as measured from it. frame: number of the picture.
    """
    import cv2

    scale = min(1.0, LONGEST_PX / max(picture.shape))
    grey = cv2.convertScaleAbs(picture)
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    drawn = cv2.cvtColor(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
    width = max(2, round(min(drawn.shape[:2]) / 200))

    def at(point: FloatArray) -> tuple[int, int]:
        x, y = (point + 0.5) * scale - 0.5
        return round(float(x) * 16), round(float(y) * 16)

    for k in range(len(test.cell)):
        r, c = int(test.row[k]), int(test.col[k])
        good = str(test.status[frame, k]) in MEASURED
        quad = _last_seen(test.corner_px, frame, r, c)
        if quad is None:
            continue
        points = np.array([at(point) for point in quad], dtype=np.int32)
        colour = FOLLOWED if good else LOST
        cv2.polylines(drawn, [points.reshape(-1, 1, 2)], True, colour, width, cv2.LINE_AA, shift=4)
        if not good:
            for one, two in ((0, 2), (1, 3)):
                ends = tuple(points[one].tolist()), tuple(points[two].tolist())
                cv2.line(drawn, ends[0], ends[1], colour, width, cv2.LINE_AA, shift=4)
    return np.asarray(drawn, dtype=np.uint8)


def _last_seen(corner_px: FloatArray, frame: int, r: int, c: int) -> FloatArray | None:
    """(4, 2) the corners of a cell in the latest frame up to this one in which all were seen."""
    for at in range(frame, -1, -1):
        block = corner_px[at, r : r + 2, c : c + 2]
        if np.isfinite(block).all():
            return np.array([block[0, 0], block[0, 1], block[1, 1], block[1, 0]])
    return None


def overlays(
    folder: Path, test: TensileTest, declared: tuple[str, ...] | None
) -> list[tuple[str, UInt8Array]]:
    """Name and overlay of the first, middle and last frame.

    Args:
        folder: of the pictures. test: as measured. declared: the frames, as in ``tensile.json``.
    """
    frames = list_frames(folder, declared)
    wanted = shown_frames(len(test.frame))
    return [(test.frame[k], overlay(picture, test, k)) for k, picture in _pictures(frames, wanted)]


def _pictures(
    frames: FrameList, wanted: tuple[int, ...]
) -> list[tuple[int, npt.NDArray[np.float32]]]:
    if not frames.video:
        return [(k, read_picture(frames.paths[k])) for k in wanted]
    with decoded(frames) as pictures:
        return [(k, picture) for k, picture in enumerate(pictures) if k in wanted]


def write_overlays(folder: Path, drawn: list[tuple[str, UInt8Array]]) -> list[Path]:
    """``overlay_first.png``, ``overlay_middle.png`` and ``overlay_last.png``; their paths."""
    import cv2

    words = ["first", "middle", "last"] if len(drawn) == 3 else ["first", "last"]
    paths = []
    for word, (_, picture) in zip(words, drawn, strict=True):
        path = folder / f"overlay_{word}.png"
        cv2.imwrite(str(path), picture)
        paths.append(path)
    return paths
