"""``kiribench synth``: options, repeatability and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from kiribench.cli import main
from kiribench.provenance import file_sha256

FAST = ["--edge-mm", "8"]


def _hashes(root: Path) -> dict[str, str]:
    return {
        str(path.relative_to(root)): file_sha256(path)
        for path in sorted(root.rglob("*"))
        if path.is_file() and path != root / "synth.json"
    }


def _run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(main(list(arguments)))
    return int(ended.value.code or 0)


def test_random_subjects_repeat_for_a_seed_and_differ_for_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = []
    for name, seed in (("a", "5"), ("b", "5"), ("c", "6")):
        assert (
            _run("synth", "--random", "1", "--seed", seed, "--out", str(tmp_path / name), *FAST)
            == 0
        )
        made.append(_hashes(tmp_path / name))
    assert made[0] == made[1]
    scan = "sub-R001/surf/sub-R001_acq-flex000_scan.obj"
    assert made[0][scan] != made[2][scan]
    assert "Wrote 1 synthetic subject" in capsys.readouterr().out


def test_json_gives_the_truths_counts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "set"
    assert _run("synth", "--subjects", "sub-S3,S1", "--out", str(out), "--json", *FAST) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["schema"] == "kiribench.synth/1"
    assert [
        (p["id"], p["side"], p["good"] + p["fair"], p["cells"]) for p in result["participants"]
    ] == [
        ("S3", "right", 56, 72),
        ("S1", "right", 66, 72),
    ]
    assert (out / "sub-S1" / "surf").is_dir() and not (out / "sub-S2").exists()


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--subjects", "S9"], "synth-unknown-subject"),
        (["--subjects", "S1,S1"], "synth-unknown-subject"),
        (["--random", "-1"], "synth-option"),
        (["--noise-mm", "-0.1"], "synth-option"),
        (["--edge-mm", "100"], "synth-option"),
    ],
)
def test_wrong_options_are_usage_errors(
    arguments: list[str], code: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run("synth", "--out", str(tmp_path / "x"), *arguments) == 2
    assert code in capsys.readouterr().err


def test_a_folder_is_required_and_must_be_empty(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run("synth") == 2
    assert "synth-no-output" in capsys.readouterr().err
    (tmp_path / "file").write_text("x")
    assert _run("synth", "--out", str(tmp_path)) == 2
    assert "synth-not-empty" in capsys.readouterr().err
