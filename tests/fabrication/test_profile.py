"""Machine profiles: those that ship, and what a faulty one is told."""

from __future__ import annotations

import pytest

from kiribench.errors import UsageError
from kiribench.fabrication.profile import PROFILES, read_profile
from kiribench.fabrication.strokes import ROLES


@pytest.mark.parametrize("name", PROFILES)
def test_shipped_profiles_hold_every_role_once_and_cut_the_outline_last(name):
    profile = read_profile(name)
    roles = [role for layer in profile.layers for role in layer.roles]
    assert sorted(roles) == sorted(ROLES)
    assert profile.layers[-1].roles == ("outline",)
    assert profile.layer_of("slit").colour == "#ff0000"
    assert len({layer.colour for layer in profile.layers}) == len(profile.layers)
    # Nobody's speeds or kerf are known here.
    assert profile.cut_mm_s is profile.travel_mm_s is profile.kerf_mm is None


def test_the_papers_settings_are_for_the_record_only():
    assert "0.4 %" in read_profile("trotec").paper_settings["speed"]
    assert read_profile("plain").paper_settings == {}


def test_a_profile_of_ones_own(tmp_path):
    text = read_profile_text("plain").replace("stroke_mm = 0.1", "stroke_mm = 0.2\nkerf_mm = 0.12")
    path = tmp_path / "ours.toml"
    path.write_text(text + "\n[speeds]\ncut_mm_s = 10\nmark_mm_s = 100\ntravel_mm_s = 500\n")
    profile = read_profile(str(path))
    assert (profile.name, profile.stroke_mm, profile.kerf_mm) == ("ours", 0.2, 0.12)
    assert (profile.cut_mm_s, profile.mark_mm_s, profile.travel_mm_s) == (10, 100, 500)


def read_profile_text(name: str) -> str:
    from importlib.resources import files

    return files("kiribench.fabrication").joinpath("profiles", f"{name}.toml").read_text("utf-8")


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ('"#ff0000"', '"red"', "layers[2].colour"),
        ('roles = ["slot"]', 'roles = ["slots"]', "layers[3].roles"),
        ('roles = ["slot"]', "roles = []", "layers"),
        ("stroke_mm = 0.1", "stroke_mm = -1", "stroke_mm"),
        ("stroke_mm = 0.1", "strokes = 1", "strokes"),
        ("stroke_mm = 0.1", "[speeds]\ncut = 3", "speeds.cut"),
        ("aci = 6", "aci = 300", "layers[4].aci"),
        ('"#ff00ff"', '"#ff0000"', "layers.colour"),
        ('roles = ["slot"]', 'roles = ["outline"]', "layers"),
    ],
)
def test_faults_of_a_profile_name_their_place(tmp_path, old, new, where):
    path = tmp_path / "bad.toml"
    path.write_text(read_profile_text("plain").replace(old, new, 1))
    with pytest.raises(UsageError) as caught:
        read_profile(str(path))
    assert {fault.code for fault in caught.value.faults} == {"profile-value"}
    assert where in {fault.column for fault in caught.value.faults}


def test_missing_and_broken_profiles(tmp_path):
    with pytest.raises(UsageError, match="trotec"):
        read_profile("no-such-machine")
    path = tmp_path / "broken.toml"
    path.write_text("title = [")
    with pytest.raises(UsageError) as caught:
        read_profile(str(path))
    assert caught.value.code == "profile-syntax"
    path.write_bytes(b"title = '\xff'")
    with pytest.raises(UsageError) as caught:
        read_profile(str(path))
    assert caught.value.code == "profile-syntax"
