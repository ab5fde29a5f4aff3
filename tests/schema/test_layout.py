"""Grid, patch and regions as metadata."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kiribench.errors import DatasetError
from kiribench.schema.layout import Grid, Layout, LayoutMetadata, Patch, Regions
from kiribench.schema.strict_json import parse_model


def metadata(**keys: object) -> LayoutMetadata:
    return LayoutMetadata.model_validate(keys)


def test_default_is_the_papers_knee() -> None:
    layout = Layout.of()
    assert (layout.grid.rows, layout.grid.columns, layout.grid.pitch_mm) == (16, 12, 15.0)
    assert layout.grid.node_shape == (17, 13)
    assert (layout.patch.rows, layout.patch.columns, layout.patch.cell_mm) == (12, 6, 15.0)
    assert layout.patch_offset == (2, 3)
    assert layout.node_shape("flex000") == layout.node_shape("flex090") == (17, 13)
    assert layout.node_shape("flex090worn") == (13, 7)


def test_knee_regions_count_as_the_region_table_says() -> None:
    labels = Regions.knee(Patch()).labels
    counts = Counter(label for row in labels for label in row)
    assert counts == {"S": 12, "I": 12, "P": 16, "LS": 8, "MS": 8, "LI": 8, "MI": 8}
    assert labels[0] == labels[1] == ("S",) * 6
    assert labels[10] == labels[11] == ("I",) * 6
    assert labels[2] == labels[5] == ("LS", "LS", "P", "P", "MS", "MS")
    assert labels[6] == labels[9] == ("LI", "LI", "P", "P", "MI", "MI")


@given(rows=st.integers(1, 40), columns=st.integers(1, 40))
def test_knee_regions_cover_any_patch(rows: int, columns: int) -> None:
    patch = Patch(rows=rows, columns=columns)
    regions = Regions.knee(patch)
    assert regions.shape == (rows, columns)
    if rows >= 4 and columns >= 3:
        assert set(regions.names) == {"S", "I", "P", "LS", "MS", "LI", "MI"}
        # Lateral and medial mirror each other.
        swap = {"LS": "MS", "MS": "LS", "LI": "MI", "MI": "LI"}
        for row in regions.labels:
            assert tuple(swap.get(label, label) for label in reversed(row)) == row
    else:
        assert regions.names == ("all",)


def test_another_body_part_by_metadata_alone() -> None:
    table = [["top"] * 4] * 3 + [["bottom"] * 4] * 3
    layout = Layout.resolve(
        metadata(
            BodyPart="Elbow",
            Grid={"Rows": 8, "Columns": 6, "PitchMm": 10},
            Patch={"Rows": 6, "Columns": 4},
            Regions=table,
        )
    )
    assert layout.body_part == "elbow"
    assert layout.patch_offset == (1, 1)
    assert layout.patch.cell_mm == 10.0  # follows the grid
    assert layout.regions.names == ("top", "bottom")


def test_another_body_part_without_a_table_has_one_region() -> None:
    assert Layout.resolve(metadata(BodyPart="elbow")).regions.names == ("all",)


def test_subject_overrides_the_dataset_key_by_key() -> None:
    dataset = metadata(Grid={"Rows": 20, "PitchMm": 12}, Patch={"Rows": 10, "Columns": 8})
    subject = metadata(Grid={"PitchMm": 14}, Patch={"RowOffset": 1})
    layout = Layout.resolve(dataset, subject)
    assert layout.grid == Grid(rows=20, columns=12, pitch_mm=14)
    assert layout.patch.rows == 10
    assert layout.patch_offset == (1, 2)


def test_small_grid_without_a_patch_is_fine_until_the_patch_is_asked_for() -> None:
    layout = Layout.resolve(metadata(Grid={"Rows": 4, "Columns": 3}))
    with pytest.raises(DatasetError) as caught:
        _ = layout.patch_offset
    assert caught.value.code == "patch-outside-grid"


@pytest.mark.parametrize(
    ("keys", "code"),
    [
        ({"Patch": {"Rows": 17, "Columns": 6}}, "patch-outside-grid"),
        ({"Patch": {"RowOffset": 5}}, "patch-outside-grid"),
        ({"Patch": {"ColumnOffset": 7}}, "patch-outside-grid"),
        ({"Patch": {"Rows": 11}}, "patch-not-centrable"),
        ({"Patch": {"CellMm": 10}}, "patch-cell-size"),
        ({"Regions": [["a", "b"], ["c", "d"]]}, "regions-shape"),
    ],
)
def test_contradictory_layouts_are_refused(keys: dict[str, object], code: str) -> None:
    with pytest.raises(DatasetError) as caught:
        Layout.resolve(metadata(**keys))
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("keys", "column", "code"),
    [
        ({"Grid": {"Rows": "16"}}, "Grid.Rows", "json-value"),
        ({"Grid": {"Rows": 16.5}}, "Grid.Rows", "json-value"),
        ({"Grid": {"Rows": True}}, "Grid.Rows", "json-value"),
        ({"Grid": {"Rows": 0}}, "Grid.Rows", "json-value"),
        ({"Grid": {"Rows": 10**9}}, "Grid.Rows", "json-value"),
        ({"Grid": {"Pitch": 10}}, "Grid.Pitch", "json-key-unknown"),
        ({"Grid": {"PitchMm": -15}}, "Grid.PitchMm", "json-value"),
        ({"Grid": [16, 12]}, "Grid", "json-value"),
        ({"Patch": {"RowOffset": -1}}, "Patch.RowOffset", "json-value"),
        ({"Regions": [["a"], ["b", "c"]]}, "Regions", "json-value"),
        ({"Regions": []}, "Regions", "json-value"),
        ({"Regions": [["<script>"]]}, "Regions.labels.0.0", "json-value"),
        ({"Regions": "knee"}, "Regions", "json-value"),
        ({"BodyPart": "<b>knee</b>"}, "BodyPart", "json-value"),
    ],
)
def test_wrong_values_are_faults_with_their_key(
    keys: dict[str, object], column: str, code: str
) -> None:
    value, faults = parse_model(LayoutMetadata, keys, file="d.json")
    assert value is None
    assert [(fault.code, fault.column) for fault in faults] == [(code, column)]
    assert faults[0].file == "d.json"


def test_key_in_the_wrong_case_is_a_warning() -> None:
    value, faults = parse_model(LayoutMetadata, {"grid": {"Rows": 3}}, file="d.json")
    assert value is not None
    assert [(fault.code, fault.severity) for fault in faults] == [("json-key-case", "warning")]
