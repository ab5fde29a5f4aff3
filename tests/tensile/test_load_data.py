"""The machine's table: separators, commas, units, clocks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from kiribench.errors import DataError, TableError
from kiribench.tensile.clock import load_at_frames
from kiribench.tensile.frames import FrameList
from kiribench.tensile.load_data import read_load
from kiribench.tensile.sidecar import Cells, Event, Load, Sidecar

GERMAN = '"Probe";1\nZeit;Weg;Kraft\n(s);(mm);(kN)\n0,0;0,0;0,0\n0,5;0,0;0,0\n1,0;2,5;0,001\n'
ENGLISH = "Time (ms),Crosshead [cm],Load (lbf)\n0,0,0\n500,0,0\n1000,0.25,0.22480894\n"
PLAIN = "time\tdisplacement\tforce\n0\t0\t0\n0.5\t0\t0\n1\t2.5\t1\n"


def table(tmp_path: Path, text: str, encoding: str = "utf-8", load: Load | None = None):  # type: ignore[no-untyped-def]
    path = tmp_path / "machine.csv"
    path.write_bytes(text.encode(encoding))
    return read_load(path, load or Load(file="machine.csv"))


@pytest.mark.parametrize("text", [GERMAN, ENGLISH, PLAIN])
def test_units_and_commas_lead_to_the_same_numbers(tmp_path: Path, text: str) -> None:
    read = table(tmp_path, text)
    np.testing.assert_allclose(read.time_s, [0, 0.5, 1.0])
    np.testing.assert_allclose(read.displacement_mm, [0, 0, 2.5])
    np.testing.assert_allclose(read.force_n, [0, 0, 1.0], atol=1e-7)
    assert read.start_s == 0.5
    assert len(read.warnings) == (3 if text == PLAIN else 0)


def test_an_old_encoding_is_read(tmp_path: Path) -> None:
    read = table(tmp_path, "Prüfung;\nZeit (s);Weg (µm);Kraft (N)\n0;0;0\n1;2500;1\n", "latin-1")
    np.testing.assert_allclose(read.displacement_mm, [0, 2.5])


def test_declared_columns_win(tmp_path: Path) -> None:
    text = "t (s);load cell 1 (N);load cell 2 (N)\n0;0;5\n1;1;6\n"
    load = Load(file="machine.csv", columns={"time": "t (s)", "force": "load cell 2 (N)"})
    np.testing.assert_allclose(table(tmp_path, text, load=load).force_n, [5, 6])


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("", "load-header"),
        ("1;2;3\n4;5;6\n", "load-header"),
        ("Time (s);Speed (mm/s)\n0;1\n1;1\n", "load-columns"),
        ("Time (s);Load (pound)\n0;1\n1;1\n", "load-unit"),
        ("Time (s);Load (MN)\n0;1\n1;1\n", "load-unit"),
        ("Time (s);Load (N)\n0;1\n1;overload\n", "load-value"),
        ("Time (s);Load (N)\n0;1\n1;2\n0,5;3\n", "load-time-order"),
    ],
)
def test_a_wrong_table_is_named(tmp_path: Path, text: str, code: str) -> None:
    with pytest.raises(TableError) as caught:
        table(tmp_path, text)
    assert caught.value.code == code


def sidecar(**more: object) -> Sidecar:
    cells = Cells(rows=1, columns=1, corners_px=((0, 0), (9, 9)))
    return Sidecar(marker="dots", cells=cells, **more)  # type: ignore[arg-type]


FRAMES = FrameList(("a.png", "b.png", "c.png"), (), (10, 10), False, None, ())


def test_frames_are_put_on_the_machines_clock(tmp_path: Path) -> None:
    (tmp_path / "machine.csv").write_text(
        "Time (s);Extension (mm);Load (N)\n"
        + "".join(f"{t};{max(0, t - 3)};{2 * max(0, t - 3)}\n" for t in range(12))
    )
    times = (0.0, 1.0, 2.5)

    def at(load: Load) -> np.ndarray:
        declared = sidecar(frame_times_s=times, load=load)
        return load_at_frames(tmp_path, declared, FRAMES, "tensile.json").force_n

    np.testing.assert_allclose(at(Load(file="machine.csv", offset_s=4.0)), [2, 4, 7])
    event = Event(frame="b.png", time_s=6.0)
    np.testing.assert_allclose(at(Load(file="machine.csv", event=event)), [4, 6, 9])
    # The crosshead moves after 3 s; that is frame a.
    start = Event(frame="a.png")
    np.testing.assert_allclose(at(Load(file="machine.csv", event=start)), [0, 2, 5])
    late = at(Load(file="machine.csv", offset_s=9.0))
    np.testing.assert_allclose(late[:2], [12, 14])
    assert np.isnan(late[2])
    declared = sidecar(load=Load(file="machine.csv"))
    with pytest.raises(DataError, match="load-sync"):
        load_at_frames(tmp_path, declared, FRAMES, "tensile.json")
    with pytest.raises(DataError, match="load-event"):
        at(Load(file="machine.csv", event=Event(frame="x.png")))
