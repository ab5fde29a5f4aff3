"""Elements found again anywhere in a picture, after a step too large to follow.

Keypoints (SIFT; Lowe, IJCV 60, 2004) of the first picture are matched to those of the new one,
and each element's own matches vote for its similarity (RANSAC). Descriptors bear rotation and
scale, but little one-sided stretch; so where too few elements are found, the new picture is
shrunk along the pull and tried again.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from kiribench.tensile.elements import Elements

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]

STRETCHES = (1.0, 1.3, 1.7)
_PIXELS = 3.0e6
_VOTES = 5


class Keypoints:
    """Keypoints of the first picture, made when they are needed for the first time."""

    def __init__(self, picture: Float32Array, elements: Elements, pull: FloatArray) -> None:
        self._picture, self._elements, self._pull = picture, elements, pull
        self._found: tuple[FloatArray, Float32Array, IntArray] | None = None
        self._scale = min(1.0, float(np.sqrt(_PIXELS / picture.size)))

    def relocate(self, picture: Float32Array, wanted: IntArray) -> tuple[IntArray, FloatArray]:
        """Elements among ``wanted`` that were found, and their warps (k, 6)."""
        import cv2

        points, descriptors, owner = self._reference()
        left = {int(e) for e in wanted}
        found: list[int] = []
        warps: list[FloatArray] = []
        for stretch in STRETCHES:
            if not left or len(descriptors) < _VOTES:
                break
            there, features = _keypoints(picture, self._scale, self._pull, stretch)
            if len(features) < 2:
                continue
            pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(descriptors, features, k=2)
            kept = [p[0] for p in pairs if len(p) == 2 and p[0].distance < 0.85 * p[1].distance]
            one = np.array([p.queryIdx for p in kept], dtype=np.int64)
            two = np.array([p.trainIdx for p in kept], dtype=np.int64)
            if not len(one):
                continue
            for element in sorted(left):
                mine = owner[one] == element
                if mine.sum() < _VOTES:
                    continue
                warp = self._vote(element, points[one[mine]], there[two[mine]])
                if warp is not None:
                    found.append(element)
                    warps.append(warp)
            left -= set(found)
            if len(left) <= 0.5 * len(wanted):
                break
        return np.array(found, dtype=np.int64), np.array(warps).reshape(-1, 6)

    def _reference(self) -> tuple[FloatArray, Float32Array, IntArray]:
        if self._found is None:
            points, descriptors = _keypoints(self._picture, self._scale, self._pull, 1.0)
            owner = _owner(points, self._elements)
            on = owner >= 0
            self._found = points[on], descriptors[on], owner[on]
        return self._found

    def _vote(self, element: int, here: FloatArray, there: FloatArray) -> FloatArray | None:
        import cv2

        cv2.setRNGSeed(1)  # RANSAC draws; the same pictures give the same answer
        limit = 0.06 * float(self._elements.edge_px[element]) + 1.0
        matrix, inside = cv2.estimateAffinePartial2D(
            here, there, method=cv2.RANSAC, ransacReprojThreshold=limit
        )
        if matrix is None or inside is None or inside.sum() < _VOTES:
            return None
        good = inside.ravel().astype(bool)
        if good.sum() >= 12:
            finer, _ = cv2.estimateAffine2D(
                here[good], there[good], method=cv2.RANSAC, ransacReprojThreshold=limit
            )
            matrix = matrix if finer is None else finer
        turn = matrix[:, :2]
        if not 0.2 < np.linalg.det(turn) < 5.0:
            return None
        centre = self._elements.centre[element]
        moved = turn @ centre + matrix[:, 2] - centre
        return np.array(
            [moved[0], moved[1], turn[0, 0] - 1, turn[0, 1], turn[1, 0], turn[1, 1] - 1]
        )


def _keypoints(
    picture: Float32Array, scale: float, pull: FloatArray, stretch: float
) -> tuple[FloatArray, Float32Array]:
    """(n, 2) px of the full picture and (n, 128) descriptors, seen shrunk along the pull."""
    import cv2

    outer = np.outer(pull, pull)
    shrink = scale * (np.eye(2) - (1 - 1 / stretch) * outer)
    rows, columns = picture.shape
    corners = np.array([[0, 0], [columns, 0], [0, rows], [columns, rows]]) @ shrink.T
    low = corners.min(axis=0)
    size = np.ceil(corners.max(axis=0) - low).astype(int)
    levels = cv2.convertScaleAbs(picture)
    matrix = np.column_stack([shrink, -low])
    if scale != 1.0 or stretch != 1.0:
        levels = cv2.warpAffine(levels, matrix, (int(size[0]), int(size[1])), flags=cv2.INTER_AREA)
    sift = cv2.SIFT.create(nfeatures=12000, contrastThreshold=0.02, sigma=1.2)
    points, features = sift.detectAndCompute(levels, None)
    if not points:
        return np.zeros((0, 2)), np.zeros((0, 128), dtype=np.float32)
    place = np.array([point.pt for point in points]).reshape(-1, 2)
    full = (place - matrix[:, 2]) @ np.linalg.inv(shrink).T
    return full, np.asarray(features, dtype=np.float32)


def _owner(points: FloatArray, elements: Elements) -> IntArray:
    """(n,) the element that a point lies in, or -1."""
    owner = np.full(len(points), -1, dtype=np.int64)
    for element in range(len(elements)):
        away = points - elements.centre[element]
        near = np.flatnonzero(np.abs(away).max(axis=1) < np.abs(elements.xi[element]).max())
        owner[near] = element
    return owner
