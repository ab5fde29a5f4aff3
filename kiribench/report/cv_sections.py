"""The sections of the cross-validation report; each shows what its words claim."""

from __future__ import annotations

import re

import numpy as np

from kiribench.report.figures.cv_calibration import calibration_figure
from kiribench.report.figures.cv_learning import learning_figure
from kiribench.report.figures.cv_parity import ParityPanel, parity_figure
from kiribench.report.figures.cv_residuals import residual_figure
from kiribench.report.figures.cv_style import marks_of
from kiribench.report.figures.cv_time import time_figure
from kiribench.report.html import Html, bullets, paragraphs, table, tag
from kiribench.report.svg import figure_block
from kiribench.validation.checks import CheckResult
from kiribench.validation.export import leakage, model_info
from kiribench.validation.protocols import HEADLINE, protocol, said_of
from kiribench.validation.ranking import Place
from kiribench.validation.run import CvResult
from kiribench.validation.summary import Score, Summary
from kiribench.validation.table1 import PAPER_R2, STAND_INS, TableOne

ABSENT = "–"
LEAST_P = 0.001  # smaller ones are told as smaller


def shown(value: float | None, form: str = ".4g") -> str:
    """A number for a table, or a dash."""
    return ABSENT if value is None else format(value, form).replace("-", "−")


def headline(result: CvResult) -> dict[str, Summary]:
    """Models under the headline protocol, best first; those without predictions last."""
    models = result.summaries.get(HEADLINE, {})
    ranking = result.rankings.get(HEADLINE)
    order = [place.model for place in ranking.places] if ranking is not None else []
    return {name: models[name] for name in [*order, *(m for m in models if m not in order)]}


def ranking_section(result: CvResult) -> Html | None:
    """The headline's scores with the comparison with the best."""
    ranking = result.rankings.get(HEADLINE)
    if ranking is None or not ranking.places:
        return None
    words = {place.model: place for place in ranking.places}
    gaps = leakage(result)
    rows = []
    for name, one in headline(result).items():
        place = words.get(name)
        s = one.scores
        rows.append(
            (
                name,
                shown(s["r2"].pooled, ".5f"),
                _mean_and_sd(s["rmse"], ".3g"),
                shown(s["rmse_over_mesh_error"].pooled, ".2f"),
                shown(s["max_error"].pooled, ".3g"),
                shown(s["crps"].pooled, ".3g"),
                shown(s["nlpd"].pooled, ".2f"),
                shown(
                    None if s["coverage95"].pooled is None else 100 * s["coverage95"].pooled, ".1f"
                ),
                shown(gaps[name]["rmse_ratio"], ".2f") if name in gaps else ABSENT,
                ranking.unranked.get(name, "") if place is None else _against(place, ranking.best),
            )
        )
    return tag(
        "section",
        tag("h2", f"Ranking: new {result.table.group_word}s"),
        table(
            ("Model", "R2", "RMSE, mean ± sd", "/ mesh error", "Max error", "CRPS", "NLPD",
             "95 % covers, %", "RMSE / shuffled", "Against the best"),
            rows,
            caption=f"Grouped folds, refitted; {ranking.folds} folds that all models have. p: "
            "corrected resampled t-test (Nadeau and Bengio 2003), Holm-adjusted; P(equal): "
            f"probability that the RMSE differs by less than {ranking.rope:.2g}. RMSE / shuffled: "
            f"how much the error of new {result.table.group_word}s exceeds that of shuffled rows.",
            numeric=(1, 2, 3, 4, 5, 6, 7, 8),
        ),
        id="ranking",
    )  # fmt: skip


def _against(place: Place, best: str | None) -> str:
    words = place.words.removesuffix(f" than {best}")
    if place.comparison is None:
        return words
    small = place.p_adjusted is not None and place.p_adjusted < LEAST_P
    said = f"{words}, p " + (f"< {LEAST_P:g}" if small else shown(place.p_adjusted, ".2g"))
    if small:
        return said
    return f"{said}, P(equal) {shown(place.comparison.p_equivalent, '.2g')}"


