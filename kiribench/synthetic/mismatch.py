"""Where the worn patch lies against the skin: a closed-form mismatch field.

A patch point p = (x, y) mm from the patch's centre, as cut, should lie on the skin's
material point p; it lies on q = p + mismatch(p) instead. The field is a sum of a shift, a
stretch and a shear of the whole patch, a wave along it, and a failure of the two edge
columns to follow the skin, as the paper saw it (arXiv 2511.13941, Results).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kiribench.errors import NotConvergedError
from kiribench.synthetic.jet import FloatArray


@dataclass(frozen=True)
class Mismatch:
    """Parameters of the field; lengths in mm, strains as fractions of the drawn grid.

    Attributes:
        half_width_mm, half_length_mm: half the size of the patch's cells together.
        shift_lateral_mm, shift_longitudinal_mm: towards medial and towards distal.
        stretch_lateral, stretch_longitudinal: relative surplus of the patch's stretch.
        shear: sideways drift a mm of length.
        wave_mm, wave_length_mm, wave_phase: longitudinal wave, and half of it sideways.
        edge_lateral_mm, edge_medial_mm: how far either edge falls short, inwards.
        edge_drag_mm: longitudinal drag of the edges, opposite on the two sides.
        edge_start, edge_width: where the edges' failure sets in, as a fraction of the half
            width, and over which fraction.
        edge_phase: moves the edges' worst places along the patch.
    """

    half_width_mm: float
    half_length_mm: float
    shift_lateral_mm: float
    shift_longitudinal_mm: float
    stretch_lateral: float
    stretch_longitudinal: float
    shear: float
    wave_mm: float
    wave_length_mm: float
    wave_phase: float
    edge_lateral_mm: float
    edge_medial_mm: float
    edge_drag_mm: float
    edge_start: float
    edge_width: float
    edge_phase: float

    def field_mm(self, p: FloatArray) -> FloatArray:
        """(..., 2) mismatch q - p, towards medial and distal, at patch points p (..., 2)."""
        x, y = p[..., 0], p[..., 1]
        across, along = x / self.half_width_mm, y / self.half_length_mm
        lateral = 0.5 * (1.0 + np.tanh((-across - self.edge_start) / self.edge_width))
        medial = 0.5 * (1.0 + np.tanh((across - self.edge_start) / self.edge_width))
        swell = 1.0 + 0.6 * np.cos(np.pi * (1.5 * along - self.edge_phase))
        swell_medial = 1.0 + 0.6 * np.cos(np.pi * (1.5 * along + self.edge_phase))
        edge = self.edge_lateral_mm * swell * lateral
        edge_medial = self.edge_medial_mm * swell_medial * medial
        wave = 2.0 * np.pi * y / self.wave_length_mm + self.wave_phase
        du = (
            self.shift_lateral_mm
            + self.stretch_lateral * x
            + self.shear * y
            + 0.5 * self.wave_mm * np.cos(wave)
            + edge
            - edge_medial
        )
        dv = (
            self.shift_longitudinal_mm
            + self.stretch_longitudinal * y
            + self.wave_mm * np.sin(wave) * (1.0 + 0.4 * across**2)
            + self.edge_drag_mm * (swell * lateral - swell_medial * medial)
        )
        return np.stack([du, dv], axis=-1)

    def on_skin(self, p: FloatArray) -> FloatArray:
        """(..., 2) material points q under the patch points p (..., 2)."""
        return np.asarray(p + self.field_mm(p))

    def patch_point(self, q: FloatArray) -> FloatArray:
        """(..., 2) patch points above the material points q: the inverse of ``on_skin``.

        Raises:
            NotConvergedError: ``patch-folds``; the field is steeper than the patch can bear.
        """
        p = q - self.field_mm(q)
        for _ in range(100):
            step = q - self.on_skin(p)
            p = p + step
            if np.max(np.abs(step), initial=0.0) < 1e-11:
                return np.asarray(p)
        raise NotConvergedError(
            "patch-folds",
            "The patch's mismatch field cannot be inverted.",
            remedy="Lower the edges' failure or the waves: the patch folds over itself.",
        )
