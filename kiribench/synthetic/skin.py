"""The skin: where each material point (u, v) of the drawn grid lies at 0 and at 90 degrees.

u runs from lateral to medial, v from proximal to distal, both in mm from the grid's centre,
as drawn. At 0 degrees the grid is wrapped on the tapered leg as on a cone, which keeps the
pitch but for the relief and the ellipticity of the sections (a few per cent, tested). At 90
degrees the skin has moved from there by closed-form displacements across and along the leg.
"""

from __future__ import annotations

from dataclasses import dataclass

from kiribench.synthetic.jet import Jet, gauss
from kiribench.synthetic.leg import LegShape
from kiribench.synthetic.smooth import SmoothSurface


@dataclass(frozen=True)
class Slide:
    """How the skin moves over the leg between the two poses, beyond what the shape does.

    Attributes:
        side_gain_mm: skin that the sides draw along the leg into the bend, at |u| = 90 mm.
        side_gain_length_mm: over which length of the leg.
        front_gain_mm: skin that the front draws (negative: it lends).
        front_gain_length_mm: over which length.
        stretch: uniform longitudinal stretch, a fraction.
        medial_excess: relative surplus of the medial side's gain over the lateral's.
        lateral_strain, medial_strain: lateral strain added on either side of the patella.
        flank_mm: distance of those two places from the front line.
        flank_width_mm, flank_length_mm: their standard widths across and along.
        front_strain: lateral strain added in front, around the patella.
        distal_strain: lateral strain added below the patella (negative: it narrows).
        distal_from_mm: where that begins.
        twist: sideways drift of the skin (mm) towards medial at the patella.
    """

    side_gain_mm: float
    side_gain_length_mm: float
    front_gain_mm: float
    front_gain_length_mm: float
    stretch: float
    medial_excess: float
    lateral_strain: float
    medial_strain: float
    flank_mm: float
    flank_width_mm: float
    flank_length_mm: float
    front_strain: float
    distal_strain: float
    distal_from_mm: float
    twist: float


@dataclass(frozen=True)
class Build:
    """One subject's leg and skin.

    Attributes:
        straight: the leg's shape at 0 degrees.
        bent: its shape at 90 degrees.
        slide: the motion of the skin between them.
        side: ``"right"`` or ``"left"``.
    """

    straight: LegShape
    bent: LegShape
    slide: Slide
    side: str

    def reference(self) -> SmoothSurface:
        """The skin at 0 degrees, X0(u, v)."""
        return self._surface(self._at_rest)

    def flexed(self) -> SmoothSurface:
        """The skin at 90 degrees, X90(u, v)."""
        return self._surface(self._bent)

    def _surface(self, embedding: object) -> SmoothSurface:
        # X_u x X_v points into a right leg: u to the subject's left, v down, seen from front.
        mirror = 1.0 if self.side == "right" else -1.0

        def posed(u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
            x, y, z = embedding(u, v)  # type: ignore[operator]
            return mirror * x, y, z

        return SmoothSurface(posed, outward=-mirror)

    def _wrapped(self, u: Jet, v: Jet) -> tuple[Jet, Jet]:
        """Arc and axial coordinates of the flat grid laid on a cone of the leg's taper."""
        taper = self.straight.taper_per_mm
        toward_apex = 1.0 - taper * v
        ratio = taper * u / toward_apex
        arc = ratio.arctan() / taper
        radius = (1.0 + ratio * ratio).sqrt() * toward_apex
        return arc, (1.0 - radius) / taper

    def _at_rest(self, u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        arc, s = self._wrapped(u, v)
        return self.straight.position(arc, s)

    def _bent(self, u: Jet, v: Jet) -> tuple[Jet, Jet, Jet]:
        slide = self.slide
        arc, s = self._wrapped(u, v)
        lateral = slide.flank_width_mm * (
            slide.medial_strain * ((arc - slide.flank_mm) / slide.flank_width_mm).tanh()
            + slide.lateral_strain * ((arc + slide.flank_mm) / slide.flank_width_mm).tanh()
        )
        front = slide.front_strain * 20.0 * (arc / 20.0).tanh()
        beside = gauss(0.0 * arc, s, (0.0, -5.0), (1.0, slide.flank_length_mm))
        below = 0.5 * (1.0 + ((s - slide.distal_from_mm) / 25.0).tanh())
        drift = slide.twist * gauss(arc, s, (0.0, 0.0), (60.0, 70.0))
        arc90 = arc + beside * (lateral + front) + slide.distal_strain * below * arc + drift
        aside = (arc / 90.0) * (arc / 90.0)
        weight = aside * (1.0 + slide.medial_excess * arc / 90.0)
        s90 = (
            s * (1.0 + slide.stretch)
            + slide.side_gain_mm * weight * (s / slide.side_gain_length_mm).tanh()
            + slide.front_gain_mm * (-1.0 * aside).exp() * (s / slide.front_gain_length_mm).tanh()
        )
        return self.bent.position(arc90, s90)
