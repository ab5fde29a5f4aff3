"""kiribench: validation and conformability analysis of body-conformable kirigami patches.

Conventions, once for the whole package:

- Row 0 is proximal, column 0 is lateral (the subject's outside, left leg or right).
- Longitudinal is proximal-distal, lateral is across; Poisson's ratio is
  ``nu = -lateral strain / longitudinal strain`` with both strains in one named measure.
- Stretch is the length ratio deformed / reference and has no measure. Strain is a
  fraction in a named measure: ``engineering`` (stretch - 1), ``log`` (ln stretch, the
  default) or ``green`` ((stretch^2 - 1) / 2).
- Lengths are millimetres, stresses megapascals, angles degrees, and the names say so
  (``edge_mm``, ``flexion_deg``). Cut lengths are fractions of the cell size inside the
  code and percent (``a_percent``) where a person types or reads them.
- Geometry, finite elements and Gaussian processes compute in float64.
- A number that cannot be given is absent with a reason code, never a silent NaN.
"""

from __future__ import annotations

__version__ = "0.1.0"

from kiribench.kernel_cache import key_kernel_cache

key_kernel_cache()
