"""The JSON sidecars of a dataset: CamelCase keys as in BIDS; unknown keys are kept."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic.alias_generators import to_pascal

Side = Literal["left", "right", "none"]
"""``none`` is for a body part that is not one of a pair; it has no handedness to check."""

Units = Literal["mm", "cm", "m", "in"]

MM_PER_UNIT: dict[str, float] = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}

_UNIT_NAMES = {
    "mm": "mm",
    "millimeter": "mm",
    "millimeters": "mm",
    "millimetre": "mm",
    "millimetres": "mm",
    "cm": "cm",
    "centimeter": "cm",
    "centimeters": "cm",
    "centimetre": "cm",
    "centimetres": "cm",
    "m": "m",
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "in": "in",
    "inch": "in",
    "inches": "in",
}

_SIDE_NAMES = {
    "l": "left",
    "left": "left",
    "r": "right",
    "right": "right",
    "none": "none",
    "n/a": "none",
    "midline": "none",
}


def side_of(value: Any) -> Any:
    """``left``, ``right`` or ``none`` for their usual spellings; anything else unchanged."""
    return _SIDE_NAMES.get(value.strip().lower(), value) if isinstance(value, str) else value


def _unit_of(value: Any) -> Any:
    return _UNIT_NAMES.get(value.strip().lower(), value) if isinstance(value, str) else value


class _Sidecar(BaseModel):
    model_config = ConfigDict(
        frozen=True,
        strict=True,
        extra="allow",
        alias_generator=to_pascal,
        populate_by_name=True,
        allow_inf_nan=False,
    )


class DatasetDescription(_Sidecar):
    """``dataset_description.json``; the layout keys are read by ``schema.layout``.

    Attributes:
        name: the dataset's name; the only key that is required.
    """

    name: Annotated[str, Field(min_length=1, max_length=200)]


class ScanSidecar(_Sidecar):
    """``sub-X_acq-Y_scan.json``.

    Attributes:
        units: unit of the scan's coordinates; an OBJ file has none of its own.
        flexion_angle: degrees between the pose and the straight limb, or None.
        side: the side of the body, or None where participants.tsv gives it.
        scanner: free text, or None.
    """

    units: Annotated[Units, BeforeValidator(_unit_of)]
    flexion_angle: Annotated[float, Field(ge=-30.0, le=180.0)] | None = None
    side: Annotated[Side, BeforeValidator(side_of)] | None = None
    scanner: str | None = None


class NodesSidecar(_Sidecar):
    """``sub-X_acq-Y_nodes.json``, optional.

    Attributes:
        units: unit of x_mm, y_mm, z_mm; can only be ``mm``.
        node_sd_mm: standard deviation of a node's position along each surface direction,
            for tables without a column ``sd_mm``; or None. The key is ``NodeSdMm``.
    """

    units: Annotated[Literal["mm"], BeforeValidator(_unit_of)] | None = None
    node_sd_mm: Annotated[float, Field(ge=0.0, le=100.0)] | None = None
