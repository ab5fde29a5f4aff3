"""Synthetic subjects with known truth: surfaces, scans, worn scans, nodes and truth tables.

The generator shares no code with the analysis: surfaces are closed forms, geodesics are
boundary value problems in the metric, areas are integrals of its determinant.
"""

from __future__ import annotations

from kiribench.synthetic.knees import STORED, Knee, random_knee
from kiribench.synthetic.mismatch import Mismatch
from kiribench.synthetic.smooth import SmoothSurface
from kiribench.synthetic.subject import Imperfections, Nodes, Scan, SyntheticSubject, subject
from kiribench.synthetic.write import write_dataset

__all__ = [
    "STORED",
    "Imperfections",
    "Knee",
    "Mismatch",
    "Nodes",
    "Scan",
    "SmoothSurface",
    "SyntheticSubject",
    "random_knee",
    "subject",
    "write_dataset",
]
