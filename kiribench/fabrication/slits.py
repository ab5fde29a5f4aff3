"""The slits of a patch as the beam must follow them: the design's cuts less the kerf.

A beam of width k that follows a straight path burns away all that lies within k/2 of it: at a
free tip the slit is k/2 longer than the path. So the path ends k/2 before each free tip of the
design's cut: a slit with two free tips is k shorter than the design says, a notch, whose other
end is its mouth on the outline, k/2. What the beam takes from the width of a slit (k/2 on either
side) cannot be given back by a single line; the ligaments are judged with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from kiribench.fabrication.strokes import FloatArray, Stroke, polyline
from kiribench.lattice import CutMap

SHORTEST_PATH_MM = 0.1
"""A slit whose path would be shorter than this is a hole of the beam's size: it is left out."""

_ON_OUTLINE = 1e-9


@dataclass(frozen=True, eq=False)
class Slits:
    """The slits of a patch in patch coordinates; k of them.

    Attributes:
        start_mm, end_mm: (k, 2) ends of the beam's path.
        notch: (k,) whether one end is a mouth on the outline.
        site: (k, 2) lattice coordinates of the site.
        design_length_mm: (k,) length of the cut in the design.
        left_out: cuts of the design that are too short for the kerf, as sites (m, 2).
    """

    start_mm: FloatArray
    end_mm: FloatArray
    notch: npt.NDArray[np.bool_]
    site: npt.NDArray[np.int64]
    design_length_mm: FloatArray
    left_out: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.start_mm)

    @property
    def length_mm(self) -> FloatArray:
        """(k,) lengths of the paths, mm."""
        return np.asarray(np.linalg.norm(self.end_mm - self.start_mm, axis=1))

    def strokes(self) -> list[Stroke]:
        """One stroke of two points a slit."""
        return [
            polyline("slit", np.array(ends))
            for ends in zip(self.start_mm, self.end_mm, strict=True)
        ]


def beam_paths(cut_map: CutMap, kerf_mm: float) -> Slits:
    """The beam's paths for the cuts of ``cut_map``, half a kerf short of every free tip."""
    cuts = cut_map.half_cuts().cuts()
    length = cuts.length_mm
    width, along = cut_map.size_mm
    direction = (cuts.end_mm - cuts.start_mm) / length[:, None]
    paths = []
    on_outline = []
    for point, inwards in ((cuts.start_mm, direction), (cuts.end_mm, -direction)):
        x, y = point[:, 0], point[:, 1]
        edge = np.minimum.reduce([x, width - x, y, along - y])
        mouth = edge <= _ON_OUTLINE * max(width, along)
        paths.append(point + np.where(mouth, 0.0, kerf_mm / 2)[:, None] * inwards)
        on_outline.append(mouth)
    left = length - kerf_mm / 2 * (2.0 - on_outline[0] - on_outline[1])
    keep = left >= SHORTEST_PATH_MM
    return Slits(
        start_mm=paths[0][keep],
        end_mm=paths[1][keep],
        notch=(on_outline[0] | on_outline[1])[keep],
        site=cuts.site[keep],
        design_length_mm=length[keep],
        left_out=cuts.site[~keep],
    )
