"""Campaigns: kept piece by piece, resumed after a kill, the same on one, two or many processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from kiribench.errors import KiribenchError, TableError, UsageError
from kiribench.fem import campaign_piece, equilibrium
from kiribench.fem.campaign import PIECES, run_campaign
from kiribench.fem.campaign_piece import Piece, piece_path, read_piece, simulate_design
from kiribench.fem.campaign_settings import (
    PAPER_DISPLACEMENTS_MM,
    CampaignSettings,
    Design,
    paper_designs,
)
from kiribench.fem.campaign_words import read_designs, read_steps
from kiribench.fem.cell import simulate_cell
from kiribench.fem.facet import MeshSpec
from kiribench.schema.design_space_table import COLUMNS, rounded

STEPS = (1.1, 1.2, 1.3)
SETTINGS = CampaignSettings.of("cell", STEPS, 2.5)
DESIGNS = tuple(Design(float(a), float(b)) for a in (30, 60, 90) for b in (40, 80, 90))
WORDS = ";".join(f"{design.a_percent:g},{design.b_percent:g}" for design in DESIGNS)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a campaign that nobody interrupted."""
    folder = tmp_path_factory.mktemp("undisturbed")
    run_campaign(SETTINGS, DESIGNS, folder)
    return folder


def table_bytes(folder: Path) -> bytes:
    return (folder / "design_space.parquet").read_bytes()


def test_rows_are_the_load_paths(undisturbed: Path) -> None:
    frame = pd.read_parquet(undisturbed / "design_space.parquet")
    assert list(frame.columns) == list(COLUMNS)
    assert len(frame) == len(DESIGNS) * len(STEPS)
    assert frame["design"].unique().tolist() == [design.name for design in DESIGNS]
    rows = frame[frame["design"] == "90-80"]
    path = simulate_cell(0.9, 0.8, STEPS, mesh=MeshSpec.of_edge(2.5))
    assert rows["step"].tolist() == [1, 2, 3]
    assert set(rows["status"]) == {"ok"}
    for name in campaign_piece.NUMBERS:
        np.testing.assert_array_equal(rows[name], rounded(getattr(path, name)), err_msg=name)


def test_the_sidecar_says_what_the_numbers_mean(undisturbed: Path) -> None:
    sidecar = json.loads((undisturbed / "design_space.json").read_text())
    assert sidecar["Model"] == "cell"
    assert sidecar["Steps"] == list(STEPS)
    assert sidecar["Mesh"]["longest_edge_mm"] == 2.5
    assert sidecar["Material"]["mu_mpa"] == 0.207
    assert sidecar["StoredMeasure"].startswith("none")
    assert set(sidecar["Columns"]) == set(COLUMNS)
    assert sidecar["Columns"]["nominal_stress_mpa"]["Units"] == "MPa"
    assert sidecar["StepsOk"] == len(DESIGNS) * len(STEPS)
    assert sidecar["Cost"]["CpuSeconds"] > 0


@pytest.mark.parametrize("jobs", [1, 2])
def test_killed_and_started_again_gives_the_same_table(
    jobs: int, undisturbed: Path, tmp_path: Path
) -> None:
    """kill -9 of the process while designs are under way."""
    command = [sys.executable, "-m", "kiribench", "simulate", "--designs", WORDS, "--steps"]
    command += ["1.1,1.2,1.3", "--mesh-mm", "2.5", "--jobs", str(jobs), "--out", str(tmp_path)]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    pieces = tmp_path / PIECES
    ended = time.monotonic() + 120
    while time.monotonic() < ended and len(list(pieces.glob("*-*.json"))) < 2:
        assert process.poll() is None, "the campaign ended before it could be killed"
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    if jobs == 2:  # what was under way in its workers is lost with them
        os.killpg(process.pid, signal.SIGKILL)
    assert not (tmp_path / "design_space.parquet").exists()
    kept = {path: path.stat().st_mtime_ns for path in pieces.glob("*-*.json")}
    assert 2 <= len(kept) < len(DESIGNS)
    campaign = run_campaign(SETTINGS, DESIGNS, tmp_path)
    assert campaign.resumed == len(kept)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert table_bytes(tmp_path) == table_bytes(undisturbed)


