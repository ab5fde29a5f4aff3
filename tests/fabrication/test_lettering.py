"""Letters as strokes."""

from __future__ import annotations

import itertools
import string

import numpy as np
import pytest

from kiribench.fabrication.lettering import drawable, fitting_height, text, text_width

LETTERS = string.ascii_uppercase + string.digits + "-_.,:/%+=()#×"


def _ink(letter: str) -> frozenset:
    return frozenset(
        (tuple(map(tuple, s.points_mm.round(6))), s.closed)
        for s in text("label", letter, (0, 0), 6)
    )


def test_every_letter_has_ink_of_its_own():
    assert all(_ink(letter) for letter in LETTERS)
    for one, two in itertools.combinations(LETTERS, 2):
        assert _ink(one) != _ink(two), (one, two)


@pytest.mark.parametrize("words", ["UP", "sub-S1 right", "0.05 mm", "W", "12 × 6"])
def test_text_stays_in_its_box(words):
    strokes = text("label", words, (10.0, 20.0), 3.0, anchor=0.5)
    points = np.concatenate([stroke.points_mm for stroke in strokes])
    half = text_width(words, 3.0) / 2
    assert np.all(np.abs(points[:, 0] - 10.0) <= half + 1e-9)
    assert np.all((points[:, 1] <= 20.0) & (points[:, 1] >= 17.0 - 1e-9))
    assert all(stroke.length_mm > 0 for stroke in strokes)


def test_letters_outside_of_the_font_become_a_box_and_accents_fall():
    assert drawable("é ß 漢 <") == "E SS ? ?"
    assert len(text("label", "漢", (0, 0), 3.0)) == 1


def test_fitting_height():
    assert fitting_height("RIGHT", 100.0, 2.5, 1.0) == 2.5
    height = fitting_height("RIGHT", 8.0, 2.5, 1.0)
    assert text_width("RIGHT", height) == pytest.approx(8.0)
    assert fitting_height("A VERY LONG NAME", 5.0, 2.5, 1.0) is None
