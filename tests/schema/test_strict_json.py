"""JSON sidecars: what is no JSON, and what JSON libraries let pass."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kiribench.schema.sidecars import DatasetDescription, NodesSidecar, ScanSidecar
from kiribench.schema.strict_json import MAX_JSON_BYTES, parse_json, parse_model


@pytest.mark.parametrize(
    ("data", "code", "row", "column"),
    [
        (b"", "json-empty", None, None),
        (b" \n ", "json-empty", None, None),
        (b'{"Units": "mm",}', "json-syntax", 1, None),
        (b'{"Units": "mm"\n "Side": "left"}', "json-syntax", 2, None),
        (b'{"Units": "mm", "Units": "m"}', "json-duplicate-key", None, "Units"),
        (b'{"Grid": {"Rows": 1, "Rows": 2}}', "json-duplicate-key", None, "Rows"),
        (b'{"FlexionAngle": NaN}', "json-not-finite", None, None),
        (b'{"FlexionAngle": -Infinity}', "json-not-finite", None, None),
        (b"[1, 2]", "json-not-object", None, None),
        (b'"mm"', "json-not-object", None, None),
        (b'{"Scanner": "Z\xe4hler"}', "text-encoding", 1, None),
        ('{"Units": "mm"}'.encode("utf-16"), "text-encoding", None, None),
        (b'{"Units": "mm"}\x00', "text-binary", 1, None),
        (b"[" * 100_000, "json-syntax", None, None),
        (b'{"FlexionAngle": ' + b"9" * 10_000 + b"}", "json-syntax", None, None),
        (b" " * (MAX_JSON_BYTES + 1), "json-too-large", None, None),
    ],
)
def test_faults_of_the_text(data: bytes, code: str, row: int | None, column: str | None) -> None:
    value, faults = parse_json(data, file="x.json")
    assert value is None
    assert [(fault.code, fault.row, fault.column) for fault in faults] == [(code, row, column)]
    assert faults[0].file == "x.json"
    assert str(faults[0]).isprintable()


def test_byte_order_mark_is_a_warning() -> None:
    value, faults = parse_json(b'\xef\xbb\xbf{"Name": "x"}', file="x.json")
    assert value == {"Name": "x"}
    assert [(fault.code, fault.severity) for fault in faults] == [("text-bom", "warning")]


def test_overflowing_number_is_refused_by_the_model() -> None:
    # 1e999 is valid JSON and becomes inf.
    value, faults = parse_json(b'{"Units": "mm", "FlexionAngle": 1e999}', file="x.json")
    assert value is not None
    assert not faults
    sidecar, faults = parse_model(ScanSidecar, value, file="x.json")
    assert sidecar is None
    assert [fault.column for fault in faults] == ["FlexionAngle"]


@given(st.binary(max_size=200))
def test_any_bytes_give_an_object_or_a_fault(data: bytes) -> None:
    value, faults = parse_json(data, file="x.json")
    assert (value is None) == any(fault.severity == "error" for fault in faults)


@settings(max_examples=40)
@given(
    st.dictionaries(
        st.text(), st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists)
    )
)
def test_any_object_gives_a_sidecar_or_faults(value: dict[str, object]) -> None:
    sidecar, faults = parse_model(ScanSidecar, value, file="x.json")
    assert (sidecar is None) == any(fault.severity == "error" for fault in faults)
    assert all(str(fault).isprintable() for fault in faults)


def test_unknown_keys_are_kept() -> None:
    value = {"Units": "mm", "ScannerModel": "Eva", "Software": {"Name": "Studio", "Version": 17}}
    sidecar, faults = parse_model(ScanSidecar, value, file="x.json")
    assert sidecar is not None
    assert not faults
    assert sidecar.model_extra == {
        "ScannerModel": "Eva",
        "Software": {"Name": "Studio", "Version": 17},
    }


@pytest.mark.parametrize(
    ("given_", "unit"),
    [
        ("mm", "mm"),
        ("MM", "mm"),
        ("millimetres", "mm"),
        ("Meter", "m"),
        ("cm", "cm"),
        ("inch", "in"),
    ],
)
def test_unit_spellings(given_: str, unit: str) -> None:
    assert ScanSidecar.model_validate({"Units": given_}).units == unit


@pytest.mark.parametrize(
    ("given_", "side"),
    [("left", "left"), ("R", "right"), (" Right ", "right"), ("l", "left"), ("n/a", "none")],
)
def test_side_spellings(given_: str, side: str) -> None:
    assert ScanSidecar.model_validate({"Units": "mm", "Side": given_}).side == side


@pytest.mark.parametrize(
    ("value", "code", "column"),
    [
        ({}, "json-key-missing", "Units"),
        ({"Units": "furlong"}, "json-value", "Units"),
        ({"Units": None}, "json-value", "Units"),
        ({"Units": ["mm"]}, "json-value", "Units"),
        ({"Units": "mm", "Side": "sinister"}, "json-value", "Side"),
        ({"Units": "mm", "FlexionAngle": "90"}, "json-value", "FlexionAngle"),
        ({"Units": "mm", "FlexionAngle": True}, "json-value", "FlexionAngle"),
        ({"Units": "mm", "FlexionAngle": 400}, "json-value", "FlexionAngle"),
    ],
)
def test_wrong_scan_sidecars(value: dict[str, object], code: str, column: str) -> None:
    sidecar, faults = parse_model(ScanSidecar, value, file="x.json")
    assert sidecar is None
    assert [(fault.code, fault.column) for fault in faults] == [(code, column)]


def test_several_faults_at_once() -> None:
    value = {"Units": "mile", "Side": 3, "FlexionAngle": "0"}
    _, faults = parse_model(ScanSidecar, value, file="x.json")
    assert {fault.column for fault in faults} == {"Units", "Side", "FlexionAngle"}


def test_nodes_sidecar_is_in_millimetres() -> None:
    assert NodesSidecar.model_validate({"NodeSdMm": 0.1}).node_sd_mm == 0.1
    value, faults = parse_model(NodesSidecar, {"Units": "m"}, file="x.json")
    assert value is None
    assert faults[0].column == "Units"


def test_description_needs_a_name_only() -> None:
    text = json.dumps({"Name": "x", "BIDSVersion": "1.9.0"}).encode()
    value, _ = parse_json(text, file="d.json")
    assert value is not None
    description, faults = parse_model(DatasetDescription, value, file="d.json")
    assert description is not None
    assert description.name == "x"
    assert not faults
