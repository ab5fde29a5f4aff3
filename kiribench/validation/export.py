"""A cross-validation as one JSON object and as text."""

from __future__ import annotations

from typing import Any

import numpy as np

from kiribench.surrogate.registry import spec
from kiribench.validation import gaussian_scores, point_scores
from kiribench.validation.checks import CheckResult
from kiribench.validation.protocols import HEADLINE, protocol, said_of
from kiribench.validation.ranking import ranking_object
from kiribench.validation.run import CvResult
from kiribench.validation.summary import Score, Summary
from kiribench.validation.table1 import TableOne, table_one_object
from kiribench.validation.tuning import VARIANT

SCHEMA = "kiribench.cv/1"


def cv_object(
    result: CvResult, checks: tuple[CheckResult, ...], table_one: TableOne | None
) -> dict[str, Any]:
    """The result of ``kiribench cv``, ready for JSON; absent numbers are null."""
    table = result.table
    rms = table.mesh_error_rms
    return {
        "schema": SCHEMA,
        "table": {
            "rows": len(table.y),
            table.group_word + "s": table.groups,
            "features": list(table.features),
            "target": table.target,
            "strain_measure": table.measure,
            "mesh_error_rms": rms,
            "sha256": table.sha256,
            "dropped": dict(table.space.dropped) if table.space is not None else {},
        },
        "headline": HEADLINE if HEADLINE in result.summaries else None,
        "protocols": {
            name: {model: model_object(one) for model, one in models.items()}
            for name, models in result.summaries.items()
        },
        "protocol_info": {
            name: {
                "title": said_of(result.table, protocol(name).title),
                "question": said_of(result.table, protocol(name).question),
                "folds": len(folds),
                "leaky": protocol(name).leaky,
                "skipped": result.skipped[name],
            }
            for name, folds in result.planned.folds.items()
        },
        "protocols_left_out": result.planned.left_out,
        "models": {name: model_info(name) for name in result.settings.models},
        "ranking": {name: ranking_object(one) for name, one in result.rankings.items()},
        "leakage": leakage(result),
        "by_place": by_place(result),
        "checks": [one.as_dict() for one in checks],
        "table1": None if table_one is None else table_one_object(table_one),
        "reused_folds": result.reused,
    }


def model_object(one: Summary) -> dict[str, Any]:
    """A model under a protocol."""
    record: dict[str, Any] = {name: score.as_dict() for name, score in one.scores.items()}
    record["folds"] = len(one.fold_names)
    record["closed_form"] = one.closed_form
    record["calibration"] = [list(pair) for pair in one.calibration]
    if one.curve:
        record["curve"] = [
            {"groups": point.groups}
            | {name: point.scores[name].as_dict() for name in ("r2", "rmse", "crps", "fit_s")}
            for point in one.curve
        ]
    if one.failures:
        record["failures"] = one.failures
    record["notes"] = one.notes
    return record


def model_info(name: str) -> dict[str, Any]:
    """What a model is."""
    plain, _, variant = name.partition(":")
    entry = spec(plain if variant == VARIANT else name)
    return {
        "title": entry.title + (" (tuned)" if variant == VARIANT else ""),
        "description": entry.description,
        "in_paper": entry.in_paper,
        "guessed": entry.guessed,
        "nested_tuning": variant == VARIANT,
    }


def leakage(result: CvResult) -> dict[str, dict[str, float]]:
    """By model: how much better shuffled rows look than designs that are new."""
    shuffled = result.summaries.get("shuffled", {})
    gaps: dict[str, dict[str, float]] = {}
    for model, honest in result.summaries.get(HEADLINE, {}).items():
        leaky = shuffled.get(model)
        if leaky is None:
            continue
        error, claimed = honest.scores["rmse"].pooled, leaky.scores["rmse"].pooled
        r2, said = honest.scores["r2"].pooled, leaky.scores["r2"].pooled
        if error is None or claimed is None or r2 is None or said is None or claimed <= 0:
            continue
        gaps[model] = {"rmse_ratio": error / claimed, "r2_gap": said - r2}
    return gaps


def by_place(result: CvResult) -> dict[str, dict[str, dict[str, float | None]]]:
    """By model under the headline: the error on the lattice's outermost lines and inside them.

    A design on the rim has no neighbour beyond it: leaving it out asks for extrapolation, and
    a few such designs can make up most of a pooled error.
    """
    table = result.table
    if not table.is_design_space:
        return {}
    cuts = table.X[:, :2]
    rim = ((cuts == cuts.min(axis=0)) | (cuts == cuts.max(axis=0))).any(axis=1)
    unit = table.mesh_error_rms
    places: dict[str, dict[str, dict[str, float | None]]] = {}
    for model, one in result.summaries.get(HEADLINE, {}).items():
        places[model] = {}
        for name, where in (("inside", ~rim), ("rim", rim)):
            chosen = where[one.rows]
            if not chosen.any():
                continue
            truth, mean = table.y[one.rows][chosen], one.mean[chosen]
            error = point_scores.rmse(truth, mean)
            places[model][name] = {
                "rmse": error,
                "rmse_over_mesh_error": None if unit is None else error / unit,
                "max_error": point_scores.max_error(truth, mean),
                "coverage95": None
                if one.sd is None
                else gaussian_scores.coverage(truth, mean, one.sd[chosen], 0.95),
            }
    return places


