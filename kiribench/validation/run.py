"""The whole cross-validation: plan, pieces in parallel, kept as they come, summarised."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from kiribench import __version__
from kiribench.errors import UsageError
from kiribench.processes import in_processes
from kiribench.surrogate.registry import spec
from kiribench.validation.cost import ROWS, cost_of, expected_seconds
from kiribench.validation.fitting import Piece, chunked, is_gp, run_piece
from kiribench.validation.fold import Fold
from kiribench.validation.outcome import FoldOutcome
from kiribench.validation.protocols import HEADLINE, Planned, plan, protocol
from kiribench.validation.ranking import Ranking, rank
from kiribench.validation.settings import CvSettings
from kiribench.validation.store import Store
from kiribench.validation.summary import Summary, summarise
from kiribench.validation.table import CvTable
from kiribench.validation.tuning import VARIANT, grid_of

LEAST_PIECE_S = 1.0
COMPARED = (HEADLINE, "own-folds")
LIBRARIES = ("numpy", "scipy", "scikit-learn", "torch", "gpytorch", "lightgbm")
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class CvResult:
    """All that a cross-validation gave.

    Attributes:
        table, settings: what it was done on and how.
        planned: the folds.
        summaries: by protocol, then by model.
        skipped: by protocol, then by model: why the model took no part.
        rankings: by protocol, where models are compared.
        reused: number of folds that were read from a former run.
    """

    table: CvTable
    settings: CvSettings
    planned: Planned
    summaries: dict[str, dict[str, Summary]]
    skipped: dict[str, dict[str, str]]
    rankings: dict[str, Ranking]
    reused: int


def cross_validate(
    table: CvTable,
    settings: CvSettings,
    *,
    folder: Path | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> CvResult:
    """Fit and score every model under every protocol.

    Args:
        table: the rows.
        settings: models, protocols, folds.
        folder: keeps each fold's outcome at once; a former run of the same table and
            settings is gone on with. Without it nothing is kept.
        jobs: processes of this machine, -1 for all cores; each works with one thread.
        scheduler: address of a dask scheduler that does the work instead.
        progress: called with the folds done and the folds in all.

    Raises:
        UsageError: a setting, a model or a protocol is wrong, or ``folder`` holds another run.
    """
    settings.check()
    models, absent = _models(settings)
    planned = plan(table, settings)
    if folder is None:
        with tempfile.TemporaryDirectory(prefix="kiribench-cv-") as temporary:
            store = Store(Path(temporary), plan_object(table, settings))
            return _run(table, settings, planned, models, absent, store, jobs, scheduler, progress)
    store = Store(folder, plan_object(table, settings))
    return _run(table, settings, planned, models, absent, store, jobs, scheduler, progress)


def plan_object(table: CvTable, settings: CvSettings) -> dict[str, Any]:
    """Everything that the numbers depend on; where it differs a run cannot be gone on with."""
    record = {
        "table": table.sha256,
        "rows": len(table.y),
        **settings.as_dict(),
        "kiribench": __version__,
    }
    for name in LIBRARIES:
        try:
            record[f"version of {name}"] = version(name)
        except PackageNotFoundError:
            record[f"version of {name}"] = None
    return record


def _models(settings: CvSettings) -> tuple[tuple[str, ...], dict[str, str]]:
    """The models that can run here, and why others cannot."""
    usable: list[str] = []
    absent: dict[str, str] = {}
    for name in dict.fromkeys(settings.models):
        plain, _, variant = name.partition(":")
        entry = spec(plain if variant == VARIANT else name)
        if variant == VARIANT:
            grid_of(plain)
        if entry.available:
            usable.append(name)
        else:
            absent[name] = f"needs the package {entry.extra}, which is not installed"
    if not usable:
        raise UsageError(
            "cv-no-model",
            "No model can run.",
            remedy="Name at least one model whose packages are installed.",
            got=", ".join(absent) or "no model",
        )
    return tuple(usable), absent


def _run(
    table: CvTable,
    settings: CvSettings,
    planned: Planned,
    models: tuple[str, ...],
    absent: dict[str, str],
    store: Store,
    jobs: int,
    scheduler: str | None,
    progress: Progress | None,
) -> CvResult:
    taking_part, skipped = _taking_part(planned, models, absent, settings)
    missing: dict[tuple[str, str], tuple[Fold, ...]] = {}
    outcomes: dict[tuple[str, str, str], FoldOutcome] = {}
    for (name, model), folds in taking_part.items():
        left: list[Fold] = []
        for fold in folds:
            kept = store.read(name, model, fold.name, len(fold.test))
            if kept is None:
                left.append(fold)
            else:
                outcomes[name, model, fold.name] = kept
        if left:
            missing[name, model] = tuple(left)
    reused, total = len(outcomes), sum(map(len, taking_part.values()))
    pieces = _pieces(table, settings, missing)
    if progress is not None:
        progress(len(outcomes), total)
    with closing(_work(pieces, jobs, scheduler)) as work:
        for done in work:
            for outcome in done:
                store.write(outcome)
                outcomes[outcome.protocol, outcome.model, outcome.fold] = outcome
            if progress is not None:
                progress(len(outcomes), total)
    summaries: dict[str, dict[str, Summary]] = {name: {} for name in planned.folds}
    for (name, model), folds in taking_part.items():
        listed = [outcomes[name, model, fold.name] for fold in folds]
        summaries[name][model] = summarise(table, folds, listed)
    rankings = {
        name: rank(table, planned.folds[name], summaries[name])
        for name in COMPARED
        if summaries.get(name)
    }
    return CvResult(table, settings, planned, summaries, skipped, rankings, reused)


def _taking_part(
    planned: Planned,
    models: tuple[str, ...],
    absent: dict[str, str],
    settings: CvSettings,
) -> tuple[dict[tuple[str, str], tuple[Fold, ...]], dict[str, dict[str, str]]]:
    """The folds of each protocol and model, and why a model skips a protocol.

    Under the headline protocol every model does at least the first repeat.
    """
    part: dict[tuple[str, str], tuple[Fold, ...]] = {}
    skipped: dict[str, dict[str, str]] = {name: dict(absent) for name in planned.folds}
    for name, folds in planned.folds.items():
        for model in models:
            one_fit = protocol(name).closed_form and is_gp(model)
            wanted = folds
            seconds = expected_seconds(model, wanted, one_fit=one_fit)
            over = settings.budget_s > 0 and seconds > settings.budget_s
            if over and name == HEADLINE:
                wanted = tuple(fold for fold in folds if fold.repeat == 0)
            elif over:
                skipped[name][model] = (
                    f"would cost about {seconds:.0f} CPU s in {len(wanted)} fits, "
                    f"more than the budget of {settings.budget_s:g} s"
                )
                continue
            part[name, model] = wanted
    return part, skipped


def _pieces(
    table: CvTable, settings: CvSettings, missing: dict[tuple[str, str], tuple[Fold, ...]]
) -> list[Piece]:
    """The work that is left, the longest first: no core waits at the end.

    Args:
        table, settings: of the run.
        missing: folds without an outcome, by protocol and model.
    """
    shared: dict[str, dict[str, tuple[Fold, ...]]] = {}
    parts: list[tuple[str, dict[str, tuple[Fold, ...]], bool]] = []
    for (name, model), folds in missing.items():
        if protocol(name).closed_form and is_gp(model):
            shared.setdefault(model, {})[name] = folds
        else:
            each_s = cost_of(model).seconds * len(table.y) / ROWS
            parts += [
                (model, {name: some}, False) for some in chunked(folds, each_s, LEAST_PIECE_S)
            ]
    parts += [(model, folds, True) for model, folds in shared.items()]
    pieces = [
        Piece(
            model=model,
            folds=folds,
            closed_form=closed,
            X=table.X,
            y=table.y,
            group=table.group,
            seed=settings.seed,
            device=settings.device,
        )
        for model, folds, closed in parts
    ]

    def seconds(piece: Piece) -> float:
        each = piece.folds.values()
        return sum(expected_seconds(piece.model, some, one_fit=piece.closed_form) for some in each)

    return sorted(pieces, key=lambda piece: -seconds(piece))


def _work(
    pieces: list[Piece], jobs: int, scheduler: str | None
) -> Generator[list[FoldOutcome], None, None]:
    """The outcomes of the pieces, in the order in which they are done."""
    if not pieces:
        return
    if scheduler is None and jobs == 1:
        for piece in pieces:
            yield run_piece(piece)
        return
    if scheduler is None:
        yield from in_processes(run_piece, pieces, jobs)
        return
    from joblib import Parallel, delayed

    with _cluster(scheduler):
        yield from Parallel(return_as="generator_unordered", n_jobs=-1, batch_size=1)(
            delayed(run_piece)(piece) for piece in pieces
        )


@contextmanager
def _cluster(scheduler: str) -> Iterator[None]:
    from joblib import parallel_config

    try:
        from distributed import Client
    except ImportError as error:
        raise UsageError(
            "scheduler-not-installed",
            "A dask scheduler needs the package distributed, which is not installed.",
            remedy='Install it with: pip install "kiribench[cluster]", or use --jobs.',
            got=scheduler,
        ) from error
    try:
        client = Client(scheduler, timeout="10s")
    except (OSError, ValueError) as error:
        raise UsageError(
            "scheduler-not-reached",
            f"The dask scheduler cannot be reached ({error}).",
            remedy="Check the address (tcp://host:8786) and that the scheduler runs.",
            got=scheduler,
        ) from error
    with client, parallel_config(backend="dask"):
        yield
