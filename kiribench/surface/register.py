"""Bring one scan rigidly onto another by the skin that both show.

Point-to-plane iterated closest points (Chen and Medioni 1992, doi 10.1016/0262-8856(92)90066-C)
with trimming (Chetverikov, Stepanov and Krsek 2005, doi 10.1016/j.imavis.2004.05.007): samples
uniform in area on the moving scan, exact closest points on the fixed one, partners on its
border or of another direction left out, the worst residuals left out. Three rounds: the best
``trim`` share, to come near; the best half, which up to half of wrong points cannot mislead;
then all within three sigmas, which wastes no good point (reweighted least trimmed squares,
Rousseeuw and Leroy 1987, doi 10.1002/0471725382). A patch that lies over the skin is excluded
by mask, or, if it covers clearly less than half of what is seen, by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import NotConvergedError, RegistrationError
from kiribench.surface.mesh import FloatArray, Mesh
from kiribench.surface.register_covariance import block_rms, covariance_of
from kiribench.surface.register_descent import (
    FEWEST,
    Descent,
    Partners,
    area_samples,
    descend,
    rows_of,
    trimmed,
)
from kiribench.surface.rigid import RigidTransform, rotation_of

TRIM = 0.8
SAMPLES = 8000
LEAST_OVERLAP = 0.3
LEAST_INLIERS = 0.4
LEAST_POINTS = 200
LARGEST_RMS_MM = 1.0
SYSTEMATIC_MM = 0.01

# A round ends with a step of this many of its own standard errors.
_ROUND_ENDS = (3.0, 1.0, 0.1)
_STALLED = 1.0
_SHIFT_MM = 3.0  # starts to compare lie this far off: a patch is about 2 mm thick
_FEW = 1500  # points to compare starts with
_MOST_TRIED = 20  # steps a round, to compare starts
_FINE_MM = 0.05


@dataclass(frozen=True, eq=False)
class Registration:
    """How the moving scan was brought onto the fixed one.

    Attributes:
        rotation: (3, 3), translation_mm: (3,): fixed = rotation moving + translation.
        residual_rms_mm: rms distance along normals of the points used.
        initial_rms_mm: rms of the best ``trim`` share before the first step.
        misfit_rms_mm: rms of the mean residuals of 10 mm blocks: what is left when noise is
            averaged out. Near ``residual_rms_mm``, the skin itself differs.
        inlier_fraction: points used / points sampled on the moving scan.
        overlap_fraction: points with a partner on the fixed scan / points sampled.
        points_used: how many.
        covariance: (6, 6) of (rotation vector in radians about ``centre_mm``, translation in
            mm), in the fixed scan's frame; robust to residuals that are correlated within
            10 mm, and with the effect of a systematic error of ``systematic_mm`` of the scans
            added. A direction that the shape does not fix has a large variance here.
        firmness: how well the worst direction is fixed: the rms change of the residuals by
            the unit motion (1 mm rms) that changes them least. 0 for a sphere or a
            cylinder, at most about 0.5.
        centre_mm: (3,) centre of the points used, fixed frame.
        iterations: how many steps.
    """

    rotation: FloatArray
    translation_mm: FloatArray
    residual_rms_mm: float
    initial_rms_mm: float
    misfit_rms_mm: float
    inlier_fraction: float
    overlap_fraction: float
    points_used: int
    covariance: FloatArray
    firmness: float
    centre_mm: FloatArray
    iterations: int

    @property
    def transform(self) -> RigidTransform:
        """The motion from the moving frame to the fixed one."""
        return RigidTransform(self.rotation, self.translation_mm)

    @property
    def improvement(self) -> float:
        """Share by which the residual fell from the initial motion; 0 if it did not."""
        if self.initial_rms_mm <= 0:
            return 0.0
        return max(0.0, 1.0 - self.residual_rms_mm / self.initial_rms_mm)

    def point_covariance_mm2(self, points_mm: FloatArray) -> FloatArray:
        """(k, 3, 3) covariance of where the motion puts points.

        Args:
            points_mm: (k, 3) in the fixed frame.
        """
        jacobian = np.zeros((len(points_mm), 3, 6))
        x, y, z = (points_mm - self.centre_mm).T
        # d(w x r)/dw
        jacobian[:, 0, 1], jacobian[:, 0, 2] = z, -y
        jacobian[:, 1, 0], jacobian[:, 1, 2] = -z, x
        jacobian[:, 2, 0], jacobian[:, 2, 1] = y, -x
        jacobian[:, :, 3:] = np.eye(3)
        return np.asarray(jacobian @ self.covariance @ jacobian.transpose(0, 2, 1))

    def sample(self, rng: np.random.Generator, size: int) -> list[RigidTransform]:
        """``size`` motions drawn from the estimate's uncertainty."""
        draws = rng.multivariate_normal(np.zeros(6), self.covariance, size, method="eigh")
        best = self.transform
        moved = []
        for draw in draws:
            turn = rotation_of(draw[:3])
            shift = self.centre_mm - turn @ self.centre_mm + draw[3:]
            moved.append(RigidTransform(turn, shift).after(best))
        return moved


