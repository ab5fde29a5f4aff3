"""Textures show the drawn grid, the marks and the patch where the geometry has them."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image
from synthetic_subjects import stored_subject

from kiribench.synthetic.texture import PIXELS_A_MM, texture_png
from kiribench.synthetic.worn import RIM_MM


def _picture(label: str, acquisition: str) -> np.ndarray:
    data = texture_png(stored_subject(label), acquisition)
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=float)


def _at(picture: np.ndarray, q: np.ndarray, half: tuple[float, float]) -> np.ndarray:
    pixel = np.floor((q + half) * PIXELS_A_MM).astype(int)
    return picture[pixel[..., 1], pixel[..., 0]]


@pytest.mark.parametrize("label", ["S1", "S2"])
def test_lines_are_one_millimetre_wide_and_cross_at_the_nodes(label: str) -> None:
    person = stored_subject(label)
    picture = _picture(label, "flex000")
    half = person.half_extent_mm
    nodes = person.nodes["flex000"].q
    dark = np.array([38.0, 40.0, 74.0])
    np.testing.assert_array_equal(
        _at(picture, nodes[1:-1, 1:-1], half), np.broadcast_to(dark, (15, 11, 3))
    )
    # Skin at the cells' centres.
    assert (_at(picture, nodes[:-1, :-1] + 7.5, half)[..., 0] > 180.0).all()
    # Ink over a stretch across one line adds up to its width.
    row = picture[round((half[1] + 7.5) * PIXELS_A_MM)]
    span = slice(round((half[0] + 10.0) * PIXELS_A_MM), round((half[0] + 20.0) * PIXELS_A_MM))
    red = row[span, 0]
    skin = red.max()
    ink_mm = ((skin - red) / (skin - dark[0])).sum() / PIXELS_A_MM
    assert ink_mm == pytest.approx(1.0, abs=0.15)


def test_the_dot_marks_the_proximal_lateral_corner_alone() -> None:
    person = stored_subject("S1")
    picture, half = _picture("S1", "flex090"), person.half_extent_mm
    corners = person.nodes["flex000"].q[[0, 0, -1, -1], [0, -1, 0, -1]]
    red = _at(picture, corners + 12.0 * np.sign(corners), half)[:, 0]
    assert red[0] < 60.0 and (red[1:] > 150.0).all()


def test_the_label_of_a_left_leg_is_mirrored_to_be_readable() -> None:
    # u runs to the viewer's left on a left leg, so the texture holds the letters mirrored.
    def band(label: str) -> np.ndarray:
        picture = _picture(label, "flex000")
        return picture[4 * 6 : 4 * 20, 4 * 30 : -4 * 30, 0] < 100.0

    right, left = band("S1"), band("S2")
    columns = [np.flatnonzero(mask.any(axis=0)) for mask in (right, left)]
    assert right.any() and left.any()
    # The P of PROXIMAL: a full upright at its left, none at its right. Both labels end in it.
    first = [
        mask[:, c[-1] - 45 : c[-1] + 1] for mask, c in zip((right, left), columns, strict=True)
    ]
    upright = [block.sum(axis=0).max() for block in first]
    assert max(upright) > 20
    # L closes PROXIMAL on the right leg: its foot is the last ink; on the left one it is first.
    assert _lowest_last(right[:, : columns[0][-1] + 1]) and _lowest_last(
        left[:, columns[1][0] :][:, ::-1]
    )


def _lowest_last(mask: np.ndarray) -> bool:
    """Whether the outermost letter's ink lies low: the foot of an L."""
    last = mask[:, -12:]
    rows = np.flatnonzero(mask.any(axis=1))
    centre = np.average(np.arange(len(mask)), weights=last.sum(axis=1))
    return bool(centre > rows.mean())


def test_the_patch_hides_the_grid_where_it_lies_and_nowhere_else() -> None:
    person = stored_subject("S3")
    bare, worn = _picture("S3", "flex090"), _picture("S3", "flex090worn")
    height, width = bare.shape[:2]
    u = (np.arange(width) + 0.5) / PIXELS_A_MM - person.half_extent_mm[0]
    v = (np.arange(height) + 0.5) / PIXELS_A_MM - person.half_extent_mm[1]
    q = np.stack(np.meshgrid(u, v), axis=-1)
    q, bare, worn = q[::3, ::3], bare[::3, ::3], worn[::3, ::3]
    p = person.patch_relief.patch_point(q)
    beyond = (np.abs(p) - person.patch_relief.half_mm - RIM_MM).max(axis=-1)
    changed = (bare != worn).any(axis=-1)
    assert not changed[beyond > 0.1].any()
    assert changed[beyond < -0.1].mean() > 0.97


def test_the_bytes_repeat() -> None:
    person = stored_subject("S1")
    assert texture_png(person, "flex090worn") == texture_png(person, "flex090worn")
