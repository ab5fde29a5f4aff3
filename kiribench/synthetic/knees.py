"""The stored knees S1, S2 and S3, and random ones.

The numbers of S1 to S3 were chosen once so that the strains look like the paper's heatmaps
and the truth counts 66, 58 and 56 of 72 cells at least fair (arXiv 2511.13941, Results).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kiribench.synthetic.leg import Bump, LegShape
from kiribench.synthetic.mismatch import Mismatch
from kiribench.synthetic.skin import Build, Slide


@dataclass(frozen=True)
class Knee:
    """A subject to be made.

    Attributes:
        label: participant label without ``sub-``.
        description: build, in words.
        build: leg and skin.
        mismatch: how its worn patch lies.
    """

    label: str
    description: str
    build: Build
    mismatch: Mismatch


def knee_build(
    side: str,
    *,
    half_width_mm: float,
    depth_mm: float,
    taper_per_mm: float,
    relief: float,
    patella_mm: float,
    front_softness_mm: float,
    laxity: float,
    medial_excess: float,
) -> Build:
    """A knee of the given proportions.

    Args:
        side: ``"right"`` or ``"left"``.
        half_width_mm, depth_mm: half axes of the sections across and in depth.
        taper_per_mm: relative narrowing towards distal.
        relief: scale of all reliefs, 1 for an average build.
        patella_mm: height of the patella over the leg at 0 degrees.
        front_softness_mm: how roundly the front bends; less is sharper and stretches more.
        laxity: scale of the skin's lateral strains.
        medial_excess: relative surplus of the medial side's sliding.
    """
    size = half_width_mm / 58.0
    straight = LegShape(
        flexion_deg=0.0,
        depth_mm=depth_mm,
        half_width_mm=half_width_mm,
        taper_per_mm=taper_per_mm,
        side_softness_mm=30.0,
        front_softness_mm=90.0,
        fan_mm=50.0,
        flare=0.02,
        flare_mm=40.0,
        even=1.0,
        bumps=(
            Bump(patella_mm, 0.0, -6.0, 17.0 * size, 20.0),  # patella
            Bump(-2.0 * relief, -34.0 * size, -6.0, 12.0, 20.0),  # hollows on both sides of it
            Bump(-2.0 * relief, 34.0 * size, -4.0, 12.0, 20.0),
            Bump(1.8 * relief, 42.0 * size, -75.0, 20.0, 26.0),  # vastus medialis
            Bump(2.5 * relief, 0.0, 62.0, 12.0, 16.0),  # tibial tuberosity
            Bump(-1.5 * relief, 0.0, -55.0, 22.0, 18.0),  # over the quadriceps tendon
        ),
    )
    bent = LegShape(
        flexion_deg=90.0,
        depth_mm=depth_mm,
        half_width_mm=half_width_mm,
        taper_per_mm=taper_per_mm,
        side_softness_mm=30.0,
        front_softness_mm=front_softness_mm,
        fan_mm=66.0 * size,
        flare=0.07,
        flare_mm=40.0,
        even=0.0,
        bumps=(
            Bump(patella_mm + 4.0, 0.0, -3.0, 17.0 * size, 15.0),
            Bump(3.0 * relief, -42.0 * size, -8.0, 13.0, 17.0),  # condyles
            Bump(3.0 * relief, 42.0 * size, -8.0, 13.0, 17.0),
            Bump(-1.5 * relief, -24.0 * size, 22.0, 12.0, 12.0),  # beside the patellar tendon
            Bump(-1.5 * relief, 24.0 * size, 22.0, 12.0, 12.0),
            Bump(3.0 * relief, 0.0, 58.0, 12.0, 16.0),
            Bump(1.8 * relief, 40.0 * size, -75.0, 20.0, 26.0),
        ),
    )
    slide = Slide(
        side_gain_mm=18.0 / size**2,
        side_gain_length_mm=36.0,
        front_gain_mm=-6.0,
        front_gain_length_mm=45.0,
        stretch=0.06,
        medial_excess=medial_excess,
        lateral_strain=0.15 * laxity,
        medial_strain=0.13 * laxity,
        flank_mm=50.0,
        flank_width_mm=24.0,
        flank_length_mm=38.0,
        front_strain=0.08 * laxity,
        distal_strain=-0.045 * laxity,
        distal_from_mm=60.0,
        twist=1.5,
    )
    return Build(straight, bent, slide, side)


S1 = Knee(
    "S1",
    "slim build, right knee",
    knee_build(
        "right",
        half_width_mm=54.0,
        depth_mm=50.0,
        taper_per_mm=0.0009,
        relief=1.15,
        patella_mm=6.0,
        front_softness_mm=60.0,
        laxity=1.0,
        medial_excess=0.1,
    ),
    Mismatch(
        half_width_mm=45.0,
        half_length_mm=90.0,
        shift_lateral_mm=0.2,
        shift_longitudinal_mm=-0.3,
        stretch_lateral=-0.004,
        stretch_longitudinal=0.004,
        shear=0.006,
        wave_mm=0.61,
        wave_length_mm=85.0,
        wave_phase=0.27,
        edge_lateral_mm=3.84,
        edge_medial_mm=2.51,
        edge_drag_mm=0.6,
        edge_start=0.9,
        edge_width=0.2,
        edge_phase=0.57,
    ),
)

S2 = Knee(
    "S2",
    "average build, left knee",
    knee_build(
        "left",
        half_width_mm=59.0,
        depth_mm=54.0,
        taper_per_mm=0.0010,
        relief=1.0,
        patella_mm=5.0,
        front_softness_mm=62.0,
        laxity=1.1,
        medial_excess=-0.1,
    ),
    Mismatch(
        half_width_mm=45.0,
        half_length_mm=90.0,
        shift_lateral_mm=-0.3,
        shift_longitudinal_mm=0.4,
        stretch_lateral=-0.008,
        stretch_longitudinal=0.006,
        shear=-0.008,
        wave_mm=0.93,
        wave_length_mm=75.0,
        wave_phase=1.59,
        edge_lateral_mm=4.92,
        edge_medial_mm=3.73,
        edge_drag_mm=0.9,
        edge_start=0.9,
        edge_width=0.2,
        edge_phase=0.3,
    ),
)

S3 = Knee(
    "S3",
    "heavy build, right knee",
    knee_build(
        "right",
        half_width_mm=66.0,
        depth_mm=60.0,
        taper_per_mm=0.0011,
        relief=0.8,
        patella_mm=3.8,
        front_softness_mm=68.0,
        laxity=0.95,
        medial_excess=0.2,
    ),
    Mismatch(
        half_width_mm=45.0,
        half_length_mm=90.0,
        shift_lateral_mm=0.4,
        shift_longitudinal_mm=0.58,
        stretch_lateral=-0.0059,
        stretch_longitudinal=-0.008,
        shear=0.0143,
        wave_mm=0.77,
        wave_length_mm=95.0,
        wave_phase=1.82,
        edge_lateral_mm=3.93,
        edge_medial_mm=3.98,
        edge_drag_mm=0.71,
        edge_start=0.9,
        edge_width=0.2,
        edge_phase=0.8,
    ),
)

STORED = {knee.label: knee for knee in (S1, S2, S3)}


def random_knee(index: int, seed: int) -> Knee:
    """A knee of random side, build and fit; the same for the same two numbers.

    Args:
        index: counts the subjects from 1; the label is ``R`` and the index.
        seed: of the whole set.
    """
    rng = np.random.default_rng([seed, index])
    half_width = float(rng.uniform(53.0, 67.0))
    build = knee_build(
        "right" if rng.random() < 0.5 else "left",
        half_width_mm=half_width,
        depth_mm=half_width * float(rng.uniform(0.89, 0.94)),
        taper_per_mm=float(rng.uniform(0.0007, 0.0012)),
        relief=float(rng.uniform(0.6, 1.2)),
        patella_mm=float(rng.uniform(3.5, 6.0)),
        front_softness_mm=float(rng.uniform(58.0, 70.0)),
        laxity=float(rng.uniform(0.8, 1.2)),
        medial_excess=float(rng.uniform(-0.2, 0.2)),
    )
    amount = float(rng.uniform(0.5, 1.1))
    sign = rng.choice([-1.0, 1.0], 5)
    mismatch = Mismatch(
        half_width_mm=45.0,
        half_length_mm=90.0,
        shift_lateral_mm=0.4 * amount * float(sign[0]),
        shift_longitudinal_mm=0.4 * amount * float(sign[1]),
        stretch_lateral=-0.008 * amount,
        stretch_longitudinal=0.008 * amount * float(sign[2]),
        shear=0.008 * amount * float(sign[3]),
        wave_mm=0.8 * amount,
        wave_length_mm=float(rng.uniform(70.0, 110.0)),
        wave_phase=float(rng.uniform(0.0, 2.0 * np.pi)),
        edge_lateral_mm=4.0 * amount,
        edge_medial_mm=3.0 * amount,
        edge_drag_mm=1.0 * amount * float(sign[4]),
        edge_start=0.9,
        edge_width=0.2,
        edge_phase=float(rng.uniform(-1.0, 1.0)),
    )
    return Knee(f"R{index:03d}", f"random build of half width {half_width:.1f} mm", build, mismatch)
