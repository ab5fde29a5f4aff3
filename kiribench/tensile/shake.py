"""The camera's own motion, from things in the picture that do not move."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kiribench.errors import DatasetError
from kiribench.tensile.camera import PlaneView
from kiribench.tensile.icgn import FOUND, make_templates, match

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]

STAY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""The affine map (2, 3) of a camera that stood still."""
_ZNCC = 0.7
_AWAY_PX = 60
"""A thing that is not where it was last is looked for so far around."""
_CONTRAST = 6.0
"""Standard deviation of grey levels, more than a sensor's noise."""


class StillThings:
    """Boxes of the first picture that show things at rest, such as the frame of the machine."""

    def __init__(
        self,
        first: Float32Array,
        boxes: tuple[tuple[float, float, float, float], ...],
        view: PlaneView,
        file: str,
    ) -> None:
        corner = np.array(boxes, dtype=np.float64)
        self._centre = np.round(0.5 * (corner[:, :2] + corner[:, 2:]))
        half = 0.5 * np.abs(corner[:, 2:] - corner[:, :2])
        count = int(np.clip(2 * half.max() + 1, 9, 41))
        step = np.linspace(-1, 1, count)
        unit = np.stack(np.meshgrid(step, step), -1).reshape(-1, 2)
        xi = unit[None] * half[:, None]
        self._templates = make_templates(first, self._centre, xi, np.zeros((len(corner), 6)))
        shown = self._templates.good & (self._templates.value.std(axis=1) > _CONTRAST)
        if not shown.all():
            at = int(np.argmin(shown))
            raise DatasetError(
                "tensile-still-box",
                "A box of still_px shows nothing that can be followed, or is not in the picture.",
                remedy="Frame something with contrast: a screw, print, a corner of the machine.",
                file=file,
                got=str(boxes[at]),
            )
        self._looks = [
            first[round(y - v) : round(y + v) + 1, round(x - u) : round(x + u) + 1].copy()
            for (x, y), (u, v) in zip(self._centre, half, strict=True)
        ]
        self._view = view
        self._rest = view.plane(self._centre)
        self._warp = np.zeros((len(corner), 6))

    def back(self, picture: Float32Array) -> tuple[FloatArray, float]:
        """(2, 3) affine map of the plane that undoes the camera's motion, and the motion's size.

        A shift from one box; from two or more a shift, turn and change of scale. The size is
        the largest shift of a box in units of the plane; NaN where a box is not found.
        """
        matches = match(picture, self._templates, self._warp, reach_px=40.0)
        good = (matches.code == FOUND) & (matches.zncc >= _ZNCC)
        if not good.all():
            matches = match(picture, self._templates, self._sought(picture))
            good = (matches.code == FOUND) & (matches.zncc >= _ZNCC)
        if not good.all():
            return STAY, float("nan")
        self._warp = matches.warp
        now = self._view.plane(self._centre + matches.warp[:, :2])
        size = float(np.linalg.norm(now - self._rest, axis=1).max())
        if len(now) == 1:
            return np.column_stack([np.eye(2), (self._rest - now)[0]]), size
        a, b = now[:, 0] + 1j * now[:, 1], self._rest[:, 0] + 1j * self._rest[:, 1]
        turn = np.vdot(a - a.mean(), b - b.mean()) / np.vdot(a - a.mean(), a - a.mean())
        shift = b.mean() - turn * a.mean()
        matrix = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
        return np.column_stack([matrix, [shift.real, shift.imag]]), size

    def _sought(self, picture: Float32Array) -> FloatArray:
        """(m, 6) warps, to a pixel, of where the things look most as at first."""
        import cv2

        start = self._warp.copy()
        rows, columns = picture.shape
        for k, look in enumerate(self._looks):
            high, wide = look.shape
            x, y = np.round(self._centre[k] + self._warp[k, :2]).astype(int)
            left, top = max(x - wide // 2 - _AWAY_PX, 0), max(y - high // 2 - _AWAY_PX, 0)
            right = min(x + wide // 2 + _AWAY_PX + 1, columns)
            bottom = min(y + high // 2 + _AWAY_PX + 1, rows)
            if right - left < wide or bottom - top < high:
                continue
            score = cv2.matchTemplate(picture[top:bottom, left:right], look, cv2.TM_CCOEFF_NORMED)
            _, _, _, (u, v) = cv2.minMaxLoc(score)
            there = np.array([left + u + wide // 2, top + v + high // 2])
            start[k] = [*(there - self._centre[k]), 0, 0, 0, 0]
        return start