def test_two_processes_give_the_same_table(undisturbed: Path, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    run_campaign(
        SETTINGS,
        DESIGNS,
        tmp_path,
        jobs=2,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen == [(k, len(DESIGNS)) for k in range(len(DESIGNS) + 1)]
    assert table_bytes(tmp_path) == table_bytes(undisturbed)


def test_a_dask_cluster_gives_the_same_table(undisturbed: Path, tmp_path: Path) -> None:
    """Two real worker processes; one design is already there."""
    from distributed import LocalCluster

    run_campaign(SETTINGS, DESIGNS[3:4], tmp_path)
    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        campaign = run_campaign(SETTINGS, DESIGNS, tmp_path, scheduler=cluster.scheduler_address)
    assert campaign.resumed == 1
    assert table_bytes(tmp_path) == table_bytes(undisturbed)


def test_nobody_at_the_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import Client

    start = Client.__init__

    def briefly(self: Client, *args: object, **options: object) -> None:
        start(self, *args, **(options | {"timeout": "1s"}))

    monkeypatch.setattr(Client, "__init__", briefly)
    with pytest.raises(UsageError) as caught:
        run_campaign(SETTINGS, DESIGNS[:1], tmp_path, scheduler="tcp://127.0.0.1:9")
    assert caught.value.code == "scheduler-unreachable"


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        (CampaignSettings.of("cell", (1.1, 1.2), 2.5), "Steps"),
        (CampaignSettings.of("cell", STEPS, 1.25), "Mesh"),
        (CampaignSettings.of("sheet", STEPS, 2.5), "Model"),
    ],
)
def test_other_settings_in_the_same_folder(
    changed: CampaignSettings, key: str, undisturbed: Path
) -> None:
    with pytest.raises(UsageError, match=f"Got .*{key}") as caught:
        run_campaign(changed, DESIGNS, undisturbed)
    assert caught.value.code == "campaign-settings-changed"


def test_more_designs_in_the_same_folder(tmp_path: Path) -> None:
    run_campaign(SETTINGS, DESIGNS[:2], tmp_path)
    campaign = run_campaign(SETTINGS, DESIGNS[1:3], tmp_path)
    assert campaign.resumed == 1
    assert campaign.frame["design"].unique().tolist() == [d.name for d in DESIGNS[1:3]]


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"columns": {}}', "another design", "another"])
def test_a_piece_that_is_no_result_is_computed_again(
    damage: str, undisturbed: Path, tmp_path: Path
) -> None:
    run_campaign(SETTINGS, DESIGNS[:2], tmp_path)
    first, second = (piece_path(tmp_path / PIECES, design) for design in DESIGNS[:2])
    content = json.loads(first.read_text())
    if damage == "another design":
        damage = second.read_text()
    elif damage == "another":
        damage = json.dumps(content | {"fingerprint": "0" * 16})
    first.write_text(damage)
    (tmp_path / PIECES / ".30-40.json.1.part").write_text("{")
    campaign = run_campaign(SETTINGS, DESIGNS[:2], tmp_path)
    assert campaign.resumed == 1
    assert json.loads(first.read_text())["columns"] == content["columns"]
    assert not list((tmp_path / PIECES).glob(".*"))


