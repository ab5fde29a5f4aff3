"""Camera frames and load data of a stretched sample to strain and Poisson curves."""

from __future__ import annotations

from kiribench.tensile.followed import MeasureOptions
from kiribench.tensile.measure import measure_frames
from kiribench.tensile.result import MEASURED, STATES, Curve, TensileTest
from kiribench.tensile.tables import read_tensile, write_tensile

__all__ = [
    "MEASURED",
    "STATES",
    "Curve",
    "MeasureOptions",
    "TensileTest",
    "measure_frames",
    "read_tensile",
    "write_tensile",
]
