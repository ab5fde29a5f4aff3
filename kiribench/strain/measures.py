"""The three strain measures as functions of a stretch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import UsageError
from kiribench.strain.result import STRAIN_MEASURES

FloatArray = NDArray[np.float64]


def check_measure(measure: str) -> None:
    """Refuse a strain measure that does not exist.

    Raises:
        UsageError: ``strain-measure-unknown``; choose log, engineering or green.
    """
    if measure not in STRAIN_MEASURES:
        raise UsageError(
            "strain-measure-unknown",
            "There is no such strain measure.",
            remedy="Choose one of the measures named.",
            got=measure,
            expected=", ".join(STRAIN_MEASURES),
        )


def strain_of(stretch: FloatArray, measure: str) -> FloatArray:
    """Strain of a stretch in a named measure.

    >>> strain_of(np.array([1.25]), "engineering")
    array([0.25])

    Args:
        stretch: any shape, length ratio deformed / reference, positive.
        measure: ``engineering`` (stretch - 1), ``log`` (ln stretch) or ``green``
            ((stretch^2 - 1) / 2).
    """
    check_measure(measure)
    if measure == "engineering":
        return np.asarray(stretch - 1.0)
    if measure == "log":
        return np.asarray(np.log(stretch))
    return np.asarray(0.5 * (stretch * stretch - 1.0))


def stretch_of(strain: FloatArray, measure: str) -> FloatArray:
    """Stretch of a strain in a named measure: the inverse of :func:`strain_of`.

    >>> stretch_of(np.array([0.25]), "engineering")
    array([1.25])

    Args:
        strain: any shape; NaN where no stretch has it.
        measure: as in :func:`strain_of`.
    """
    check_measure(measure)
    with np.errstate(invalid="ignore"):
        if measure == "engineering":
            return np.asarray(np.where(strain > -1.0, 1.0 + strain, np.nan))
        if measure == "log":
            return np.asarray(np.exp(strain))
        return np.asarray(np.sqrt(1.0 + 2.0 * strain))


def strain_rate_of(stretch: FloatArray, measure: str) -> FloatArray:
    """Derivative of :func:`strain_of` with respect to the stretch, same shape."""
    check_measure(measure)
    if measure == "engineering":
        return np.ones_like(stretch)
    if measure == "log":
        return np.asarray(1.0 / stretch)
    return np.asarray(stretch.copy())


def check_min_strain(min_strain: float) -> None:
    """Refuse a mask limit that is no strain.

    Raises:
        UsageError: ``min-strain-range``; give a fraction of at least 0 and below 1.
    """
    if not 0.0 <= min_strain < 1.0:
        raise UsageError(
            "min-strain-range",
            "The smallest strain for Poisson's ratio is no fraction.",
            remedy="Give a fraction, such as 0.03.",
            got=min_strain,
            expected="0 or more, below 1",
        )
