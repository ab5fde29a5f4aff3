"""``kiribench export``: files, job sheet, gates and the verification of files from others."""

from __future__ import annotations

import json

import numpy as np
import pytest
from patch_cases import given_design, random_design, uniform_design

from kiribench.cli import main
from kiribench.schema.patch_design import write_design


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*tokens: object) -> tuple[int, str, str]:
        code = main([str(token) for token in tokens])
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.fixture
def table(tmp_path):
    return write_design(tmp_path, random_design(0, 4, 3))


def test_files_of_an_export(run, table, tmp_path):
    code, out, err = run("export", table, "--out", "cut", "--profile", "trotec", "--kerf-mm", 0.15)
    assert (code, err) == (0, "")
    assert out.rstrip().split("\n")[-1].startswith("Ready to cut: 8 files in cut")
    names = sorted(path.name for path in (tmp_path / "cut").iterdir())
    assert names == [
        "export.json",
        "kerf-coupon.dxf",
        "kerf-coupon.svg",
        *(f"sub-S1_{n}" for n in ("foam.dxf", "foam.svg", "job-sheet.html")),
        *(f"sub-S1_{n}" for n in ("patch.dxf", "patch.svg", "preview.svg")),
        *(f"sub-S1_{n}" for n in ("skin-template.dxf", "skin-template.svg")),
    ]
    result = json.loads((tmp_path / "cut" / "export.json").read_text())
    assert result["schema"] == "kiribench.export/1"
    # 12 centres and 6 inner corners, 6 notches; 8 upright edges and 9 level ones, 6 notches.
    assert (result["slits"], result["notches"]) == (12 + 6 + 6 + 8 + 9 + 6, 12)
    lost = 0.15 * (result["slits"] - 12) + 0.075 * 12
    assert result["slit_length_mm"] == pytest.approx(result["design_length_mm"] - lost)
    assert result["passed"]
    assert {v["file"] for v in result["verified"]} == {
        n for n in names if n[-3:] in ("svg", "dxf")
    } - {"sub-S1_preview.svg"}
    assert result["work"]["patch"]["seconds"] is None
    assert str(table) in result["provenance"]["inputs"]


def test_times_come_from_the_speeds_of_the_profile(run, table, tmp_path):
    from importlib.resources import files

    text = files("kiribench.fabrication").joinpath("profiles", "plain.toml").read_text("utf-8")
    (tmp_path / "ours.toml").write_text(
        text + "\n[speeds]\ncut_mm_s = 10\nmark_mm_s = 50\ntravel_mm_s = 400\n"
    )
    code, out, _ = run("export", table, "--out", "cut", "--profile", "ours.toml", "--json")
    assert code == 0
    work = json.loads(out)["work"]["patch"]
    expected = work["cut_mm"] / 10 + work["marked_mm"] / 50 + work["travel_mm"] / 400
    assert work["seconds"] == pytest.approx(expected)


def test_the_job_sheet_says_what_matters(run, table, tmp_path):
    (tmp_path / "placement.json").write_text(
        json.dumps(
            {
                "schema": "kiribench.placement/1",
                "offsets_mm": {"up": 1.5, "down": 2, "lateral": None},
                "turn_deg": 1.25,
                "strap_slip_mm": 3.0,
                "share": 0.9,
            }
        )
    )
    assert run("export", table, "--out", "cut", "--profile", "trotec", "--quiet")[0] == 0
    page = (tmp_path / "cut" / "sub-S1_job-sheet.html").read_text()
    for words in (
        "Ready to cut.",
        "Dragon Skin 20",
        "0.4\u00a0% of maximum head speed",
        "not a recommendation",
        "geometry optimisation",
        "No kerf was given",
        "shifted up",
        "up to 1.5 mm",
        "up to 1.25 degrees",
        "not known",
        "No time",
        "between the last gap",
        "#ff00ff",
    ):
        assert words in page, words
    assert "<script" not in page
    assert "http://" not in page.replace("http://www.w3.org/2000/svg", "")


def test_words_of_the_design_cannot_become_markup(run, tmp_path):
    table = write_design(tmp_path, random_design(0, 2, 2))
    sidecar = table.with_suffix(".json")
    content = json.loads(sidecar.read_text()) | {"Method": "<script>alert(1)</script>&"}
    sidecar.write_text(json.dumps(content))
    assert run("export", table, "--out", "cut", "--quiet")[0] == 0
    assert "<script" not in (tmp_path / "cut" / "sub-S1_job-sheet.html").read_text()
    for name in ("sub-S1_patch.svg", "sub-S1_preview.svg"):
        assert "<script" not in (tmp_path / "cut" / name).read_text()


