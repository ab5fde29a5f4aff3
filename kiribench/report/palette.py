"""Colours of the report: safe for colour-blind readers, and never the only carrier.

Grades also differ in lightness and always carry their letter; signed quantities use a
blue - white - brown scale that is symmetric about zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

INK = "#1d2730"
QUIET = "#5b6873"
LINE = "#c9d1d8"
PAPER = "#ffffff"
MASKED = "#eceff1"
ACCENT = "#1f5f8b"

SKIN = "#37474f"
PATCH = "#c4500b"
OVERLAP = "#f3c9a5"

GRADES = ("good", "fair", "poor")
GRADE_LETTER: Mapping[str, str] = MappingProxyType({"good": "G", "fair": "F", "poor": "P"})
GRADE_FILL: Mapping[str, str] = MappingProxyType(
    {"good": "#86b9dc", "fair": "#f6d57c", "poor": "#a33a20"}
)
GRADE_INK: Mapping[str, str] = MappingProxyType(
    {"good": "#0f2233", "fair": "#33270a", "poor": "#ffffff"}
)

# Diverging, dark blue - white - dark brown; lightness falls evenly to both ends (tested).
DIVERGING = ("#123a63", "#3f78ad", "#9cc3e0", "#f6f6f4", "#e3b98c", "#b8713a", "#67320f")
# One hue, light to dark, for ratios from 0 to 1.
SEQUENTIAL = ("#f4f7f9", "#cfe0ec", "#9cc3e0", "#5f99c7", "#2f6ea3")


def ink_on(rgb: tuple[float, float, float]) -> str:
    """Black or white, whichever reads better on a fill (WCAG relative luminance).

    Args:
        rgb: fill, each channel from 0 to 1.
    """

    def linear(channel: float) -> float:
        return channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4

    red, green, blue = (linear(channel) for channel in rgb)
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    contrast_white = 1.05 / (luminance + 0.05)
    contrast_black = (luminance + 0.05) / 0.05
    return PAPER if contrast_white > contrast_black else "#000000"