def register(
    moving: Mesh,
    fixed: Mesh,
    *,
    initial: RigidTransform | None = None,
    exclude_moving: NDArray[np.bool_] | None = None,
    exclude_fixed: NDArray[np.bool_] | None = None,
    trim: float = TRIM,
    samples: int = SAMPLES,
    seed: int = 0,
    least_overlap: float = LEAST_OVERLAP,
    largest_rms_mm: float = LARGEST_RMS_MM,
    systematic_mm: float = SYSTEMATIC_MM,
) -> Registration:
    """Find the rigid motion that brings ``moving`` onto ``fixed``.

    Args:
        moving: the bare scan, mm, repaired.
        fixed: the worn scan, mm, repaired.
        initial: a first guess, right within about a centimetre and 15 degrees, such as
            :func:`kiribench.surface.rigid.kabsch` of corresponding nodes; default: none moves.
        exclude_moving: (m,) bool, faces of ``moving`` to leave out (skin under the patch).
        exclude_fixed: (m,) bool, faces of ``fixed`` to leave out (the patch).
        trim: share of the partnered points that the first round uses at most.
        samples: points on the moving scan.
        seed: of the samples.
        least_overlap: share of the samples that must have a partner.
        largest_rms_mm: residual above which the fit is refused.
        systematic_mm: standard deviation of a smooth error of the scans' shape, for the
            covariance alone.

    Raises:
        RegistrationError: ``registration-overlap`` (the scans share too little skin),
            ``registration-inliers`` or ``registration-residual`` (they do not fit).
        NotConvergedError: ``registration-not-converged``.
    """
    if not 0.0 < trim <= 1.0:
        raise ValueError(f"trim is a share in (0, 1], not {trim}")
    rng = np.random.default_rng(seed)
    points, directions = area_samples(moving, exclude_moving, samples, rng)
    partners = Partners(fixed, exclude_fixed)
    pose = initial or RigidTransform.identity()
    pairs = partners.find(pose.apply(points), directions @ pose.rotation.T)
    _require(len(pairs.residual) / len(points), len(pairs.residual), least_overlap)
    initial_rms = float(np.sqrt(np.mean(pairs.residual[trimmed(pairs.residual, trim)] ** 2)))
    descent = descend(partners, points, directions, pose, _rounds(trim))
    iterations = descent.iterations
    if _doubtful(partners, points, directions, descent):
        pose, tried = _best_start(partners, points, directions, descent.pose, trim)
        descent = descend(partners, points, directions, pose, _rounds(trim))
        iterations += tried + descent.iterations
    pose = descent.pose
    pairs = partners.find(pose.apply(points), directions @ pose.rotation.T)
    _require(len(pairs.residual) / len(points), len(pairs.residual), least_overlap)
    if descent.last_step > _STALLED:
        raise NotConvergedError(
            "registration-not-converged",
            f"The registration still moved after {iterations} steps.",
            remedy="Give a better first guess (corresponding nodes), or exclude what differs.",
        )
    used = trimmed(pairs.residual, 1.0)
    rows, centre, reach = rows_of(pairs, used)
    residual = pairs.residual[used]
    rms = float(np.sqrt(np.mean(residual**2)))
    if len(residual) < LEAST_INLIERS * len(pairs.residual):
        raise RegistrationError(
            "registration-inliers",
            "Most of the skin that both scans show does not fit.",
            remedy="Check that both scans are of the same leg in the same pose, exclude the "
            "patch, and give corresponding nodes for a first guess.",
            got=f"{len(residual) / len(pairs.residual):.0%} of the partnered points",
            expected=f"at least {LEAST_INLIERS:.0%}",
        )
    if rms > largest_rms_mm:
        raise RegistrationError(
            "registration-residual",
            "The scans do not fit after registration.",
            remedy="Check that both scans are of the same leg in the same pose.",
            got=f"a residual of {rms:.3f} mm rms",
            expected=f"at most {largest_rms_mm:g} mm",
        )
    return Registration(
        rotation=pose.rotation,
        translation_mm=pose.translation_mm,
        residual_rms_mm=rms,
        initial_rms_mm=initial_rms,
        misfit_rms_mm=block_rms(residual, pairs.position[used]),
        inlier_fraction=len(residual) / len(points),
        overlap_fraction=len(pairs.residual) / len(points),
        points_used=len(residual),
        covariance=covariance_of(rows, residual, pairs.position[used], reach, systematic_mm),
        firmness=float(np.sqrt(max(np.linalg.eigvalsh(rows.T @ rows)[0], 0.0) / len(rows))),
        centre_mm=centre,
        iterations=iterations,
    )


