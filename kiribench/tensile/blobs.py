"""Dots, open slits and crossings of drawn lines: found as spots, to a part of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Blobs:
    """k spots of one picture.

    Attributes:
        px: (k, 2) centroids. area_px: (k,). sd_px: (k,) of a coordinate, by the noise.
        roundness: (k,) shortest / longest extent, 1 for a disc.
    """

    px: FloatArray
    area_px: FloatArray
    sd_px: FloatArray
    roundness: FloatArray

    def __len__(self) -> int:
        return len(self.px)


def find_blobs(
    picture: Float32Array, pitch_px: float, *, bright: bool, box: tuple[int, int, int, int]
) -> Blobs:
    """Dark (or bright) spots on an uneven ground within a box.

    Spots are found against the level around them (a grey closing over a pitch); the centroid is
    weighed by how far each pixel lies below the ring around its own spot, so that light which
    falls off does not move it.

    Args:
        picture: (h, w) brightness. pitch_px: distance of the markers.
        bright: the spots are brighter than their ground. box: (x0, y0, x1, y1) px.
    """
    import cv2

    x0, y0, x1, y1 = box
    x0, y0 = max(x0, 0), max(y0, 0)
    part = picture[y0 : y1 + 1, x0 : x1 + 1]
    if min(part.shape) < 8:
        return _none()
    depth_source = 255.0 - part if bright else part
    smooth = np.asarray(cv2.GaussianBlur(depth_source, (0, 0), 0.8), dtype=np.float32)
    ground = _ground(smooth, pitch_px)
    depth = ground - smooth
    noise = float(np.median(np.abs(part[:, 1:] - part[:, :-1]))) / 0.954
    strong = float(np.percentile(depth, 99.5))
    if strong < max(6.0, 3 * noise):
        return _none()
    mask = (depth > 0.5 * strong).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found = []
    rows, columns = part.shape
    for label in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[label])
        if area < 4 or area > 1.2 * pitch_px**2:
            continue
        if left == 0 or top == 0 or left + width == columns or top + height == rows:
            continue
        rim = 5
        u0, v0 = max(left - rim, 0), max(top - rim, 0)
        u1, v1 = min(left + width + rim, columns), min(top + height + rim, rows)
        core = labels[v0:v1, u0:u1] == label
        near = cv2.dilate(core.astype(np.uint8), np.ones((5, 5))) > 0
        own = near & ((mask[v0:v1, u0:u1] == 0) | core)
        ring = (cv2.dilate(core.astype(np.uint8), np.ones((9, 9))) > 0) & ~near
        ring &= mask[v0:v1, u0:u1] == 0
        level = (
            float(np.median(smooth[v0:v1, u0:u1][ring]))
            if ring.sum() >= 8
            else float(ground[v0:v1, u0:u1].mean())
        )
        raw = np.clip(level - depth_source[v0:v1, u0:u1], 0, None) * own
        weight = raw.astype(np.float64)
        total = float(weight.sum())
        if total <= 0:
            continue
        v, u = np.mgrid[v0:v1, u0:u1]
        cx, cy = float((weight * u).sum() / total), float((weight * v).sum() / total)
        du, dv = u - cx, v - cy
        cov = np.array(
            [
                [(weight * du * du).sum(), (weight * du * dv).sum()],
                [(weight * du * dv).sum(), (weight * dv * dv).sum()],
            ]
        )
        low, high = np.linalg.eigvalsh(cov / total)
        spread = 0.5 * float((own * (du * du + dv * dv)).sum())
        found.append(
            (cx + x0, cy + y0, area, noise * np.sqrt(spread) / total, np.sqrt(max(low, 0) / high))
        )
    if not found:
        return _none()
    table = np.array(found)
    return Blobs(table[:, :2], table[:, 2], table[:, 3], table[:, 4])


def _ground(smooth: Float32Array, pitch_px: float) -> Float32Array:
    """The level around the spots: a closing wider than any of them, in a smaller picture."""
    import cv2

    rows, columns = smooth.shape
    factor = max(1, int(pitch_px / 20))
    size = (max(8, columns // factor), max(8, rows // factor))
    small = cv2.resize(smooth, size, interpolation=cv2.INTER_AREA) if factor > 1 else smooth
    wide = max(3, 2 * round(0.45 * pitch_px / factor) + 1)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (wide, wide))
    closed = cv2.blur(cv2.morphologyEx(small, cv2.MORPH_CLOSE, kernel), (wide, wide))
    if factor > 1:
        closed = cv2.resize(closed, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.asarray(closed, dtype=np.float32)


def find_crossings(
    picture: Float32Array, pitch_px: float, *, bright: bool, box: tuple[int, int, int, int]
) -> Blobs:
    """Crossings of drawn lines, to a pixel: where a blurred picture is darkest."""
    import cv2

    x0, y0, x1, y1 = box
    x0, y0 = max(x0, 0), max(y0, 0)
    part = picture[y0 : y1 + 1, x0 : x1 + 1]
    if min(part.shape) < 8:
        return _none()
    dark = part if not bright else 255.0 - part
    blurred = cv2.GaussianBlur(dark, (0, 0), max(1.0, 0.08 * pitch_px))
    wide = max(3, 2 * round(0.3 * pitch_px) + 1)
    lowest = cv2.erode(blurred, np.ones((wide, wide)))
    rim = round(0.3 * pitch_px) + 1
    v, u = np.nonzero(blurred <= lowest)
    inner = (u > rim) & (v > rim) & (u < part.shape[1] - rim) & (v < part.shape[0] - rim)
    u, v = u[inner], v[inner]
    # Between the lines, on all four sides, the ground must be seen: else it is the sheet's rim.
    away = round(0.25 * pitch_px)
    around = [blurred[v + i * away, u + j * away] for i in (-1, 1) for j in (-1, 1)]
    depth = np.min(around, axis=0) - blurred[v, u]
    if not len(depth) or depth.max() < 6.0:
        return _none()
    good = (depth > 6.0) & (depth > 0.5 * np.percentile(depth[depth > 6.0], 75))
    px = np.column_stack([u[good] + x0, v[good] + y0]).astype(np.float64)
    ones = np.ones(len(px))
    return Blobs(px, ones, 0.5 * ones, ones)


def _none() -> Blobs:
    empty = np.zeros(0)
    return Blobs(np.zeros((0, 2)), empty, empty, empty)
