"""Letters as single strokes: text that a laser draws and that every reader sees as lines.

A file for the laser holds no text objects: programs replace fonts, drop them or engrave their
outlines. The letters are our own, on a grid of 4 x 6, capitals only.
"""

from __future__ import annotations

import unicodedata

import numpy as np

from kiribench.fabrication.strokes import Stroke

_ROUND = "10 01 05 16 36 45 41 30 10"
_BOX = "00 06 46 40 00"
_GLYPHS = {
    " ": "",
    "A": "00 04 26 44 40;02 42",
    "B": "00 06 36 45 44 33 03;33 42 41 30 00",
    "C": "45 36 16 05 01 10 30 41",
    "D": "00 06 26 44 42 20 00",
    "E": "46 06 00 40;03 33",
    "F": "46 06 00;03 33",
    "G": "45 36 16 05 01 10 30 41 43 23",
    "H": "00 06;40 46;03 43",
    "I": "10 30;16 36;20 26",
    "J": "46 41 30 10 01",
    "K": "00 06;46 03 40",
    "L": "06 00 40",
    "M": "00 06 23 46 40",
    "N": "00 06 40 46",
    "O": _ROUND,
    "P": "00 06 36 45 44 33 03",
    "Q": f"{_ROUND};22 40",
    "R": "00 06 36 45 44 33 03;23 40",
    "S": "45 36 16 05 04 13 33 42 41 30 10 01",
    "T": "20 26;06 46",
    "U": "06 01 10 30 41 46",
    "V": "06 20 46",
    "W": "06 10 23 30 46",
    "X": "00 46;06 40",
    "Y": "06 23 46;23 20",
    "Z": "06 46 00 40",
    "0": f"{_ROUND};11 35",
    "1": "14 26 20;10 30",
    "2": "05 16 36 45 44 00 40",
    "3": "05 16 36 45 44 33 13;33 42 41 30 10 01",
    "4": "30 36 02 42",
    "5": "46 06 03 33 42 41 30 10 01",
    "6": "45 36 16 05 01 10 30 41 42 33 03",
    "7": "06 46 10",
    "8": "13 04 05 16 36 45 44 33 13 02 01 10 30 41 42 33",
    "9": "43 13 04 05 16 36 45 41 30 10 01",
    "-": "13 33",
    "_": "00 40",
    ".": "20 21",
    ",": "21 10",
    ":": "21 22;24 25",
    "/": "00 46",
    "%": "00 46;06 16 15 05 06;30 40 41 31 30",
    "+": "03 43;21 25",
    "=": "02 42;04 44",
    "(": "36 25 21 30",
    ")": "16 25 21 10",
    "#": "10 16;30 36;02 42;04 44",
    "×": "11 35;15 31",
}
_ADVANCE = 5.5
"""Distance of neighbouring letters, in sixths of their height."""


def drawable(words: str) -> str:
    """``words`` as they will be drawn: capitals, accents left off, ``?`` shown as a box."""
    plain = unicodedata.normalize("NFKD", words.replace("×", "\0")).upper()
    plain = "".join(letter for letter in plain if not unicodedata.combining(letter))
    return "".join(letter if letter in _GLYPHS else "?" for letter in plain.replace("\0", "×"))


def text_width(words: str, height_mm: float) -> float:
    """Width of a line of text, mm."""
    count = len(drawable(words))
    return height_mm / 6 * (_ADVANCE * (count - 1) + 4) if count else 0.0


def text(
    role: str,
    words: str,
    at_mm: tuple[float, float],
    height_mm: float,
    *,
    anchor: float = 0.0,
) -> list[Stroke]:
    """Strokes of one line of text, in the page frame.

    Args:
        role: of the strokes.
        words: what to write; see :func:`drawable`.
        at_mm: the point of the base line where the text is anchored.
        height_mm: height of the capitals.
        anchor: 0 where the point is the text's left end, 0.5 its middle, 1 its right end.
    """
    unit = height_mm / 6
    left = at_mm[0] - anchor * text_width(words, height_mm)
    strokes = []
    for index, letter in enumerate(drawable(words)):
        for chain in filter(None, _GLYPHS.get(letter, _BOX).split(";")):
            grid = np.array([[int(pair[0]), int(pair[1])] for pair in chain.split()], dtype=float)
            closed = bool(np.all(grid[0] == grid[-1]))
            grid = grid[:-1] if closed else grid
            points = np.column_stack(
                [left + unit * (index * _ADVANCE + grid[:, 0]), at_mm[1] - unit * grid[:, 1]]
            )
            strokes.append(Stroke(role, points, np.zeros(len(points)), closed))
    return strokes


def fitting_height(
    words: str, width_mm: float, largest_mm: float, smallest_mm: float
) -> float | None:
    """Largest letter height at which ``words`` fit into ``width_mm``; None below the smallest."""
    per_height = text_width(words, 1.0)
    height = largest_mm if per_height == 0 else min(largest_mm, width_mm / per_height)
    return height if height >= smallest_mm else None
