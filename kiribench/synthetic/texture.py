"""The scans' textures: skin with the drawn grid, or with the patch over it, as PNG bytes."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import map_coordinates

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
    u = (np.arange(width, dtype=np.float64) + 0.5) * (2 * half_u / width) - half_u
    v = (np.arange(height, dtype=np.float64) + 0.5) * (2 * half_v / height) - half_v
    q = np.stack(np.meshgrid(u, v), axis=-1)
    grid = grid_nodes(subject.layout)
    ink = _grid_ink(u, v, grid, subject.layout.grid.pitch_mm)
    ink = np.maximum(ink, _disc(q, grid[0, 0] - 12.0))
    ink = np.maximum(ink, _letters(subject, width, height))
    index = _skin_tone(q) * INK_LEVELS + _level(ink)
    if acquisition == "flex090worn":
        index = _with_patch(subject, _patch_points(subject, u, v), index)
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


def _grid_ink(u: FloatArray, v: FloatArray, grid: FloatArray, pitch: float) -> FloatArray:
    """(len(v), len(u)) ink of the drawn lines, with round ends."""
    upright, beyond_u = _off_line(u - grid[0, 0, 0], grid[0, -1, 0] - grid[0, 0, 0], pitch)
    level, beyond_v = _off_line(v - grid[0, 0, 1], grid[-1, 0, 1] - grid[0, 0, 1], pitch)
    # Beyond the grid both distances grow; within it only one of them counts.
    return np.maximum(
        _coverage(np.hypot(upright[None, :], beyond_v[:, None]), LINE_MM),
        _coverage(np.hypot(beyond_u[None, :], level[:, None]), LINE_MM),
    )


def _off_line(x: FloatArray, size: float, pitch: float) -> tuple[FloatArray, FloatArray]:
    """Distances to the nearest line at a multiple of the pitch in [0, size], and beyond it."""
    nearest = np.clip(np.round(x / pitch), 0, round(size / pitch)) * pitch
    return np.abs(x - nearest), np.maximum(np.maximum(-x, x - size), 0.0)


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


def _patch_points(subject: SyntheticSubject, u: FloatArray, v: FloatArray) -> FloatArray:
    """(len(v), len(u), 2) patch coordinates above the pixels, linear between points 1 mm apart.

    The mismatch bends over a centimetre: the interpolation errs by a hundredth of a mm.
    """
    coarse = [np.linspace(x[0], x[-1], len(x) // PIXELS_A_MM) for x in (u, v)]
    q = np.stack(np.meshgrid(*coarse), axis=-1)
    fine = np.meshgrid(
        np.linspace(0, len(coarse[1]) - 1, len(v)),
        np.linspace(0, len(coarse[0]) - 1, len(u)),
        indexing="ij",
    )
    p = subject.patch_relief.patch_point(q)
    return np.stack([map_coordinates(p[..., i], fine, order=1) for i in range(2)], axis=-1)


def _with_patch(
    subject: SyntheticSubject, points: FloatArray, index: NDArray[np.intp]
) -> NDArray[np.intp]:
    """The patch, its cell lines and its slits over the skin, given the pixels' patch points."""
    relief, cell = subject.patch_relief, subject.layout.patch.cell_mm
    near = relief.outside_mm(points) <= 0.0
    p = points[near]
    local = p + relief.half_mm
    inside = (np.abs(p) <= relief.half_mm).all(axis=-1)
    off_line = np.abs(local - np.round(local / cell) * cell)
    lines = np.where(inside, _coverage(off_line.min(axis=-1), LINE_MM), 0.0)
    slits = np.where(inside, _slits(local, cell), 0.0)
    base = SKIN_TONES * INK_LEVELS
    over = np.where(slits > 0.0, base + INK_LEVELS + _level(slits), base + _level(lines))
    out = index.copy()
    out[near] = over
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