def table_one_section(result: CvResult, found: TableOne | None) -> Html | None:
    """Table 1 of the paper beside ours under every protocol, and the statement."""
    if found is None or not found.matches:
        return None
    # R2 within one design divides by next to nothing.
    every = dict.fromkeys(one.protocol for one in found.matches)
    names = [name for name in every if name != "leave-design-out"]
    ours = {(one.model, one.protocol): one.r2 for one in found.matches}
    rows = []
    for row, models in STAND_INS.items():
        for model in models:
            if not any((model, name) in ours for name in names):
                continue
            rows.append(
                (
                    model,
                    f"{row} {PAPER_R2[row]:.4f}",
                    *(_r2(ours.get((model, name))) for name in names),
                )
            )
    return tag(
        "section",
        tag("h2", "Table 1 of the paper beside ours"),
        table(
            ("Ours", "Paper", *(protocol(name).title for name in names)),
            rows,
            caption="R2, mean over the folds as in the paper. Names with a colon are readings or "
            "guesses of settings that the paper does not give. Leaving single designs out is not "
            "here: R2 within one design divides by next to nothing.",
            numeric=tuple(range(2, 2 + len(names))),
        ),
        paragraphs([re.sub(r"(?<![\w:])-(?=\d)", "−", words) for words in found.sentences]),
        tag("p", "Guessed:"),
        bullets([
            f"{name}: {model_info(name)['guessed']}"
            for name in result.settings.models if model_info(name)["guessed"]
        ]),
        id="table1",
    )  # fmt: skip


def _r2(value: float | None) -> str:
    """Four digits as in the paper; far below nought nobody needs them."""
    return shown(value, ".4f" if value is None or value > -1.0 else ".1f")


def protocols_section(result: CvResult) -> Html:
    """Every protocol: its question, and RMSE and R2 of every model."""
    blocks: list[object] = []
    for name, models in result.summaries.items():
        row = protocol(name)
        blocks.append(tag("h3", said_of(result.table, row.title)))
        folds = len(result.planned.folds[name])
        said = f"{row.question} {folds} fold{'s' if folds != 1 else ''}."
        blocks.append(
            tag(
                "p",
                said_of(result.table, said)
                + (" Rows of one group may be on both sides: no headline." if row.leaky else ""),
            )
        )
        blocks.append(
            table(
                ("Model", "R2 pooled", "R2 mean ± sd", "RMSE pooled", "RMSE mean ± sd",
                 "Max error", "95 % covers, %", "Fit s", "How"),
                [_protocol_row(model, one) for model, one in models.items()],
                caption="Pooled: all test rows together; mean ± sd: over the folds; fit: one fold.",
                numeric=(1, 2, 3, 4, 5, 6, 7),
            )
        )  # fmt: skip
        skipped = result.skipped[name]
        if skipped:
            blocks.append(bullets([f"{model} skipped: {why}" for model, why in skipped.items()]))
    for name, reason in result.planned.left_out.items():
        blocks.append(tag("p", f"{protocol(name).title}: left out, {reason}."))
    return tag("section", tag("h2", "Every protocol"), blocks, id="protocols")


def _protocol_row(model: str, one: Summary) -> tuple[object, ...]:
    s = one.scores
    how = "closed form" if one.closed_form else "refits"
    if one.failures:
        how += f"; failed in {len(one.failures)}: {next(iter(one.failures.values()))}"
    coverage = s["coverage95"].pooled
    return (
        model,
        shown(s["r2"].pooled, ".5f"),
        _mean_and_sd(s["r2"], ".4f"),
        shown(s["rmse"].pooled, ".3g"),
        _mean_and_sd(s["rmse"], ".3g"),
        shown(s["max_error"].pooled, ".3g"),
        shown(None if coverage is None else 100 * coverage, ".1f"),
        shown(s["fit_s"].mean, ".3g"),
        how,
    )


def _mean_and_sd(score: Score, form: str) -> str:
    """One fold has no spread."""
    spread = "" if score.sd is None else f" ± {shown(score.sd, '.2g')}"
    return shown(score.mean, form) + spread


def residuals_section(result: CvResult) -> Html | None:
    """Parity of the models, and where the best one errs."""
    models = {name: one for name, one in headline(result).items() if len(one.rows)}
    if not models:
        return None
    y = result.table.y
    chosen = list(models)[:8]
    panels = [ParityPanel(name, y[models[name].rows], models[name].mean) for name in chosen]
    best, first = next(iter(models.items()))
    blocks: list[object] = [
        figure_block(
            parity_figure(
                panels,
                label=result.table.target,
                name="parity",
                alt=f"Predicted against true {result.table.target} for {', '.join(chosen)}.",
            ),
            "Each point is a row of a test fold; on the line the prediction is right. Points "
            "beyond the frame are drawn at its edge.",
        )
    ]
    if result.table.is_design_space:
        residual = first.mean - y[first.rows]
        worst = int(np.argmax(np.abs(residual)))
        at = result.table.X[first.rows[worst]]
        blocks.append(
            figure_block(
                residual_figure(
                    result.table.X[first.rows],
                    residual,
                    unit=result.table.mesh_error_rms,
                    name="residuals",
                    alt=f"Residuals of {best} over a, b and strain.",
                ),
                f"Residuals of {best}. The worst row is off by {abs(residual[worst]):.3g}, at "
                f"a = {at[0]:g} %, b = {at[1]:g} %, strain {at[2]:.3g}. The band is the table's "
                "mesh error, where it has one.",
            )
        )
    return tag("section", tag("h2", "Parity and residuals"), blocks, id="residuals")


