"""Subject folders on disk: find, check and load their tables and sidecars.

Loading the scans themselves is the job of ``kiribench.surface``; the format is described in
docs/subject-folders.md.
"""

from __future__ import annotations

from kiribench.dataset.folder import Dataset, check_dataset
from kiribench.dataset.subject import Subject
from kiribench.schema.layout import (
    ACQUISITIONS,
    GRID_ACQUISITIONS,
    PATCH_ACQUISITIONS,
    Grid,
    Layout,
    Patch,
    Regions,
)
from kiribench.schema.nodes import NodesTable

__all__ = [
    "ACQUISITIONS",
    "GRID_ACQUISITIONS",
    "PATCH_ACQUISITIONS",
    "Dataset",
    "Grid",
    "Layout",
    "NodesTable",
    "Patch",
    "Regions",
    "Subject",
    "check_dataset",
]
