"""``kiribench cv``: surrogates compared on designs that they have not seen."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_GATE_FAILED, EXIT_OK, Fault, UsageError

if TYPE_CHECKING:
    from kiribench.validation.checks.check import Wanted
    from kiribench.validation.run import CvResult
    from kiribench.validation.table import CvTable

LARGER_IS_BETTER = ("r2", "coverage50", "coverage80", "coverage95")


def cv(
    table: Path,
    /,
    *,
    models: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())] = (),
    protocols: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())] = (),
    folds: int = 10,
    repeats: int = 2,
    seed: int = 0,
    jobs: int = 1,
    scheduler: str | None = None,
    device: Literal["cpu", "cuda"] = "cpu",
    budget: float = 45.0,
    strain_measure: str | None = None,
    features: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())] = (),
    target: str | None = None,
    group_column: str | None = None,
    fold_column: str | None = None,
    targets: Path | None = None,
    fail_under: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    common: Common | None = None,
) -> Outcome:
    """Compare surrogates by cross-validation: honest folds, calibration, significance, checks.

    TABLE is a design space (a_percent, b_percent and stretches, or longitudinal_strain with
    poisson_ratio in a declared measure), or with --features and --target any table of
    numbers. The headline is grouped by design: a design is never on both sides. With --out,
    each fold is kept at once in DIR/folds, and a killed run goes on where it was; cv.json and
    cv.html follow at the end.

    Parameters
    ----------
    table
        CSV, TSV or Parquet.
    models
        Names of models, separated by spaces or commas; NAME:tuned tunes inside each training
        set. By default the paper's four, six competitors and three readings of the paper.
    protocols
        Names of protocols; all that apply if absent.
    folds
        Folds of the grouped, shuffled and contiguous protocols.
    repeats
        Repeats of the grouped protocol with other divisions.
    seed
        Seed of the divisions and of the models.
    jobs
        Processes of this machine; -1 takes every core. The numbers do not depend on it.
    scheduler
        Address of a dask scheduler that does the work instead.
    device
        Where models on torch compute.
    budget
        A model skips a protocol expected to cost more CPU seconds than this, and says so;
        under the headline it then does one repeat. 0 skips nothing.
    strain_measure
        log, engineering or green: for stretches the measure to compute (log by default), for
        strains the measure that they are in, unless the table's sidecar says it.
    features
        Input columns of a table that is no design space.
    target
        Its target column.
    group_column
        Rows with the same value belong together; by default a design's rows.
    fold_column
        Folds of your own, as a further protocol (own-folds).
    targets
        Table of the strains and Poisson's ratios that the surrogate is wanted for
        (longitudinal_strain, poisson_ratio; kiribench measure writes one): check KB007.
    fail_under
        [MODEL.]METRIC=VALUE: exit with code 1 where the pooled score of the model (by default
        the best one) under the headline is worse than VALUE: r2=0.99, gp.rmse=0.01. May be
        given several times.
    common
        Options of every command.
    """
    from kiribench.cli.progress import progress
    from kiribench.validation.checks import run_checks
    from kiribench.validation.checks.check import Evidence
    from kiribench.validation.export import cv_object, cv_text, finite
    from kiribench.validation.protocols import HEADLINE
    from kiribench.validation.run import cross_validate
    from kiribench.validation.settings import DEFAULT_MODELS, CvSettings
    from kiribench.validation.table1 import against_table_one

    common = common or Common()
    limits = [_limit(text) for text in fail_under]
    settings = CvSettings(
        models=_split(models) or DEFAULT_MODELS,
        protocols=_split(protocols),
        folds=folds,
        repeats=repeats,
        seed=seed,
        device=device,
        budget_s=budget,
    )
    if jobs == 0 or jobs < -1:
        raise UsageError(
            "jobs-range", "--jobs is no number of processes.", remedy="Give 1 or more, or -1."
        )
    read = _read(table, _split(features), target, strain_measure, group_column, fold_column)
    wanted = None if targets is None else _wanted(targets)
    with progress("cross-validating", quiet=common.quiet) as show:
        result = cross_validate(
            read, settings, folder=common.out, jobs=jobs, scheduler=scheduler, progress=show
        )
    evidence = Evidence(
        table=read,
        folds=result.planned.folds,
        summaries=result.summaries,
        ranking=result.rankings.get(HEADLINE),
        wanted=wanted,
    )
    checks = run_checks(evidence)
    table_one = against_table_one(result.summaries) if read.is_design_space else None
    record = finite(cv_object(result, checks, table_one))
    failed = _gate(result, limits)
    record["fail_under"] = list(fail_under)
    record["passed"] = not failed
    if common.out is not None:
        from kiribench.report.cv_page import write_cv_report

        write_cv_report(common.out / "cv.html", result, checks, table_one)
    warnings = tuple(
        Fault(
            f"check-{one.check.code.lower()}",
            f"{one.check.title}: {one.found.detail}",
            f"{one.check.remedy} See {one.check.page}.",
            severity="warning",
        )
        for one in checks
        if one.found.status == "fired" and one.severity != "note"
    )
    text = cv_text(result, checks, table_one)
    return Outcome(
        result=record,
        text="\n".join([text, *(fault.what for fault in failed)]),
        exit_code=EXIT_GATE_FAILED if failed else EXIT_OK,
        faults=(*warnings, *failed),
        inputs=(*read.files, *([targets] if targets is not None else [])),
    )


def _split(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(part.strip() for name in names for part in name.split(",") if part.strip())


def _read(
    path: Path,
    features: tuple[str, ...],
    target: str | None,
    measure: str | None,
    group_column: str | None,
    fold_column: str | None,
) -> CvTable:
    from kiribench.schema.design_space import read_design_space
    from kiribench.validation.table import (
        column_of_space,
        grouped_by,
        of_design_space,
        read_regression_table,
    )

    if bool(features) != (target is not None):
        raise UsageError(
            "features-without-target",
            "--features and --target belong together.",
            remedy="Give both, or neither for a design space.",
        )
    if target is not None:
        return read_regression_table(
            path, features, target, group_column=group_column, fold_column=fold_column
        )
    space = read_design_space(path, measure=measure)
    own_fold = None if fold_column is None else column_of_space(space, fold_column)
    table = of_design_space(space, own_fold)
    return (
        table if group_column is None else grouped_by(table, column_of_space(space, group_column))
    )


def _wanted(path: Path) -> Wanted:
    import numpy as np
    import pandas as pd

    from kiribench.errors import TableError
    from kiribench.schema.design_space import read_frame, read_sidecar
    from kiribench.validation.checks.check import Wanted

    frame = read_frame(path)
    columns = ["longitudinal_strain", "poisson_ratio"]
    absent = [name for name in columns if name not in frame.columns]
    if absent:
        raise TableError(
            "column-missing",
            "The targets have no such column.",
            remedy="Give longitudinal_strain and poisson_ratio.",
            file=path,
            column=absent[0],
        )
    strain, poisson = (
        pd.to_numeric(frame[name], errors="coerce").to_numpy(dtype=np.float64) for name in columns
    )
    known = np.isfinite(strain) & np.isfinite(poisson)
    if not known.any():
        raise TableError(
            "targets-empty",
            "No row has both a strain and a Poisson's ratio.",
            remedy="Give at least one complete row.",
            file=path,
        )
    declared = read_sidecar(path).get("StrainMeasure")
    if "strain_measure" in frame.columns:
        named = sorted({str(value) for value in frame["strain_measure"].dropna()})
        declared = named[0] if len(named) == 1 else declared
    measure = None if declared is None else str(declared).strip().lower()
    return Wanted(strain[known], poisson[known], measure, path.name)


def _limit(text: str) -> tuple[str | None, str, float]:
    """Model (or None), score and value of a limit."""
    from kiribench.validation.summary import SCORES

    left, found, right = text.partition("=")
    model, _, metric = left.strip().rpartition(".")
    try:
        value = float(right)
    except ValueError:
        found = ""
        value = 0.0
    if not found or metric not in SCORES:
        raise UsageError(
            "fail-under-no-limit",
            "--fail-under is no [MODEL.]METRIC=VALUE.",
            remedy="Give for example r2=0.99, rmse=0.01 or gp.coverage95=0.93.",
            got=text,
            expected=", ".join(SCORES),
        )
    return model or None, metric, value


def _gate(result: CvResult, limits: list[tuple[str | None, str, float]]) -> list[Fault]:
    from kiribench.validation.protocols import HEADLINE

    failed: list[Fault] = []
    models = result.summaries.get(HEADLINE, {})
    ranking = result.rankings.get(HEADLINE)
    for model, metric, limit in limits:
        name = model or (ranking.best if ranking is not None else None)
        if name is None or name not in models:
            raise UsageError(
                "fail-under-no-score",
                "The model of --fail-under has no score under the grouped protocol.",
                remedy="Name a model that takes part, and run the grouped protocol.",
                got=name or "no ranked model",
            )
        score: Any = models[name].scores[metric].pooled
        larger = metric in LARGER_IS_BETTER or metric == "train_r2"
        good = score is not None and (score >= limit if larger else score <= limit)
        if not good:
            failed.append(
                Fault(
                    "cv-below-limit",
                    f"{name}: {metric} under the grouped protocol is worse than the limit.",
                    "Look at the folds and the checks of the report.",
                    got="no score" if score is None else f"{score:.6g}",
                    expected=f"{limit:g} or {'more' if larger else 'less'}",
                )
            )
    return failed
