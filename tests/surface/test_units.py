"""The drawn pitch tells the unit."""

from __future__ import annotations

import pytest

from kiribench.errors import MeshError
from kiribench.surface.read import MM_PER_UNIT
from kiribench.surface.units import check_pitch


@pytest.mark.parametrize("units", list(MM_PER_UNIT))
@pytest.mark.parametrize("stretch", [0.7, 1.0, 1.5])
@pytest.mark.parametrize("pitch", [10.0, 15.0])
def test_right_unit_passes(units: str, stretch: float, pitch: float) -> None:
    assert check_pitch(stretch * pitch / MM_PER_UNIT[units], pitch, units=units) is None


@pytest.mark.parametrize("actual", list(MM_PER_UNIT))
@pytest.mark.parametrize("declared", list(MM_PER_UNIT))
@pytest.mark.parametrize("stretch", [0.8, 1.0, 1.25])
def test_wrong_unit_is_named(actual: str, declared: str, stretch: float) -> None:
    fault = check_pitch(stretch * 15 / MM_PER_UNIT[actual], 15, units=declared, file="scan.obj")
    if actual == declared:
        assert fault is None
        return
    assert fault is not None
    assert fault.code == "scan-units"
    assert fault.severity == "error"
    assert fault.file == "scan.obj"
    assert f'"Units": "{actual}"' in fault.remedy


@pytest.mark.parametrize("spacing", [15 / 4, 15 * 4, 0.0, -1.0, float("nan"), float("inf")])
def test_what_fits_no_unit(spacing: float) -> None:
    fault = check_pitch(spacing, 15)
    assert fault is not None
    assert fault.code == "scan-pitch"


def test_unknown_unit() -> None:
    with pytest.raises(MeshError, match="mesh-unknown-unit"):
        check_pitch(15, 15, units="yard")
