"""What a patch is put on to be checked: a subject's flexed skin, or a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from kiribench.conformability.result import Conformability
from kiribench.conformability.score import ScoreOptions
from kiribench.design.skin import Skin
from kiribench.fem.surface_map import Plane, SurfaceMap
from kiribench.fem.wear_friction import skin_path
from kiribench.fem.wear_rest import RestMap
from kiribench.reference.developed import FlatSkin
from kiribench.reference.predicted import flat_conformability, predicted_conformability
from kiribench.schema.patch_design import PatchDesign

FloatArray = NDArray[np.float64]
Surface = Literal["worn", "flat"]


class Ground(Protocol):
    """What a patch is put on: :class:`KneeGround` or :class:`FlatGround`."""

    @property
    def kind(self) -> Surface:
        """``worn`` or ``flat``."""
        ...

    @property
    def surface(self) -> SurfaceMap:
        """Skin coordinates to places."""
        ...

    @property
    def origin_q_mm(self) -> tuple[float, float]:
        """Skin coordinates that the patch's corner (0, 0) is laid on."""
        ...

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) skin coordinates where the patch's corners belong."""
        ...

    @property
    def outward(self) -> float:
        """See :class:`kiribench.fem.surface_map.SurfaceMap`."""
        ...

    @property
    def path(self) -> Sequence[SurfaceMap] | None:
        """Skins on the way from rest, which friction needs; None where it is not known."""
        ...

    @property
    def rest(self) -> RestMap | None:
        """Where the flat patch is laid if the skin is not flat at rest; None where it is."""
        ...

    def score(
        self, corner_q_mm: FloatArray, design: PatchDesign, options: ScoreOptions
    ) -> Conformability:
        """The patch with corners there, scored."""
        ...


@dataclass(frozen=True, eq=False)
class KneeGround:
    """A subject's flexed skin."""

    skin: Skin

    @property
    def kind(self) -> Surface:
        """``worn``."""
        return "worn"

    @property
    def surface(self) -> SurfaceMap:
        """The spline through the scanned nodes."""
        return self.skin.surface

    @property
    def outward(self) -> float:
        """See :class:`kiribench.fem.surface_map.SurfaceMap`."""
        return self.skin.surface.outward

    @property
    def origin_q_mm(self) -> tuple[float, float]:
        """Of the node under the patch's corner (0, 0)."""
        return self.skin.origin_q_mm

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) of the nodes under the corners."""
        return self.skin.target_q_mm

    @property
    def path(self) -> Sequence[SurfaceMap] | None:
        """From the nodes at rest to the flexed ones."""
        if self.skin.rest_nodes_mm is None:
            return None
        return skin_path(self.skin.rest_nodes_mm, self.skin.nodes_mm, self.skin.pitch_mm)

    @property
    def rest(self) -> RestMap | None:
        """See :attr:`kiribench.design.skin.Skin.rest`."""
        return self.skin.rest

    def score(
        self, corner_q_mm: FloatArray, design: PatchDesign, options: ScoreOptions
    ) -> Conformability:
        """On the scan, by the code of ``conform``."""
        return predicted_conformability(self.skin, self.skin.places(corner_q_mm), options)


@dataclass(frozen=True, eq=False)
class FlatGround:
    """Skin laid flat, or a plain pull.

    Attributes:
        flat: the cells in the plane.
        pull: of a plain pull: length ratio of the patch; None where the skin was laid flat.
        shape: (R, C) of the patch.
    """

    shape: tuple[int, int]
    pitch_mm: float
    flat: FlatSkin | None = None
    pull: float | None = None

    @property
    def kind(self) -> Surface:
        """``flat``."""
        return "flat"

    @property
    def surface(self) -> SurfaceMap:
        """The plane, stretched as the skin is."""
        if self.flat is not None:
            return self.flat.surface
        return Plane(longitudinal=1.0 if self.pull is None else self.pull)

    @property
    def outward(self) -> float:
        """Up."""
        return 1.0

    @property
    def origin_q_mm(self) -> tuple[float, float]:
        """The origin."""
        return 0.0, 0.0

    @property
    def target_q_mm(self) -> FloatArray:
        """(R+1, C+1, 2) the plain grid."""
        rows, columns = self.shape
        steps = np.meshgrid(np.arange(columns + 1), np.arange(rows + 1))
        return np.asarray(self.pitch_mm * np.stack(steps, axis=-1).astype(np.float64))

    @property
    def path(self) -> Sequence[SurfaceMap] | None:
        """Not known: the flat check is without friction, or sticks."""
        return None

    @property
    def rest(self) -> RestMap | None:
        """None: it is flat."""
        return None

    def score(
        self, corner_q_mm: FloatArray, design: PatchDesign, options: ScoreOptions
    ) -> Conformability:
        """In the plane."""
        places = [
            self.surface.at(np.ascontiguousarray(q.reshape(-1, 2))).x[:, :2].reshape(q.shape)
            for q in (self.target_q_mm, corner_q_mm)
        ]
        return flat_conformability(
            design.participant,
            places[0],
            places[1],
            design.region,
            cell_mm=design.cell_mm,
            options=options,
        )
