"""Broken datasets, each made from the good small one, and what must be said about them.

Science and the format's rules decide the code and the exit code; no case is here because a
program happened to behave so. ``harmless`` cases must give the numbers of the good dataset.
"""

from __future__ import annotations

from zoo.damage import Case
from zoo.folders import FOLDER
from zoo.scans import SCANS
from zoo.tables import NODES

CASES = (*FOLDER, *NODES, *SCANS)

__all__ = ["CASES", "Case"]