def calibration_section(result: CvResult) -> Html | None:
    """Stated against found coverage."""
    curves = {name: one.calibration for name, one in headline(result).items() if one.calibration}
    if not curves:
        return None
    return tag(
        "section",
        tag("h2", "Calibration"),
        figure_block(
            calibration_figure(
                curves,
                marks=marks_of(result.settings.models),
                name="calibration",
                alt="Stated against found coverage by model.",
            ),
            "Grouped folds, refitted, pooled. On the diagonal an interval covers as many rows "
            "as it says; below it the model is too sure, above it too cautious.",
        ),
        id="calibration",
    )


def learning_section(result: CvResult) -> Html | None:
    """Error against the number of groups."""
    models = result.summaries.get("learning-curve", {})
    curves = {
        name: points
        for name, one in models.items()
        if (
            points := [
                (point.groups, value, point.scores["rmse"].sd)
                for point in one.curve
                if (value := point.scores["rmse"].mean) is not None and value > 0
            ]
        )
    }
    if not curves:
        return None
    word = result.table.group_word + "s"
    return tag(
        "section",
        tag("h2", "Learning curve"),
        figure_block(
            learning_figure(
                curves,
                marks=marks_of(result.settings.models),
                groups=word,
                unit=result.table.mesh_error_rms,
                name="learning",
                alt=f"RMSE against the number of {word} by model.",
            ),
            f"A fifth of the {word} is tested, nested parts of the rest are learnt from; three "
            "draws, bars one standard deviation.",
        ),
        id="learning",
    )


def time_section(result: CvResult) -> Html | None:
    """Time of a fit against error."""
    points = {
        name: (seconds, error)  # together: some models do all their work when they predict
        for name, one in headline(result).items()
        if (fitting := one.scores["fit_s"].mean) is not None
        and (predicting := one.scores["predict_s"].mean) is not None
        and (error := one.scores["rmse"].mean) is not None
        and (seconds := fitting + predicting) > 0
        and error > 0
    }
    if not points:
        return None
    return tag(
        "section",
        tag("h2", "Time against accuracy"),
        figure_block(
            time_figure(
                points,
                marks=marks_of(result.settings.models),
                unit=result.table.mesh_error_rms,
                name="time",
                alt="Seconds of a fit and its predictions against RMSE by model.",
            ),
            "Mean over the folds; CPU seconds of one thread, wall seconds on a GPU.",
        ),
        id="time",
    )


def checks_section(checks: tuple[CheckResult, ...]) -> Html:
    """What the numbered checks found."""
    return tag(
        "section",
        tag("h2", "Checks"),
        table(
            ("Check", "Result", "What", "Found", "Remedy"),
            [
                (
                    one.check.code,
                    one.severity if one.found.status == "fired" else one.found.status,
                    one.check.title,
                    one.found.detail,
                    one.check.remedy if one.found.status == "fired" else "",
                )
                for one in checks
            ],
            caption="Each check has a page in docs/checks.",
        ),
        id="checks",
    )


def record_section(result: CvResult) -> Html:
    """Table, settings and models: what others need to repeat it."""
    made = result.table
    facts = [
        f"Table: {len(made.y)} rows, {made.groups} {made.group_word}s, "
        f"inputs {', '.join(made.features)}, target {made.target}.",
        f"Hash of the table's content: {made.sha256}.",
        f"Folds {result.settings.folds}, repeats {result.settings.repeats}, seed "
        f"{result.settings.seed}, device {result.settings.device}, budget "
        f"{result.settings.budget_s:g} CPU s a model and protocol.",
    ]
    if made.measure is not None:
        facts.insert(1, f"Strain measure: {made.measure}.")
    if made.mesh_error_rms is not None:
        facts.insert(1, f"Mesh error of the table: {made.mesh_error_rms:.3g} rms.")
    infos = {name: model_info(name) for name in result.settings.models}
    return tag(
        "section",
        tag("h2", "Record"),
        bullets(facts),
        table(
            ("Model", "What it is", "Guessed"),
            [(name, info["description"], info["guessed"]) for name, info in infos.items()],
            caption="Models.",
        ),
        id="record",
    )
