"""Running, keeping, killing and going on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tolerances import CLOSED_FORM_AGAINST_REFIT

from kiribench.errors import UsageError
from kiribench.surrogate.registry import make
from kiribench.validation.cost import expected_seconds
from kiribench.validation.export import cv_object, finite, leakage
from kiribench.validation.fitting import Piece, is_gp, run_piece
from kiribench.validation.protocols import plan
from kiribench.validation.run import CvResult, cross_validate
from kiribench.validation.settings import DEFAULT_MODELS, CvSettings
from kiribench.validation.summary import TIMES
from kiribench.validation.table import CvTable

FAST = ("gp", "polynomial", "gradient_boosting:paper")
PROTOCOLS = ("grouped", "leave-level-a-out", "edge", "learning-curve", "shuffled")
SETTINGS = CvSettings(models=FAST, protocols=PROTOCOLS, folds=4, repeats=2)


def numbers(result: CvResult) -> dict[str, object]:
    """Everything but the times and how many folds were read from a former run."""

    def strip(record: object) -> object:
        if isinstance(record, dict):
            return {k: strip(v) for k, v in record.items() if k not in (*TIMES, "reused_folds")}
        if isinstance(record, list):
            return [strip(value) for value in record]
        return record

    return strip(finite(cv_object(result, (), None)))  # type: ignore[return-value]


@pytest.fixture(scope="module")
def whole(table: CvTable, tmp_path_factory: pytest.TempPathFactory) -> tuple[CvResult, Path]:
    folder = tmp_path_factory.mktemp("cv")
    return cross_validate(table, SETTINGS, folder=folder), folder


def test_every_fold_is_kept(whole: tuple[CvResult, Path]) -> None:
    result, folder = whole
    kept = list((folder / "folds").rglob("*.safetensors"))
    assert len(kept) == sum(len(result.planned.folds[p]) * len(FAST) for p in result.planned.folds)
    assert not list(folder.rglob("*.partial"))


def test_a_second_run_reads_all_and_fits_nothing(
    table: CvTable, whole: tuple[CvResult, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, folder = whole
    monkeypatch.setattr("kiribench.validation.run.run_piece", lambda piece: pytest.fail("fitted"))
    again = cross_validate(table, SETTINGS, folder=folder)
    assert again.reused == len(list((folder / "folds").rglob("*.safetensors")))
    # Nothing was timed anew, so the times are the same, too.
    assert finite(cv_object(again, (), None)) == finite(cv_object(first, (), None)) | {
        "reused_folds": again.reused
    }


def test_lost_and_damaged_folds_are_computed_again(
    table: CvTable, whole: tuple[CvResult, Path], tmp_path: Path
) -> None:
    import shutil

    first, folder = whole
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    kept = sorted((copy / "folds").rglob("*.safetensors"))
    for path in kept[::3]:
        path.unlink()
    kept[1].write_bytes(kept[1].read_bytes()[:-20])
    kept[2].write_bytes(b"")
    again = cross_validate(table, SETTINGS, folder=copy)
    assert again.reused == len(kept) - len(kept[::3]) - 2
    assert numbers(again) == numbers(first)


def test_another_table_or_setting_is_refused(table: CvTable, whole: tuple[CvResult, Path]) -> None:
    _, folder = whole
    with pytest.raises(UsageError, match=r"cv-out-of-another-run.*seed: 0 there, 1 now"):
        cross_validate(table, replace(SETTINGS, seed=1), folder=folder)
    changed = replace(table, y=table.y + 1e-15 * (table.y > 0.4))
    assert changed.sha256 != table.sha256
    with pytest.raises(UsageError, match=r"cv-out-of-another-run.*table"):
        cross_validate(changed, SETTINGS, folder=folder)


def test_a_folder_without_its_plan_is_refused(
    table: CvTable, whole: tuple[CvResult, Path], tmp_path: Path
) -> None:
    (tmp_path / "folds" / "grouped").mkdir(parents=True)
    with pytest.raises(UsageError, match="cv-out-of-another-run"):
        cross_validate(table, SETTINGS, folder=tmp_path)


CHILD = """
import sys
sys.path.insert(0, sys.argv[2])
from pathlib import Path
from validation.conftest import table_of
from kiribench.validation.run import cross_validate
from kiribench.validation.settings import CvSettings
protocols = ("grouped", "leave-level-a-out", "edge", "learning-curve", "shuffled")
settings = CvSettings(
    models=("gp", "polynomial", "gradient_boosting:paper"), protocols=protocols, folds=4, repeats=2
)
cross_validate(table_of(), settings, folder=Path(sys.argv[1]))
"""


def test_killed_and_restarted_it_ends_with_the_same_numbers(
    table: CvTable, whole: tuple[CvResult, Path], tmp_path: Path
) -> None:
    tests = str(Path(__file__).parents[1])
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path), tests])
    folds = tmp_path / "folds"
    deadline = time.monotonic() + 400
    while len(list(folds.rglob("*.safetensors"))) < 5 and time.monotonic() < deadline:
        assert child.poll() is None, "the run ended before it could be killed"
        time.sleep(0.005)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    done = len(list(folds.rglob("*.safetensors")))
    total = len(list((whole[1] / "folds").rglob("*.safetensors")))
    assert 5 <= done < total
    again = cross_validate(table, SETTINGS, folder=tmp_path)
    assert again.reused == done
    assert numbers(again) == numbers(whole[0])


def test_processes_do_not_change_the_numbers(table: CvTable, whole: tuple[CvResult, Path]) -> None:
    settings = replace(SETTINGS, protocols=("grouped", "leave-level-a-out"))
    parallel = numbers(cross_validate(table, settings, jobs=2))
    for name in settings.protocols:
        assert parallel["protocols"][name] == numbers(whole[0])["protocols"][name]  # type: ignore[index]


def test_a_dask_scheduler_does_the_same(table: CvTable, whole: tuple[CvResult, Path]) -> None:
    distributed = pytest.importorskip("distributed")
    settings = replace(SETTINGS, protocols=("edge", "leave-level-a-out"))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        found = numbers(cross_validate(table, settings, scheduler=cluster.scheduler_address))
    for name in settings.protocols:
        assert found["protocols"][name] == numbers(whole[0])["protocols"][name]  # type: ignore[index]


def test_a_scheduler_that_is_not_there(table: CvTable, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed")

    def refuse(*_: object, **__: object) -> None:
        raise OSError("timed out")

    monkeypatch.setattr(distributed, "Client", refuse)
    with pytest.raises(UsageError, match="scheduler-not-reached"):
        cross_validate(table, SETTINGS, scheduler="tcp://127.0.0.1:9")


def test_closed_form_equals_refits_at_the_same_hyperparameters(table: CvTable) -> None:
    folds = plan(table, CvSettings(protocols=("leave-level-a-out",))).folds["leave-level-a-out"]
    all_folds = {"leave-level-a-out": folds}
    piece = Piece("gp", all_folds, True, table.X, table.y, table.group, 0, "cpu")
    learnt = make("gp").fit(table.X, table.y).hyperparameters_  # type: ignore[attr-defined]
    for fold, outcome in zip(folds, run_piece(piece), strict=True):
        refit = make("gp", hyperparameters=learnt, optimise=False)
        refit.fit(table.X[fold.train], table.y[fold.train])
        mean, sd = refit.predict(table.X[fold.test], return_std=True)  # type: ignore[call-arg]
        assert outcome.mean == pytest.approx(mean, abs=CLOSED_FORM_AGAINST_REFIT)
        assert outcome.sd == pytest.approx(sd, abs=CLOSED_FORM_AGAINST_REFIT)


def test_refits_are_what_scikit_learn_does(table: CvTable) -> None:
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

    settings = CvSettings(models=("polynomial",), protocols=("leave-design-out",))
    one = cross_validate(table, settings).summaries["leave-design-out"]["polynomial"]
    theirs = cross_val_predict(
        make("polynomial"), table.X, table.y, groups=table.group, cv=LeaveOneGroupOut()
    )
    ours = np.empty(len(table.y))
    ours[one.rows] = one.mean
    assert ours == pytest.approx(theirs, abs=1e-12)


def test_shuffled_rows_flatter_a_forest(table: CvTable) -> None:
    settings = CvSettings(models=("random_forest",), protocols=("grouped", "shuffled"), folds=4)
    gap = leakage(cross_validate(table, settings))["random_forest"]
    assert gap["rmse_ratio"] > 1.5
    assert gap["r2_gap"] > 0


def test_a_model_that_fails_says_why_and_the_others_go_on(table: CvTable) -> None:
    spoilt = replace(table, X=np.column_stack([table.X[:, :2], table.X[:, 1]]))

    settings = CvSettings(models=("rbf", "polynomial"), protocols=("grouped",), folds=4, repeats=1)
    result = cross_validate(spoilt, settings)
    models, ranking = result.summaries["grouped"], result.rankings["grouped"]
    assert "LinAlgError" in next(iter(models["rbf"].failures.values()))
    # Scores of the folds that went well are no rank: the hard folds are missing.
    assert [place.model for place in ranking.places] == ["polynomial"]
    assert "no prediction in" in ranking.unranked["rbf"]
    assert models["polynomial"].scores["rmse"].pooled is not None


def test_a_slow_model_skips_a_long_protocol_and_says_so(table: CvTable) -> None:
    settings = CvSettings(
        models=("polynomial", "lightgbm"), budget_s=1e-6, protocols=("grouped", "edge"), folds=4
    )
    result = cross_validate(table, settings)
    assert "budget" in result.skipped["edge"]["polynomial"]
    assert len(result.summaries["grouped"]["polynomial"].fold_names) == 4  # one repeat of two


def test_the_default_budget_holds_for_the_papers_table(table: CvTable) -> None:
    """Every model does the headline on 441 x 25 rows; what is skipped is known."""
    rows = np.arange(11_025)
    from kiribench.validation.fold import Fold

    fold = Fold(0, 0, "", rows[:9_922], rows[9_922:])
    settings = CvSettings()
    for folds in (20, 21):  # the headline with its repeats, one level of a or b left out
        for name in DEFAULT_MODELS:
            one_fit = folds == 21 and is_gp(name)
            spent = expected_seconds(name, [fold] * folds, one_fit=one_fit)
            assert spent <= settings.budget_s, (name, folds)


def test_bad_settings(table: CvTable) -> None:
    for wrong, code in (
        ({"folds": 1}, "cv-setting-range"),
        ({"repeats": 0}, "cv-setting-range"),
        ({"models": ("oracle",)}, "model-unknown"),
        ({"models": ("gp:tuned",)}, "model-not-tunable"),
    ):
        with pytest.raises(UsageError, match=code):
            cross_validate(table, replace(SETTINGS, **wrong))
