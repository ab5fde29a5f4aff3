"""The worn model that a design on the skin works with: cuts in, corners on the skin out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kiribench.design.skin import Skin
from kiribench.fem.material import Material
from kiribench.fem.wear import (
    WearSensitivities,
    WearSpec,
    WornPatch,
    wear_patch,
    wear_sensitivities,
)
from kiribench.lattice import CutMap

FloatArray = NDArray[np.float64]


class WornModel(Protocol):
    """What carries a cut map to corner positions; :class:`KneeModel` or a stand-in of it."""

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) where the corners belong, skin coordinates."""
        ...

    @property
    def weight(self) -> FloatArray:
        """(R+1, C+1) 1 where the skin node was seen, else 0."""
        ...

    def worn(self, cut_map: CutMap, elements: int, **pose: Any) -> WornPatch:
        """The patch in equilibrium; ``pose`` overrides fields of the spec (offset, turn, slip)."""
        ...

    def sensitivities(self, cut_map: CutMap, elements: int, **pose: Any) -> WearSensitivities:
        """The same with the derivatives of its corners."""
        ...


@dataclass(frozen=True, eq=False)
class KneeModel:
    """The worn model on a subject's skin.

    Attributes:
        skin: the flexed skin.
        spec: how the patch is put on; its mesh is replaced.
        material: None is the paper's.
    """

    skin: Skin
    spec: WearSpec = field(default_factory=WearSpec)
    material: Material | None = None

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) where the corners belong."""
        return self.skin.target_q_mm

    @property
    def weight(self) -> FloatArray:
        """(R+1, C+1) 1 where the skin node was seen, else 0."""
        return self.skin.under.present.astype(np.float64)

    def worn(self, cut_map: CutMap, elements: int, **pose: Any) -> WornPatch:
        """The patch in equilibrium; ``pose`` overrides fields of the spec (offset, turn, slip)."""
        spec = replace(self.spec, elements_per_facet=elements, **pose)
        skin = self.skin
        return wear_patch(
            cut_map, skin.surface, skin.origin_q_mm, spec, self.material, rest=skin.rest
        )

    def sensitivities(self, cut_map: CutMap, elements: int, **pose: Any) -> WearSensitivities:
        """The same with the derivatives of its corners."""
        spec = replace(self.spec, elements_per_facet=elements, **pose)
        skin = self.skin
        return wear_sensitivities(
            cut_map, skin.surface, skin.origin_q_mm, spec, self.material, rest=skin.rest
        )
