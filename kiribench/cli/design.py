"""``kiribench design``: from the strain of the skin to the cuts of a patch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from kiribench.cli.command import Common, Outcome
from kiribench.errors import Fault, UsageError

if TYPE_CHECKING:
    from kiribench.design.limits import Limits
    from kiribench.design.options import DesignOptions
    from kiribench.design.problem import DesignProblem
    from kiribench.design.result import Designed
    from kiribench.design.surrogates import Surrogates

SCHEMA = "kiribench.design/1"


def design(
    targets: Path,
    /,
    *,
    surrogate: Path,
    method: Literal["paper", "exact", "balanced", "uniform", "worn", "robust"] = "exact",
    start: Literal["balanced", "exact", "paper", "uniform"] | None = None,
    participant: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    strain_measure: Literal["log", "engineering", "green"] | None = None,
    convert_measure: Annotated[bool, Parameter(negative=())] = False,
    cell_mm: float | None = None,
    ligament_mm: float = 0.5,
    kerf_mm: float = 0.2,
    longest_percent: float = 90.0,
    tolerance: float = 0.005,
    penalty: float | None = None,
    prefer: Literal["least-cuts", "insensitive"] = "least-cuts",
    cut_error_percent: float = 1.0,
    kerf_error_mm: float = 0.05,
    poisson_sd: float = 0.01,
    force_sd: float = 0.05,
    neighbour_sd: float = 0.5,
    seed: int = 0,
    generations: int = 200,
    population: int | None = None,
    min_strain: float = 0.03,
    denoise: Literal["auto", "always", "never"] = "auto",
    figures: bool = True,
    common: Common | None = None,
) -> Outcome:
    """Design the cuts of a patch so that it stretches as the skin does.

    TARGETS is a table of kiribench measure, a table with row, col, longitudinal_strain and
    poisson_ratio, or a dataset whose bare scans are measured here. With --out, writes
    sub-ID_design.tsv with its JSON for kiribench export and kiribench check, and design.html
    with the figures (of several participants in folders sub-ID, without an id in patch). A cell
    that cannot meet its target gets the nearest cuts that there are, and says why; limits hold
    in every cell and every method.

    Parameters
    ----------
    targets
        Table of targets (TSV, CSV or Parquet) or folder of a dataset.
    surrogate
        Model file of kiribench fit, a Gaussian process (gp_kronecker or gp).
    method
        paper: the paper's objective by CMA-ES. exact: the least cuts within the tolerance of
        each target. balanced: also equal force of cells in series and smooth neighbours; needs
        a surrogate with the nominal stress. uniform: the best single pair, the control. worn:
        the corners of the patch as worn, simulated on the subject's flexed skin, put on their
        nodes; robust: the same over errors of placement; both need a dataset.
    start
        Of worn and robust: the method to start from; balanced where the surrogate knows the
        stress, else exact.
    participant
        With a dataset: id of a participant; may be given several times. All if absent.
    strain_measure
        The measure that the table's strains are in, where neither the table nor its JSON says
        it. With a dataset, and for a table of stretches alone, it is the surrogate's.
    convert_measure
        Recompute targets that are in another measure than the surrogate from their stretches.
    cell_mm
        Cell edge of a table that does not say it; 15 by default.
    ligament_mm
        Least width of the sheet between two cuts.
    kerf_mm
        Width that the laser burns away.
    longest_percent
        Longest cut, percent of the cell edge.
    tolerance
        Of Poisson's ratio: exact takes the least cuts within it, and a cell that misses its
        target by more carries a reason.
    penalty
        Lambda of the paper's objective, with a and b as fractions of the cell edge: 0.001 for
        paper. With exact: minimise that objective instead of holding the tolerance.
    prefer
        With exact, of all equivalent designs: the one with the least cuts, or the one that
        cutting errors change least.
    cut_error_percent
        Standard deviation of a cut length, percent of the cell edge.
    kerf_error_mm
        Standard deviation of the kerf, which lengthens all cuts alike.
    poisson_sd
        With balanced: Poisson's ratio may miss its target by about this.
    force_sd
        With balanced: forces of cells in series may differ by about this fraction.
    neighbour_sd
        With balanced: cut lengths of neighbours may differ by about this fraction of the edge.
    seed
        Of CMA-ES.
    generations
        Of CMA-ES, at most.
    population
        Of CMA-ES; the library's 6 by default.
    min_strain
        With a dataset: Poisson's ratio is masked below this longitudinal strain.
    denoise
        With a dataset: denoise the scans where needed, always or never.
    figures
        Write design.html; --no-figures leaves it out.
    """
    from kiribench.design.limits import Limits
    from kiribench.design.methods import design_patch
    from kiribench.design.options import DesignOptions
    from kiribench.design.summary import design_object, design_text
    from kiribench.design.surrogates import Surrogates
    from kiribench.schema.patch_design import write_design

    common = common or Common()
    limits = Limits(ligament_mm, kerf_mm, longest_percent)
    options = DesignOptions(
        tolerance=tolerance,
        penalty=penalty,
        prefer=prefer,
        cut_error=cut_error_percent / 100,
        kerf_error_mm=kerf_error_mm,
        poisson_sd=poisson_sd,
        force_sd=force_sd,
        neighbour_sd=neighbour_sd,
        seed=seed,
        population=population,
        max_generations=generations,
        curves=figures and common.out is not None,
    )
    models = Surrogates.of(surrogate)
    problems = _problems(
        targets,
        models,
        participant=participant,
        strain_measure=strain_measure,
        convert=convert_measure,
        cell_mm=cell_mm,
        min_strain=min_strain,
        denoise=denoise,
        quiet=common.quiet,
    )
    if method == "worn" or method == "robust":
        results = _on_skin(
            method, targets, problems, models, limits, options, start, denoise, quiet=common.quiet
        )
    else:
        results = [design_patch(method, problem, models, limits, options) for problem in problems]
    if targets.is_dir():
        results = [_from(_dataset(targets), result) for result in results]
    text = "\n\n".join(design_text(result) for result in results)
    files: list[str] = []
    if common.out is not None:
        for result in results:
            # Without an id the table is design.tsv, and DIR/design.json is this command's own.
            part = f"sub-{result.design.participant}" if len(results) > 1 else ""
            part = part if result.design.participant else "patch"
            files.append(str(write_design(common.out / part, result.design)))
            if figures:
                from kiribench.report.design_page import write_design_report

                page = write_design_report(common.out / part / "design.html", result, models)
                files.append(str(page))
        text += "\nFiles: " + ", ".join(files)
    return Outcome(
        result={
            "schema": SCHEMA,
            "patches": [design_object(result) for result in results],
            "files": files,
        },
        text=text,
        faults=_warnings(problems),
        inputs=(surrogate, *(path for problem in problems for path in problem.files)),
    )


def _dataset(targets: Path) -> Path:
    """The dataset: a subject's own folder stands for it."""
    return targets.parent if targets.name.startswith("sub-") else targets


