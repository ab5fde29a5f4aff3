"""The scans' textures: skin with the drawn grid, or with the patch over it, as PNG bytes."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from kiribench.synthetic.jet import FloatArray
from kiribench.synthetic.subject import SyntheticSubject, grid_nodes

PIXELS_A_MM = 4
LINE_MM = 1.0
SLIT_MM = 0.7
SLIT_FRACTION = 0.6
LETTER_SCALE = 4
FIDUCIAL_MM = 4.0

INK_LEVELS = 8
SKIN_TONES = 6
_SKIN_DARK, _SKIN_LIGHT = np.array([196.0, 150.0, 126.0]), np.array([226.0, 184.0, 160.0])
_INK = np.array([38.0, 40.0, 74.0])
_PATCH, _CELL_LINE, _SLIT = (
    np.array([178.0, 190.0, 200.0]),
    np.array([214.0, 110.0, 30.0]),
    np.array([30.0, 34.0, 40.0]),
)


def texture_png(subject: SyntheticSubject, acquisition: str) -> bytes:
    """The texture of a scan; its axes are the material coordinates u (right) and v (down).

    The picture spans the scanned skin, ``2 half_extent_mm``. A dot marks the grid's proximal
    lateral corner; letters name subject, side and the proximal end, readable from outside.
    """
    half_u, half_v = subject.half_extent_mm
    width, height = round(2 * half_u * PIXELS_A_MM), round(2 * half_v * PIXELS_A_MM)
    u = (np.arange(width) + 0.5) * (2 * half_u / width) - half_u
    v = (np.arange(height) + 0.5) * (2 * half_v / height) - half_v
    q = np.stack(np.meshgrid(u, v), axis=-1)
    grid = grid_nodes(subject.layout)
    ink = _grid_ink(q, grid, subject.layout.grid.pitch_mm)
    ink = np.maximum(ink, _disc(q, grid[0, 0] - 12.0))
    ink = np.maximum(ink, _letters(subject, width, height))
    index = _skin_tone(q) * INK_LEVELS + _level(ink)
    if acquisition == "flex090worn":
        index = _with_patch(subject, q, index)
    picture = Image.fromarray(index.astype(np.uint8))
    picture.putpalette(_palette())
    buffer = io.BytesIO()
    picture.save(buffer, format="PNG", optimize=False, compress_level=9)
    return buffer.getvalue()


def _palette() -> bytes:
    mix = np.arange(INK_LEVELS)[:, None] / (INK_LEVELS - 1)
    pairs = [
        (_SKIN_DARK + (_SKIN_LIGHT - _SKIN_DARK) * tone / (SKIN_TONES - 1), _INK)
        for tone in range(SKIN_TONES)
    ]
    pairs += [(_PATCH, _CELL_LINE), (_PATCH, _SLIT)]
    colours = np.concatenate([base * (1.0 - mix) + ink * mix for base, ink in pairs])
    return np.round(colours).astype(np.uint8).tobytes()


def _level(ink: FloatArray) -> NDArray[np.intp]:
    return np.round(ink * (INK_LEVELS - 1)).astype(np.intp)


def _coverage(distance_mm: FloatArray, width_mm: float) -> FloatArray:
    """The share of a pixel that a line of the given width covers."""
    return np.asarray(np.clip(0.5 + (0.5 * width_mm - distance_mm) * PIXELS_A_MM, 0.0, 1.0))


def _grid_ink(q: FloatArray, grid: FloatArray, pitch: float) -> FloatArray:
    local = q - grid[0, 0]
    size = grid[-1, -1] - grid[0, 0]
    nearest = np.clip(np.round(local / pitch), 0, np.round(size / pitch)) * pitch
    off_line = np.abs(local - nearest)
    beyond = np.maximum(np.maximum(-local, local - size), 0.0)
    upright = _coverage(np.hypot(off_line[..., 0], beyond[..., 1]), LINE_MM)
    level = _coverage(np.hypot(off_line[..., 1], beyond[..., 0]), LINE_MM)
    return np.maximum(upright, level)


def _disc(q: FloatArray, centre: FloatArray) -> FloatArray:
    return _coverage(np.linalg.norm(q - centre, axis=-1), 2.0 * FIDUCIAL_MM)


def _skin_tone(q: FloatArray) -> NDArray[np.intp]:
    """Slow variations of the skin's colour, in steps."""
    u, v = q[..., 0], q[..., 1]
    wave = np.sin(u / 31.0 + 0.8 * np.sin(v / 47.0)) + np.sin(v / 39.0 + 1.1 * np.cos(u / 53.0))
    return np.round((0.5 + 0.22 * wave) * (SKIN_TONES - 1)).astype(np.intp)


def _letters(subject: SyntheticSubject, width: int, height: int) -> FloatArray:
    """Ink of the label above the grid; mirrored on a left leg, where u runs to the left."""
    side = subject.knee.build.side
    text = f"{subject.knee.label} {side.upper()} PROXIMAL"
    font = ImageFont.load_default_imagefont()
    left, top, right, bottom = font.getbbox(text)
    small = Image.new("L", (round(right - left) + 2, round(bottom - top) + 2))
    ImageDraw.Draw(small).text((1 - left, 1 - top), text, fill=255, font=font)
    label = small.resize(
        (small.width * LETTER_SCALE, small.height * LETTER_SCALE), Image.Resampling.NEAREST
    )
    if side == "left":
        label = label.transpose(Image.Transpose.FLIP_LEFT_RIGHT)
    canvas = Image.new("L", (width, height))
    canvas.paste(label, ((width - label.width) // 2, 8 * PIXELS_A_MM))
    return np.asarray(canvas, dtype=np.float64) / 255.0


def _with_patch(
    subject: SyntheticSubject, q: FloatArray, index: NDArray[np.intp]
) -> NDArray[np.intp]:
    """The patch, its cell lines and its slits over the skin."""
    relief, cell = subject.patch_relief, subject.layout.patch.cell_mm
    near = (np.abs(q - relief.centre) < relief.half_mm + 20.0).all(axis=-1)
    p = relief.patch_point(q[near])
    local = p + relief.half_mm
    inside = (np.abs(p) <= relief.half_mm).all(axis=-1)
    off_line = np.abs(local - np.round(local / cell) * cell)
    lines = np.where(inside, _coverage(off_line.min(axis=-1), LINE_MM), 0.0)
    slits = np.where(inside, _slits(local, cell), 0.0)
    base = SKIN_TONES * INK_LEVELS
    over = np.where(slits > 0.0, base + INK_LEVELS + _level(slits), base + _level(lines))
    out = index.copy()
    out[near] = np.where(relief.outside_mm(p) <= 0.0, over, out[near])
    return out


def _slits(local: FloatArray, cell: float) -> FloatArray:
    """Ink of a uniform cross-cut pattern: level slits at cell centres and corners, upright
    ones at mid-edges."""
    step = 0.5 * cell
    x, y = local[..., 0] / step, local[..., 1] / step
    row = np.round(y)
    along = x - (2.0 * np.round((x - row) / 2.0) + row)
    level = np.hypot(np.maximum(np.abs(along) - SLIT_FRACTION, 0.0), y - row)
    column = np.round(x)
    along = y - (2.0 * np.round((y - column - 1.0) / 2.0) + column + 1.0)
    upright = np.hypot(np.maximum(np.abs(along) - SLIT_FRACTION, 0.0), x - column)
    return _coverage(np.minimum(level, upright) * step, SLIT_MM)
