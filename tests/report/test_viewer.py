"""The packed 3-D view holds what was put in, and plotly accepts it."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
from importlib.resources import files

import numpy as np
import pytest
from report_cases import conformability_case, cylinder_mesh

from kiribench.report.viewer import PLOTLY, traces, viewer

DTYPES = {"f4": "<f4", "u2": "<u2", "u4": "<u4"}


@pytest.fixture(scope="module")
def parts() -> tuple:
    mesh, score = cylinder_mesh(), conformability_case()
    hover = [[f"cell {r} {c}" for c in range(6)] for r in range(12)]
    return (
        mesh.vertices_mm,
        mesh.faces,
        score.skin_outline_3d_mm,
        score.patch_outline_3d_mm,
        np.where(score.scored, score.grade, ""),
        hover,
    )


def unpack(spec: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(spec["bdata"]), DTYPES[spec["dtype"]])


def packed(payload: str, name: str) -> bytes:
    found = re.search(rf'<script [^>]*id="{name}"[^>]*>([^<]*)</script>', payload)
    assert found is not None
    return gzip.decompress(base64.b64decode(found[1]))


def test_the_skin_survives_the_packing(parts: tuple) -> None:
    skin = traces(*parts)[0]
    for axis, key in enumerate("xyz"):
        assert unpack(skin[key]) == pytest.approx(parts[0][:, axis], abs=1e-5)
    for corner, key in enumerate("ijk"):
        assert skin[key]["dtype"] == "u2"
        assert np.array_equal(unpack(skin[key]), parts[1][:, corner])


def test_more_vertices_than_a_short_holds_keep_their_numbers(parts: tuple) -> None:
    vertices = np.zeros((70_000, 3))
    faces = np.array([[0, 1, 69_999]], dtype=np.int32)
    skin = traces(vertices, faces, *parts[2:])[0]
    assert unpack(skin["k"]).tolist() == [69_999]


def test_every_scored_cell_is_one_closed_loop_in_the_colour_of_its_grade(parts: tuple) -> None:
    grades = parts[4]
    loops = {trace["name"]: trace for trace in traces(*parts) if trace.get("mode") == "lines"}
    for grade in ("good", "fair", "poor"):
        trace = loops[f"patch cells, {grade}"]
        points = np.stack([unpack(trace[axis]) for axis in "xyz"], axis=1)
        gaps = np.flatnonzero(np.isnan(points).all(axis=1))
        assert len(gaps) == (grades == grade).sum()
        starts = np.concatenate([[0], gaps[:-1] + 1])
        assert np.array_equal(points[starts], points[gaps - 1])
    assert len({trace["line"]["color"] for trace in loops.values()}) == 4


def test_the_letters_say_the_grades(parts: tuple) -> None:
    letters = next(trace for trace in traces(*parts) if trace["name"] == "grades")
    grades = parts[4][parts[4] != ""]
    assert letters["text"] == [grade[0].upper() for grade in grades]
    assert letters["hovertext"][0] == "cell 0 0"


def test_plotly_knows_every_option(parts: tuple) -> None:
    import plotly.graph_objects as go

    spec = json.loads(packed(viewer(*parts).payload, "view-data"))
    figure = go.Figure(data=spec["data"], layout=spec["layout"])
    assert [trace.type for trace in figure.data] == ["mesh3d", *["scatter3d"] * 5]


def test_the_policy_allows_exactly_what_is_packed(parts: tuple) -> None:
    view = viewer(*parts)
    script = re.search(r"<script>(.*)</script>", view.payload, re.DOTALL)
    assert script is not None
    library = packed(view.payload, "view-library")
    hashes = tuple(
        f"'sha256-{base64.b64encode(hashlib.sha256(data).digest()).decode()}'"
        for data in (script[1].encode(), library)
    )
    assert view.script_hashes == hashes


def test_the_library_is_the_one_of_plotly_with_its_licence() -> None:
    vendor = files("kiribench.report").joinpath("vendor")
    library = gzip.decompress(vendor.joinpath(PLOTLY).read_bytes())
    assert b"plotly.js (gl3d - minified) v4.1.1" in library[:200]
    assert "MIT License" in vendor.joinpath("LICENSE.plotly").read_text()


def test_packing_is_deterministic(parts: tuple) -> None:
    assert viewer(*parts).payload == viewer(*parts).payload