def _from(dataset: Path, result: Designed) -> Designed:
    """The sidecar names the dataset, so that ``check`` finds the subject."""
    from dataclasses import replace

    settings = {**result.design.settings, "Dataset": dataset.as_posix()}
    return replace(result, design=replace(result.design, settings=settings))


def _on_skin(
    method: str,
    targets: Path,
    problems: list[DesignProblem],
    models: Surrogates,
    limits: Limits,
    options: DesignOptions,
    start: str | None,
    denoise: Any,
    *,
    quiet: bool,
) -> list[Designed]:
    """The methods that wear the patch on the subject's flexed skin."""
    from functools import partial

    from kiribench.cli.progress import progress
    from kiribench.conformability.result import GOOD_FROM
    from kiribench.dataset import Dataset
    from kiribench.design.on_skin import design_on_skin
    from kiribench.design.skin import skin_of
    from kiribench.reference.fast_overlap import FastOverlap

    if not targets.is_dir():
        raise UsageError(
            "design-needs-skin",
            "This method wears the patch on the subject's skin, which a table does not hold.",
            remedy="Give the dataset's folder instead of the table.",
            file=targets,
        )
    results = []
    for problem in problems:
        skin = skin_of(
            Dataset.open(_dataset(targets)).subject(problem.participant), denoise=denoise
        )
        overlap = partial(FastOverlap.of(skin).overlap, definition="paper")
        with progress(f"wearing {problem.participant}", quiet=quiet) as advance:
            results.append(
                design_on_skin(
                    method, problem, models, skin, limits, options,
                    start=start, overlap=overlap, good_from=GOOD_FROM, progress=advance,
                )
            )  # fmt: skip
    return results


def _problems(
    targets: Path,
    models: Surrogates,
    *,
    participant: tuple[str, ...],
    strain_measure: str | None,
    convert: bool,
    cell_mm: float | None,
    min_strain: float,
    denoise: Any,
    quiet: bool,
) -> list[DesignProblem]:
    """The targets, in the surrogate's measure or refused."""
    from kiribench.design.problem import problem_from_table

    if targets.is_dir():
        return _measured(
            targets, models, participant, strain_measure, min_strain, denoise, quiet=quiet
        )
    if participant:
        raise UsageError(
            "participant-without-dataset",
            "A table holds one patch, so there is no participant to choose.",
            remedy="Leave --participant out, or give the dataset's folder.",
            file=targets,
        )
    problem = problem_from_table(targets, strain_measure=strain_measure, cell_mm=cell_mm)
    if strain_measure is None and not problem.measured_strain:
        return [problem.in_measure(models.measure)]
    if convert:
        problem = problem.in_measure(models.measure)
    models.check_measure(problem)
    return [problem]


def _measured(
    folder: Path,
    models: Surrogates,
    participant: tuple[str, ...],
    strain_measure: str | None,
    min_strain: float,
    denoise: Any,
    *,
    quiet: bool,
) -> list[DesignProblem]:
    from kiribench.cli.participants import chosen, each
    from kiribench.dataset import Dataset
    from kiribench.design.problem import problem_from_subject

    measure: Any = strain_measure or models.measure
    if measure != models.measure:
        raise UsageError(
            "strain-measure-mixed",
            "The scans would be measured in another strain measure than the surrogate.",
            remedy="Leave --strain-measure out, or fit the surrogate in that measure.",
            got=measure,
            expected=models.measure,
        )
    # A subject's own folder stands for the dataset and the participant.
    if folder.name.startswith("sub-") and not participant:
        participant = (folder.name,)
    folder = _dataset(folder)
    dataset = Dataset.open(folder)
    return each(
        chosen(dataset, participant),
        lambda subject: problem_from_subject(
            subject, strain_measure=measure, min_strain=min_strain, denoise=denoise
        ),
        "measuring",
        quiet=quiet,
    )


def _warnings(problems: list[DesignProblem]) -> tuple[Fault, ...]:
    return tuple(
        Fault(
            "targets-missing",
            f"{int((~problem.wanted).sum())} of {problem.wanted.size} cells have no target.",
            "Their cuts are filled in from their neighbours; see the column reason.",
            file=str(problem.files[0]) if problem.files else None,
            severity="warning",
        )
        for problem in problems
        if not problem.wanted.all()
    )