def _rounds(trim: float) -> tuple[tuple[float, float], ...]:
    """(share used, standard errors of the step that ends it) of each round."""
    return tuple(zip((trim, min(trim, 0.5), 1.0), _ROUND_ENDS, strict=True))


def _doubtful(
    partners: Partners, points: FloatArray, directions: FloatArray, descent: Descent
) -> bool:
    """Whether many points do not fit, or fit with residuals that are no noise."""
    pairs = partners.find(descent.pose.apply(points), directions @ descent.pose.rotation.T)
    if len(pairs.residual) < FEWEST:
        return False
    used = trimmed(pairs.residual, 1.0)
    rms = float(np.sqrt(np.mean(pairs.residual[used] ** 2)))
    structured = block_rms(pairs.residual[used], pairs.position[used]) > 0.5 * rms
    return len(used) < 0.85 * len(pairs.residual) or (structured and rms > _FINE_MM)


def _best_start(
    partners: Partners,
    points: FloatArray,
    directions: FloatArray,
    pose: RigidTransform,
    trim: float,
) -> tuple[RigidTransform, int]:
    """The best of seven descents with fewer points: from ``pose``, and shifted along each axis.

    The best has the least mean square of the better half of the points (least trimmed
    squares); a patch that lies on nearly half of the surface makes a second optimum, one
    thickness off, into which a single descent can fall.
    """
    few = slice(None, None, max(1, len(points) // _FEW))
    points, directions = points[few], directions[few]
    shifts = np.vstack([np.zeros(3), _SHIFT_MM * np.eye(3), -_SHIFT_MM * np.eye(3)])
    found: list[tuple[float, int, RigidTransform]] = []
    iterations = 0
    for shift in shifts:
        start = RigidTransform(np.eye(3), shift).after(pose)
        descent = descend(partners, points, directions, start, _rounds(trim)[:2], _MOST_TRIED)
        iterations += descent.iterations
        turned = directions @ descent.pose.rotation.T
        square = np.sort(partners.find(descent.pose.apply(points), turned).residual ** 2)
        half = square[: (len(square) + 1) // 2]
        found.append((float(half.mean()) if len(half) else np.inf, len(square), descent.pose))
    most = max(partnered for _, partnered, _ in found)
    near = [entry for entry in found if entry[1] >= 0.8 * most]
    return min(near, key=lambda entry: entry[0])[2], iterations


def _require(overlap: float, points: int, least: float) -> None:
    if overlap >= least and points >= LEAST_POINTS:
        return
    raise RegistrationError(
        "registration-overlap",
        "The two scans share too little skin to be registered.",
        remedy="Scan more skin around the patch, give corresponding nodes for a first guess, "
        "or exclude less.",
        got=f"{overlap:.0%} of the skin outside the patch ({points} points)",
        expected=f"at least {least:.0%} and {LEAST_POINTS} points",
    )
