"""What a sidecar says of the sample that was pulled."""

from __future__ import annotations

from typing import Any

import numpy as np

from kiribench.errors import TableError
from kiribench.fem.material import Material, NeoHookean, Ogden
from kiribench.reference.tensile_simulation import Specimen
from kiribench.schema.patch_design import PatchDesign
from kiribench.tensile.result import TensileTest

KEYS = ("GripMm", "Ends", "MuMpa", "Alpha", "Row", "Column")


def stated_specimen(design: PatchDesign, test: TensileTest) -> Specimen:
    """The object ``"Specimen"`` of the test's sidecar, else of the design's; defaults elsewhere.

    Keys: ``GripMm`` (uncut band at either end), ``Ends`` (``held`` or ``sliding``), ``MuMpa`` and
    ``Alpha`` (Ogden's; 2 is neo-Hookean), ``Row`` and ``Column`` (cell of the design at which the
    followed block begins).

    Raises:
        TableError: ``tensile-specimen``: an unknown key or a value that cannot be.
    """
    stated = test.record.get("Specimen", design.settings.get("Specimen", {}))
    if not isinstance(stated, dict) or set(stated) - set(KEYS):
        raise _wrong("Specimen", stated)
    grip = _number(stated, "GripMm", 0.0, 0.0)
    mu = _number(stated, "MuMpa", NeoHookean().mu_mpa, 1e-6)
    alpha = _number(stated, "Alpha", 2.0, 0.5)
    ends = stated.get("Ends", "held")
    if ends not in ("held", "sliding"):
        raise _wrong("Ends", ends)
    material: Material = NeoHookean(mu) if alpha == 2.0 else Ogden(mu, alpha)
    return Specimen(
        grip_mm=grip,
        ends="sliding" if ends == "sliding" else "held",
        material=material,
        row=_whole(stated, "Row"),
        column=_whole(stated, "Column"),
    )


def _number(stated: dict[str, Any], key: str, default: float, least: float) -> float:
    value = stated.get(key, default)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not np.isfinite(value) or value < least:
        raise _wrong(key, value)
    return float(value)


def _whole(stated: dict[str, Any], key: str) -> int | None:
    value = stated.get(key)
    if value is not None and (not isinstance(value, int) or isinstance(value, bool)):
        raise _wrong(key, value)
    return value


def _wrong(key: str, value: object) -> TableError:
    return TableError(
        "tensile-specimen",
        "What the sidecar says of the sample cannot be used.",
        remedy='Give such as {"Specimen": {"GripMm": 20, "Ends": "held", "MuMpa": 0.112, '
        '"Alpha": 3.29, "Row": 5, "Column": 0}}.',
        column=key,
        got=value,
        expected=", ".join(KEYS),
    )
