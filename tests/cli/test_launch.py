"""The launcher: exit codes, JSON, settings file and flags, where results go."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from kiribench import __version__
from kiribench.cli import launch
from kiribench.cli.command import Common, Outcome
from kiribench.errors import DataError, Fault, GateFailed, NotConvergedError


def probe(
    data: Path, /, *, level: float = 0.5, names: tuple[str, ...] = (), common: Common | None = None
) -> Outcome:
    """Probe the launcher.

    Parameters
    ----------
    data
        The input.
    level
        A number.
    names
        Some words.
    """
    match data.name:
        case "bad":
            raise DataError("probe-bad", "It is bad.", remedy="Mend it.", file=data, row=3)
        case "stuck":
            raise NotConvergedError("probe-stuck", "It is stuck.", remedy="Wait.")
        case "gate":
            raise GateFailed("probe-gate", "Below.", remedy="Rise.", got=0.1, expected=0.9)
        case "bug":
            raise ZeroDivisionError("oops")
        case "stop":
            raise KeyboardInterrupt
    warning = Fault("probe-warning", "Look.", "Nothing.", severity="warning")
    return Outcome({"schema": "probe/1", "level": level}, f"level {level}", faults=(warning,))


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    module = ModuleType("kiribench.cli.probe")
    probe.__module__ = module.__name__
    module.probe = probe
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(launch, "COMMANDS", {"probe": "Probe the launcher."})
    monkeypatch.chdir(tmp_path)

    def call(*tokens: str) -> tuple[int, str, str]:
        code = launch.main(tokens)
        out, err = capsys.readouterr()
        return code, out, err

    return call


@pytest.mark.parametrize(
    ("data", "code", "name"),
    [
        ("good", 0, "probe-warning"),
        ("gate", 1, "probe-gate"),
        ("bad", 3, "probe-bad"),
        ("stuck", 4, "probe-stuck"),
        ("bug", 70, "bug"),
        ("stop", 130, "interrupted"),
    ],
)
def test_exit_codes(run, data, code, name):
    got, _, err = run("probe", data)
    assert got == code
    assert name in err


@pytest.mark.parametrize(
    "tokens",
    [("probe",), ("probe", "good", "--level", "x"), ("probe", "good", "--lvl", "1"), ("nothing",)],
)
def test_usage_errors_exit_with_2(run, tokens):
    code, out, err = run(*tokens)
    assert code == 2
    assert out == ""
    assert err.startswith("error[usage]")


def test_error_says_where_and_what_to_do(run):
    _, _, err = run("probe", "bad")
    assert err.strip() == "error[probe-bad] bad, row 3: It is bad. Remedy: Mend it."


def test_json_is_one_object_and_errors_are_json_too(run):
    code, out, _ = run("probe", "good", "--json")
    result = json.loads(out)
    assert (code, result["schema"], result["level"]) == (0, "probe/1", 0.5)
    assert result["provenance"]["kiribench"] == __version__
    _, out, _ = run("probe", "bad", "--json")
    assert json.loads(out) == {
        "schema": "kiribench.error/1",
        "faults": [
            {
                "code": "probe-bad",
                "what": "It is bad.",
                "remedy": "Mend it.",
                "file": "bad",
                "row": 3,
                "severity": "error",
            }
        ],
    }


def test_quiet_hides_warnings_but_not_errors(run):
    assert run("probe", "good", "--quiet")[2] == ""
    assert "probe-bad" in run("probe", "bad", "--quiet")[2]


def test_settings_file_and_flags_give_the_same_options(run, tmp_path):
    (tmp_path / "my.toml").write_text('[probe]\nlevel = 0.25\nnames = ["a", "b"]\n')
    from_file = json.loads(run("--config", "my.toml", "probe", "good", "--json")[1])
    flags = ("--level", "0.25", "--names", "a", "--names", "b")
    from_flags = json.loads(run("probe", "good", *flags, "--json")[1])
    assert from_file["settings"].pop("config") == "my.toml"
    assert from_file == from_flags
    assert from_flags["settings"]["names"] == ["a", "b"]
    win = json.loads(run("probe", "good", "--level", "1", "--json", "--config", "my.toml")[1])
    assert win["settings"]["level"] == 1.0


def test_settings_file_of_the_folder_is_read(run, tmp_path):
    (tmp_path / "kiribench.toml").write_text("[probe]\nlevel = 0.75\n")
    assert run("probe", "good")[1] == "level 0.75\n"


@pytest.mark.parametrize("text", ["[probe]\nlevle = 1\n", "[probe\n", "[probe]\nlevel = 'x'\n"])
def test_bad_settings_file_is_a_usage_error(run, tmp_path, text):
    (tmp_path / "my.toml").write_text(text)
    assert run("--config", "my.toml", "probe", "good")[0] == 2


def test_missing_settings_file_is_a_usage_error(run):
    code, _, err = run("--config", "none.toml", "probe", "good")
    assert code == 2
    assert "settings-missing" in err


def test_out_keeps_the_result_with_its_settings(run, tmp_path):
    run("probe", "good", "--out", "deep/er")
    kept = json.loads((tmp_path / "deep/er/probe.json").read_text())
    assert kept["settings"] == {
        "data": "good",
        "level": 0.5,
        "names": [],
        "out": "deep/er",
        "json": False,
        "quiet": False,
    }


def test_help_answers_without_the_heavy_libraries():
    code = (
        "import sys; from kiribench.cli import main; main(['--help']); "
        "heavy = {'torch', 'trimesh', 'plotly', 'pandas', 'scipy', 'numba', 'matplotlib', "
        "'sklearn', 'pandera', 'shapely', 'cv2', 'pydantic'} & set(sys.modules); "
        "sys.exit(','.join(sorted(heavy)) or None)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in launch.COMMANDS:
        assert name in done.stdout


def test_version(capsys):
    assert launch.main(["--version"]) == 0
    assert capsys.readouterr().out.strip() == __version__


def test_no_color():
    done = subprocess.run(
        [sys.executable, "-m", "kiribench", "--help"],
        capture_output=True,
        text=True,
        check=True,
        env={"NO_COLOR": "1", "FORCE_COLOR": "", "PATH": "", "TERM": "xterm-256color"},
    )
    assert "\x1b[" not in done.stdout


def test_completion_script_is_generated():
    script = launch.build_app().generate_completion(shell="bash")
    assert "kiribench" in script


@pytest.mark.parametrize("out", ["kept.txt", "kept.txt/deeper", "/proc/results", "x" * 300])
def test_out_that_cannot_be_written_is_a_usage_error(run, tmp_path, out):
    (tmp_path / "kept.txt").write_text("mine", encoding="ascii")
    code, text, err = run("probe", "good", "--json", "--out", out)
    assert code == 2
    assert json.loads(text)["faults"][0]["code"] == "out-not-writable"
    assert "Traceback" not in err
    assert (tmp_path / "kept.txt").read_text(encoding="ascii") == "mine"


@pytest.mark.parametrize("name", ["validate", "measure"])
def test_an_error_without_a_reader_keeps_its_exit_code(name):
    command = [sys.executable, "-m", "kiribench", name, "/nowhere", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    said = process.stderr.read()
    process.stderr.close()
    assert process.wait() == 3
    assert "Traceback" not in said
    assert "BrokenPipe" not in said