def test_a_design_without_an_answer_does_not_stop_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The solver may not halve its steps and takes few iterations: soft hinges fail."""
    monkeypatch.setattr(equilibrium, "_SMALLEST_STEP", 1.0)
    monkeypatch.setattr(equilibrium, "_MOST_ITERATIONS", 4)
    settings = CampaignSettings.of("cell", (1.001, 1.9, 2.0), 2.5)
    designs = [Design(90, 90), Design(0, 0)]
    campaign = run_campaign(settings, designs, tmp_path)
    first, second = campaign.pieces
    assert first.status == ("ok", "not-converged", "not-reached")
    assert second.status[0] == "ok"
    frame = campaign.frame
    assert frame["status"].tolist() == [*first.status, *second.status]
    assert frame["lateral_stretch"].isna().tolist()[:4] == [False, True, True, False]
    sidecar = json.loads(campaign.sidecar.read_text())
    assert sidecar["Incomplete"]["90-90"] == first.reason
    assert first.reason is not None
    assert "iterations" in first.reason
    assert run_campaign(settings, designs, tmp_path).resumed == 2


def test_work_that_ran_out_goes_on_with_more(undisturbed: Path, tmp_path: Path) -> None:
    few = CampaignSettings.of("cell", STEPS, 2.5, most_work=6)
    campaign = run_campaign(few, DESIGNS, tmp_path)
    ended = [piece for piece in campaign.pieces if piece.reason is not None]
    assert len(ended) > 0
    assert all("work limit of 6 iterations" in str(piece.reason) for piece in ended)
    assert run_campaign(few, DESIGNS, tmp_path).resumed == len(DESIGNS)
    assert run_campaign(SETTINGS, DESIGNS, tmp_path).resumed == len(DESIGNS) - len(ended)
    assert table_bytes(tmp_path) == table_bytes(undisturbed)


def test_meshes_are_refined_where_the_error_asks_for_it(tmp_path: Path) -> None:
    """One of two designs exceeds the limit; a piece of a coarse mesh is not taken for an answer."""
    coarse = run_campaign(SETTINGS, DESIGNS[:3], tmp_path / "coarse")
    errors = [float(np.nanmax(piece.columns["mesh_error_poisson"])) for piece in coarse.pieces]
    limit = sorted(errors)[1] * 1.01
    settings = CampaignSettings.of("cell", STEPS, 2.5, mesh_error_limit=limit)
    assert settings.fingerprint == SETTINGS.fingerprint
    folder = tmp_path / "fine" / PIECES
    folder.mkdir(parents=True)
    for piece in coarse.pieces:
        campaign_piece.write_piece(folder, piece)
    campaign = run_campaign(settings, DESIGNS[:3], tmp_path / "fine")
    assert campaign.resumed == 2
    refined = [piece for piece in campaign.pieces if piece.mesh_scale < 1]
    (one,) = refined
    assert one.design == coarse.pieces[int(np.argmax(errors))].design
    assert one.largest_mesh_error is not None
    assert one.largest_mesh_error < limit
    path = simulate_cell(
        one.design.a_percent / 100,
        one.design.b_percent / 100,
        STEPS,
        mesh=MeshSpec.of_edge(2.5).scaled(one.mesh_scale),
    )
    np.testing.assert_array_equal(one.columns["lateral_stretch"], path.lateral_stretch)
    sidecar = json.loads(campaign.sidecar.read_text())
    assert list(sidecar["RefinedMeshes"]) == [one.design.name]
    assert run_campaign(settings, DESIGNS[:3], tmp_path / "fine").resumed == 3


def test_a_finer_mesh_without_an_answer_replaces_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = campaign_piece._simulate

    def fails(settings: CampaignSettings, design: Design, mesh_scale: float) -> Piece:
        piece = whole(settings, design, 1.0)
        if mesh_scale == 1.0:
            return piece
        return replace(piece, reason="no convergence", mesh_scale=mesh_scale)

    monkeypatch.setattr(campaign_piece, "_simulate", fails)
    settings = CampaignSettings.of("cell", STEPS, 2.5, mesh_error_limit=1e-9)
    (piece,) = run_campaign(settings, DESIGNS[:1], tmp_path).pieces
    assert piece.reason is None
    assert piece.mesh_scale == 1.0
    assert piece.finest_tried == pytest.approx(0.7**3)
    assert run_campaign(settings, DESIGNS[:1], tmp_path).resumed == 1


def test_a_solver_that_raises_is_a_result_and_is_tried_again(
    undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def raises(a: float, b: float, *args: object, **options: object) -> object:
        if a == 0.6:
            raise RuntimeError("factor is exactly singular")
        return simulate_cell(a, b, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(campaign_piece, "simulate_cell", raises)
    campaign = run_campaign(SETTINGS, DESIGNS, tmp_path)
    assert [piece.design.a_percent for piece in campaign.incomplete] == [60.0] * 3
    assert campaign.incomplete[0].status == ("failed",) * 3
    assert campaign.incomplete[0].reason == "RuntimeError: factor is exactly singular"
    monkeypatch.undo()
    assert run_campaign(SETTINGS, DESIGNS, tmp_path).resumed == 6
    assert table_bytes(tmp_path) == table_bytes(undisturbed)


def test_pieces_keep_every_digit(tmp_path: Path) -> None:
    content = simulate_design(SETTINGS, DESIGNS[0])
    piece = Piece.from_dict(json.loads(json.dumps(content)))
    assert piece.as_dict() == content
    run_campaign(SETTINGS, DESIGNS[:1], tmp_path)
    kept = read_piece(tmp_path / PIECES, DESIGNS[0])
    assert kept is not None
    assert kept.columns == piece.columns


def test_a_worker_with_other_numerics_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from kiribench.fem import campaign_workers

    def other(settings: CampaignSettings, design: Design) -> dict[str, object]:
        return simulate_design(settings, design) | {"fingerprint": "0" * 16}

    monkeypatch.setattr(campaign_workers, "simulate_design", other)
    with pytest.raises(KiribenchError) as caught:
        run_campaign(SETTINGS, DESIGNS[:1], tmp_path)
    assert caught.value.code == "worker-version"


def test_the_paper() -> None:
    designs = paper_designs()
    assert len(designs) == len(set(designs)) == 441
    assert {design.a_percent for design in designs} == {1, 99, *range(5, 100, 5)}
    assert tuple(range(10, 260, 10)) == PAPER_DISPLACEMENTS_MM
    assert len(CampaignSettings.of("cell").steps) == 25
    assert Design(35.0, 87.5).name == "35-87.5"


@pytest.mark.parametrize(
    ("words", "steps"),
    [
        ("10,50,120", (10, 50, 120)),
        ("10:50:20", (10, 30, 50)),
        ("1.1:1.4:0.1", (1.1, 1.2, 1.3, 1.4)),
        (" 5 , 10:30:10 ", (5, 10, 20, 30)),
    ],
)
def test_steps(words: str, steps: tuple[float, ...]) -> None:
    assert read_steps(words) == steps


@pytest.mark.parametrize("words", ["ten", "10:50", "10:50:0", "50:10:5", "1:2:3:4", "1:1e9:1e-3"])
def test_steps_that_are_none(words: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_steps(words)
    assert caught.value.code == "steps-words"


@pytest.mark.parametrize(
    ("model", "steps"),
    [
        ("sheet", ()),
        ("sheet", (0.0, 10.0)),
        ("sheet", (10.0, 10.0)),
        ("sheet", (20.0, 10.0)),
        ("sheet", (-10.0, 20.0)),
        ("sheet", (10.0, float("nan"))),
        ("cell", (10.0, float("inf"))),
        ("cell", (1.0, 1.1)),
        ("cell", (0.9, 1.1)),
        ("cell", (0.5, -0.5)),
    ],
)
def test_steps_that_do_not_lead_away_from_rest(model: str, steps: tuple[float, ...]) -> None:
    with pytest.raises(UsageError) as caught:
        CampaignSettings.of(model, steps)  # type: ignore[arg-type]
    assert caught.value.code == "steps-order"


def test_designs(tmp_path: Path) -> None:
    assert read_designs("35,85; 90,90;")[0] == (Design(35, 85), Design(90, 90))
    assert len(read_designs("paper")[0]) == 441
    many = ";".join(["61.7,73.4"] * 900)  # longer than the name of any file may be
    assert read_designs(many)[0] == (Design(61.7, 73.4),) * 900
    table = tmp_path / "designs.csv"
    table.write_text("name,a_percent,b_percent\nx,35,85\ny,12.5,0\n")
    assert read_designs(str(table)) == ((Design(35, 85), Design(12.5, 0)), (table,))


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("35", "designs-words"),
        ("35,85,1", "designs-words"),
        ("a,b", "designs-words"),
        ("a" * 9000, "designs-words"),
        ("0.35,0.85", "cut-lengths-are-fractions"),
        ("35,100", "cut-length-range"),
        ("-1,50", "cut-length-range"),
        ("nan,50", "cut-length-range"),
    ],
)
def test_designs_that_are_none(words: str, code: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_designs(words)
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("content", "code"),
    [
        ("a,b\n1,2\n", "column-missing"),
        ("a_percent,b_percent\n1,x\n", "cut-length-range"),
        ("a_percent,b_percent\n1,200\n", "cut-length-range"),
        ("a_percent,b_percent\n0.1,0.2\n", "cut-lengths-are-fractions"),
        ("a_percent,b_percent\n", "table-empty"),
    ],
)
def test_tables_of_designs_that_are_none(content: str, code: str, tmp_path: Path) -> None:
    table = tmp_path / "designs.csv"
    table.write_text(content)
    with pytest.raises(TableError) as caught:
        read_designs(str(table))
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("designs", "jobs", "code"),
    [
        ((), 1, "designs-once"),
        ((Design(1, 1), Design(1, 1)), 1, "designs-once"),
        ((Design(1, 1),), 0, "jobs-range"),
    ],
)
def test_no_campaign(designs: tuple[Design, ...], jobs: int, code: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError) as caught:
        run_campaign(SETTINGS, designs, tmp_path, jobs=jobs)
    assert caught.value.code == code


@pytest.mark.parametrize("edge", [0.0, -1.0, 6.0, float("nan")])
def test_mesh_edges_that_are_none(edge: float) -> None:
    with pytest.raises(UsageError) as caught:
        CampaignSettings.of("cell", None, edge)
    assert caught.value.code == "mesh-edge-range"