def test_a_thin_ligament_stops_the_export_and_leaves_no_file_to_cut(run, table, tmp_path):
    assert run("export", table, "--out", "cut", "--quiet")[0] == 0
    code, out, err = run("export", table, "--out", "cut", "--ligament-mm", 3, "--kerf-mm", 0.1)
    assert code == 1
    assert "error[ligament-thin]" in err
    assert out.rstrip().endswith("No file for the machine was written.")
    left = {path.name for path in (tmp_path / "cut").iterdir()}
    assert left == {"export.json", "sub-S1_job-sheet.html", "sub-S1_preview.svg"}
    assert "Do not cut." in (tmp_path / "cut" / "sub-S1_job-sheet.html").read_text()


def test_the_ligament_of_the_design_is_the_default(run, tmp_path):
    table = write_design(tmp_path, uniform_design(0.8, 0.8, 3, 3))  # gaps of 1.5 mm
    sidecar = table.with_suffix(".json")
    content = json.loads(sidecar.read_text()) | {"Limits": {"LigamentMm": 1.6}}
    sidecar.write_text(json.dumps(content))
    assert run("export", table, "--out", "cut", "--quiet")[0] == 1
    assert run("export", table, "--out", "cut", "--ligament-mm", 1.5, "--quiet")[0] == 0


def test_round_trip_and_a_file_that_came_back_changed(run, table, tmp_path):
    options = ("--kerf-mm", 0.15, "--profile", "lightburn")
    assert run("export", table, "--out", "cut", *options)[0] == 0
    for name in ("patch", "foam", "skin-template"):
        for suffix in ("svg", "dxf"):
            part = "template" if name == "skin-template" else name
            file = tmp_path / "cut" / f"sub-S1_{name}.{suffix}"
            code, out, err = run(
                "export", "--verify", file, "--design", table, "--part", part, *options
            )
            assert (code, err) == (0, ""), err
            assert out.rstrip().endswith("It is the drawing of the design.")
    # Another kerf: all slits have another length.
    file = tmp_path / "cut" / "sub-S1_patch.svg"
    code, _, err = run("export", table, "--verify", file, "--kerf-mm", 0.3)
    assert code == 1
    assert "error[slit-length]" in err
    code, out, _ = run("export", "--verify", file, *options)
    assert code == 0
    assert "were not compared" in out
    text = file.read_text().replace('mm"', 'in"')
    file.write_text(text)
    code, out, _ = run("export", table, "--verify", file, *options, "--json")
    assert code == 1
    result = json.loads(out)
    assert result["schema"] == "kiribench.verify/1"
    assert "scale-inches" in {fault["code"] for fault in result["faults"]}


@pytest.mark.parametrize(
    ("tokens", "code", "name"),
    [
        (("export", "--out", "cut"), 2, "design-missing"),
        (("export", "TABLE"), 2, "out-missing"),
        (("export", "TABLE", "--out", "cut", "--profile", "laser9000"), 2, "profile-missing"),
        (("export", "TABLE", "--out", "cut", "--kerf-mm", "-1"), 2, "option-range"),
        (("export", "TABLE", "--out", "cut", "--kerf-mm", "nan"), 2, "option-range"),
        (("export", "TABLE", "--out", "cut", "--strap-mm", "0"), 2, "option-range"),
        (("export", "TABLE", "--out", "cut", "--ligament-mm", "inf"), 2, "option-range"),
        (("export", "none.tsv", "--out", "cut"), 3, "design-missing"),
        (("export", "--verify", "none.svg"), 3, "drawing-missing"),
    ],
)
def test_usage_and_data_errors(run, table, tokens, code, name):
    got, _, err = run(*(str(table) if token == "TABLE" else token for token in tokens))
    assert got == code
    assert f"error[{name}]" in err


@pytest.mark.parametrize(("longest", "warned"), [(0.009, True), (0.02, False), (0.0, False)])
def test_fractions_where_percent_are_asked_for_are_warned_of(run, tmp_path, longest, warned):
    table = write_design(tmp_path, uniform_design(longest, longest / 2, 2, 2))
    code, _, err = run("export", table, "--out", "cut", "--no-hoops", "--no-fiducials")
    assert code == 0
    assert ("warning[cuts-below-percent]" in err) == warned


def test_no_cuts_no_hoops_no_marks(run, tmp_path):
    table = write_design(tmp_path, given_design(np.zeros((2, 2)), np.zeros((2, 2)), participant=""))
    code, out, _ = run("export", table, "--out", "cut", "--no-hoops", "--no-fiducials", "--quiet")
    assert code == 0
    assert "0 slits" in out
    assert (tmp_path / "cut" / "design_patch.svg").is_file()
