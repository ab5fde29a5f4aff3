"""The shape of a leg about the knee at any flexion, in closed form.

The surface is swept by half-ellipse-like sections between two curves of the sagittal plane:
the *side line* L, which runs through the epicondyles and bends sharply, and the *front
line* F, which runs over the patella and bends roundly. Both are hyperbolas with thigh and
shank as asymptotes. With the section angle theta (0 in front, positive towards medial),

    X = L(s) + taper(s) [(F(s) - L(s)) cos(theta) + half_width sin(theta) e] + bumps,

e the unit vector across. The front line is traversed faster where the knee bends, which is
what stretches the skin over the patella. Bumps (patella, condyles, tuberosity, hollows, the
vastus medialis) are Gaussian bells along the sections' radial direction.

Frame, in millimetres: x from lateral to medial, y anterior to posterior, z upwards along
the shank; the knee's axis is at the origin, the shank points to -z at every flexion. A left
leg is the mirror image in x of a right one, so that x points to the subject's left on both.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, radians, sin, sqrt, tan

from kiribench.synthetic.jet import Jet, gauss

SQRT2 = sqrt(2.0)
SQRT_HALF_PI = sqrt(0.5 * pi)


@dataclass(frozen=True)
class Bump:
    """A bell on the skin, in section coordinates.

    Attributes:
        height_mm: its height; a hollow is negative.
        arc_mm: arc coordinate across of its centre (0 in front, medial positive).
        along_mm: coordinate s along the leg of its centre (distal positive).
        half_width_mm, half_length_mm: its standard deviations across and along.
    """

    height_mm: float
    arc_mm: float
    along_mm: float
    half_width_mm: float
    half_length_mm: float

    def relief(self, arc: Jet, s: Jet) -> Jet:
        """The height in mm at the section coordinates (arc, s)."""
        centre = (self.arc_mm, self.along_mm)
        width = (self.half_width_mm, self.half_length_mm)
        return self.height_mm * gauss(arc, s, centre, width)

    def swell(self, arc: Jet, s: Jet) -> Jet:
        """The relief's integral over the arc from the bump's centre, in mm^2."""
        across = (arc - self.arc_mm) / (SQRT2 * self.half_width_mm)
        along = (s - self.along_mm) / self.half_length_mm
        area = self.height_mm * self.half_width_mm * SQRT_HALF_PI
        return area * (-0.5 * along * along).exp() * across.erf()


@dataclass(frozen=True)
class LegShape:
    """One leg in one pose.

    Attributes:
        flexion_deg: angle between the directions of thigh and shank.
        depth_mm: from the side line to the front line, in both limbs.
        half_width_mm: from the sagittal plane to the side line.
        taper_per_mm: relative narrowing of the sections along the leg.
        side_softness_mm, front_softness_mm: how roundly the two lines bend.
        fan_mm: length of leg over which the sections fan out.
        flare: relative widening of the sections at the knee.
        flare_mm: standard length of that widening along the leg.
        even: 1 takes back, to first order, the widening of the sections by the bumps, so
            that arcs across keep their length; 0 leaves it.
        bumps: the reliefs.
    """

    flexion_deg: float
    depth_mm: float
    half_width_mm: float
    taper_per_mm: float
    side_softness_mm: float
    front_softness_mm: float
    fan_mm: float
    flare: float
    flare_mm: float
    even: float
    bumps: tuple[Bump, ...]

    def position(self, arc: Jet, s: Jet) -> tuple[Jet, Jet, Jet]:
        """The point of section s at a given arc from the front line.

        Args:
            arc: mm across from the front line, medial positive, before taper.
            s: mm along the leg, distal positive.

        Returns:
            Jets of x (towards medial), y (posterior) and z (proximal along the shank).
        """
        flexion = radians(self.flexion_deg)
        corner = tan(0.5 * flexion)
        thigh_y, thigh_z = sin(flexion), cos(flexion)  # towards proximal; the shank is (0, -1)
        side_thigh, side_shank = _softplus(s, self.side_softness_mm)
        sigma = s + self.depth_mm * corner * (s / self.fan_mm).tanh()
        front_thigh, front_shank = _softplus(sigma, self.front_softness_mm)
        to_front_y = thigh_y * (front_thigh - side_thigh) - self.depth_mm
        to_front_z = (
            thigh_z * (front_thigh - side_thigh)
            - (front_shank - side_shank)
            + self.depth_mm * corner
        )
        depth = (to_front_y * to_front_y + to_front_z * to_front_z).sqrt()
        along = s / self.flare_mm
        half_width = self.half_width_mm * (1.0 + self.flare * (-0.5 * along * along).exp())
        evened = arc
        if self.even:
            # A bump widens the section by relief / radius.
            swell = sum((bump.swell(arc, s) for bump in self.bumps), start=0.0 * s)
            evened = arc - 2.0 * self.even * swell / (half_width + depth)
        theta = _section_angle(evened, depth, half_width)
        taper = 1.0 - self.taper_per_mm * s
        relief = sum((bump.relief(arc, s) for bump in self.bumps), start=0.0 * s)
        radial = (taper + relief / depth) * theta.cos()
        x = (taper * half_width + relief) * theta.sin()
        y = thigh_y * side_thigh + to_front_y * radial
        z = thigh_z * side_thigh - side_shank + to_front_z * radial
        return x, y, z


def _section_angle(arc: Jet, depth: Jet, half_width: Jet) -> Jet:
    """The section angle at an arc of the elliptic section, to first order in its ellipticity.

    The speed of (half_width sin, depth cos) is about m (1 + k cos 2 theta), so that
    theta = arc/m - (k/2) sin(2 arc/m).
    """
    mean = 0.5 * (half_width + depth)
    ellipticity = 0.5 * (half_width - depth) / mean
    angle = arc / mean
    return angle - 0.5 * ellipticity * (2.0 * angle).sin()


def _softplus(s: Jet, softness: float) -> tuple[Jet, Jet]:
    """Smooth forms of max(-s, 0) and max(s, 0): the branches of a hyperbola."""
    root = (s * s + softness * softness).sqrt()
    return 0.5 * (root - s), 0.5 * (root + s)
