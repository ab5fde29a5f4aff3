"""The analytic elbow of `small_limb` as a subject: 6 x 4 cells of 10 mm, fast to wear."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from small_limb import write_elbow_dataset

from kiribench.dataset import Dataset
from kiribench.design.skin import Skin, skin_of
from kiribench.schema.patch_design import PatchDesign


@cache
def elbow_root() -> Path:
    """The dataset's folder, written once a session."""
    return write_elbow_dataset(Path(tempfile.mkdtemp(prefix="elbow")) / "data")


@cache
def elbow_skin() -> Skin:
    """Its flexed skin."""
    return skin_of(Dataset.open(elbow_root()).subject("E1"))


def elbow_design(a: float = 0.7, b: float = 0.7, method: str = "uniform") -> PatchDesign:
    """A uniform design of its patch."""
    skin = elbow_skin()
    shape = skin.region.shape
    return PatchDesign(
        participant="E1", method=method, side="left", cell_mm=10.0, thickness_mm=1.0,
        strain_measure="log", a=np.full(shape, a), b=np.full(shape, b), region=skin.region,
        reason=np.full(shape, ""),
    )  # fmt: skip