def cv_text(result: CvResult, checks: tuple[CheckResult, ...], table_one: TableOne | None) -> str:
    """The same for a person; the last line is the verdict."""
    table = result.table
    lines = [f"{len(table.y)} rows, {table.groups} {table.group_word}s, target {table.target}"]
    if table.measure is not None:
        lines[0] += f" in {table.measure} strain"
    if table.mesh_error_rms is not None:
        lines[0] += f", mesh error {table.mesh_error_rms:.2g} rms"
    for name, models in result.summaries.items():
        row = protocol(name)
        folds = len(result.planned.folds[name])
        said = f"{row.title} ({folds} fold{'s' if folds != 1 else ''}). {row.question}"
        lines += ["", said_of(result.table, said)]
        lines.append(_HEAD)
        lines += [_line(model, one) for model, one in models.items()]
        lines += [f"  {model:26} skipped: {why}" for model, why in result.skipped[name].items()]
    for name, reason in result.planned.left_out.items():
        lines.append(f"{name}: left out, {reason}")
    ranking = result.rankings.get(HEADLINE)
    if ranking is not None and ranking.places:
        lines += ["", f"Ranking by RMSE, {ranking.folds} common folds (rope {ranking.rope:.2g}):"]
        lines += [f"  {p.model:26} {p.rmse:.3g}  {p.words}" for p in ranking.places]
        lines += [f"  {m:26} not ranked: {why}" for m, why in ranking.unranked.items()]
    gaps = leakage(result)
    if gaps:
        lines += ["", "Leakage: RMSE of new designs over RMSE of shuffled rows:"]
        lines.append("  " + ", ".join(f"{m} {gap['rmse_ratio']:.3g}" for m, gap in gaps.items()))
    if table_one is not None and table_one.nearest:
        lines += ["", "Table 1 of the paper:", *(f"  {s}" for s in table_one.sentences)]
    lines.append("")
    lines += [
        f"{one.check.code} {one.severity if one.found.status == 'fired' else one.found.status}: "
        f"{one.check.title}. {one.found.detail}"
        for one in checks
        if one.found.status == "fired"
    ]
    lines.append(verdict(result, checks))
    return "\n".join(lines)


_HEAD = f"  {'model':26} {'R2':>9} {'RMSE':>9} {'sd':>8} {'/mesh':>6} {'95 %':>6} {'fit s':>7}"


def _line(model: str, one: Summary) -> str:
    def shown(score: Score, form: str) -> str:
        return "-" if score.pooled is None else format(score.pooled, form)

    s = one.scores
    spread = "-" if s["rmse"].sd is None else format(s["rmse"].sd, ".2g")
    coverage = s["coverage95"].pooled
    fit = s["fit_s"].mean
    text = (
        f"  {model:26} {shown(s['r2'], '.5f'):>9} {shown(s['rmse'], '.3g'):>9} {spread:>8} "
        f"{shown(s['rmse_over_mesh_error'], '.2f'):>6} "
        f"{'-' if coverage is None else format(100 * coverage, '.1f'):>6} "
        f"{'-' if fit is None else format(fit, '.2f'):>7}"
    )
    if one.failures:
        text += f"  failed in {len(one.failures)} folds: {next(iter(one.failures.values()))}"
    return text


def verdict(result: CvResult, checks: tuple[CheckResult, ...]) -> str:
    """The outcome in one sentence or two."""
    count = sum(one.found.status == "fired" and one.severity == "error" for one in checks)
    warned = sum(one.found.status == "fired" and one.severity == "warning" for one in checks)
    tail = (
        f"{count} error{'s' * (count != 1)} and {warned} warning{'s' * (warned != 1)} "
        f"among {len(checks)} checks."
    )
    ranking = result.rankings.get(HEADLINE)
    if ranking is None or not ranking.places:
        return f"No headline: the grouped protocol gave no ranking. {tail}"
    best = ranking.places[0]
    level = [p.model for p in ranking.places[1:] if not p.words.startswith("worse")]
    words = f"{best.model} predicts new {result.table.group_word}s best (RMSE {best.rmse:.3g})"
    if level:
        words += f", with no difference that matters or shows to {', '.join(level)}"
    return f"{words}. {tail}"


def finite(record: Any) -> Any:
    """The record with numbers that JSON does not know (NaN, infinity) as null."""
    if isinstance(record, dict):
        return {str(key): finite(value) for key, value in record.items()}
    if isinstance(record, (list, tuple)):
        return [finite(value) for value in record]
    if isinstance(record, (float, np.floating)):
        return float(record) if np.isfinite(record) else None
    if isinstance(record, np.integer):
        return int(record)
    return record
