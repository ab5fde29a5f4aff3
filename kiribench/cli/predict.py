"""`kiribench predict`: Poisson's ratio from a kept surrogate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from kiribench.cli.command import Outcome
from kiribench.cli.fit import Printing

if TYPE_CHECKING:
    from kiribench.surrogate.kept_model import KeptModel, Prediction


def predict(
    model: Path,
    points: Path | None = None,
    /,
    *,
    at: list[str] | None = None,
    out: Path | None = None,
    strain_measure: str | None = None,
    device: str = "cpu",
    common: Printing | None = None,
) -> Outcome:
    """Predict Poisson's ratio with a model of kiribench fit.

    Without --json the answer is CSV: the points, poisson_ratio, its standard deviation where
    the model has one, and whether the point lies inside the training data's range.

    Parameters
    ----------
    model
        The model file.
    points
        CSV, TSV or Parquet with a_percent, b_percent and longitudinal_strain.
    at
        A point as a,b,strain (percent, percent, fraction); may be given several times.
    out
        CSV file to write instead of printing the rows.
    strain_measure
        The measure that the points' strains are in; refused if it is not the model's. Without
        it a table's sidecar is asked, and points of --at are taken to be in the model's.
    device
        cpu or cuda.
    """
    import numpy as np

    from kiribench.errors import Fault, UsageError
    from kiribench.schema.design_space import read_points
    from kiribench.surrogate.keep import load

    if (points is None) == (not at):
        raise UsageError(
            "points-missing",
            "There is nothing to predict, or too much.",
            remedy="Give either a table of points or --at a,b,strain.",
        )
    if points is not None:
        rows, declared = read_points(points)
        if declared and strain_measure and declared != strain_measure:
            raise UsageError(
                "strain-measure-conflict",
                "The points' sidecar and --strain-measure differ.",
                remedy="Find out which is right.",
                got=f"{declared} and {strain_measure}",
            )
        strain_measure = strain_measure or declared
    else:
        rows = np.array([_point(text) for text in at or []])
    _check_cuts(rows, points)
    kept = load(model, device=device)
    predicted = kept.predict(rows[:, 0], rows[:, 1], rows[:, 2], measure=strain_measure)
    table = _csv(rows, predicted)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(table, encoding="utf-8")
    outside = int(np.sum(~predicted.inside))
    faults: tuple[Fault, ...] = ()
    if outside:
        faults = (
            Fault(
                "prediction-extrapolates",
                f"{outside} of {len(rows)} points lie outside the training data's range.",
                "Do not trust these; simulate them.",
                expected=_ranges(kept),
                severity="warning",
            ),
        )
    return Outcome(
        result={
            "schema": "kiribench.predict/1",
            "model": kept.name,
            "strain_measure": kept.measure,
            "columns": ["a_percent", "b_percent", "longitudinal_strain"],
            "points": rows.tolist(),
            "poisson_ratio": predicted.mean.tolist(),
            "sd": None if predicted.sd is None else predicted.sd.tolist(),
            "inside": predicted.inside.tolist(),
            **({} if out is None else {"file": str(out)}),
        },
        text=table.rstrip("\n") if out is None else f"{len(rows)} points predicted: {out}",
        faults=faults,
        inputs=(model,) if points is None else (model, points),
    )


def _point(text: str) -> list[float]:
    from kiribench.errors import UsageError

    fields = text.split(",")
    try:
        numbers = [float(field) for field in fields]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise UsageError(
            "point-not-three-numbers",
            "A point is three numbers: a_percent, b_percent, strain.",
            remedy="Write it as --at 80,80,0.25.",
            got=text,
        )
    return numbers


def _check_cuts(rows: Any, file: Path | None) -> None:
    """Refuse cut lengths that no sheet can have; between them a model may extrapolate."""
    import numpy as np

    from kiribench.errors import UsageError

    wrong = np.flatnonzero(((rows[:, :2] < 0) | (rows[:, :2] >= 100)).any(axis=1))
    if len(wrong):
        a, b, _ = rows[wrong[0]].tolist()
        raise UsageError(
            "cut-length-range",
            f"Point {wrong[0] + 1} of {len(rows)} has cuts that no sheet can have.",
            remedy="Give percent of the cell edge; neighbouring cuts meet at 100.",
            file=file,
            got=f"a {a:g} %, b {b:g} %",
            expected="0 <= length < 100",
        )


def _csv(rows: Any, predicted: Prediction) -> str:
    lines = ["a_percent,b_percent,longitudinal_strain,poisson_ratio,poisson_ratio_sd,inside"]
    for index, (a, b, strain) in enumerate(rows.tolist()):
        sd = "n/a" if predicted.sd is None else f"{predicted.sd[index]:.6g}"
        inside = "true" if predicted.inside[index] else "false"
        lines.append(f"{a:.10g},{b:.10g},{strain:.10g},{predicted.mean[index]:.9g},{sd},{inside}")
    return "\n".join(lines) + "\n"


def _ranges(kept: KeptModel) -> str:
    names = ("a_percent", "b_percent", "strain")
    return ", ".join(
        f"{name} {low:g} to {high:g}"
        for name, low, high in zip(names, kept.low.tolist(), kept.high.tolist(), strict=True)
    )
