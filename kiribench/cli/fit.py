"""`kiribench fit`: a surrogate of a design space, kept in one file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from cyclopts import Parameter

from kiribench.cli.command import Outcome


@Parameter(name="*")
@dataclass(frozen=True)
class Printing:
    """Options of a command whose --out is a file, not a folder.

    Parameters
    ----------
    json
        Print one JSON object instead of text.
    quiet
        No progress bars and no warnings on stderr.
    """

    json: Annotated[bool, Parameter(negative=())] = False
    quiet: Annotated[bool, Parameter(negative=())] = False
    out: ClassVar[Path | None] = None


def fit(
    table: Path,
    /,
    *,
    out: Path,
    model: str = "gp_kronecker",
    strain_measure: str | None = None,
    seed: int = 0,
    device: str = "cpu",
    common: Printing | None = None,
) -> Outcome:
    """Fit a surrogate to a design space and keep it in one safetensors file.

    Where the table has nominal_stress_mpa, a Gaussian process is kept together with a second one
    of the nominal stress, which kiribench design --method balanced asks for.

    Gaussian processes also say how well they predict designs that they have not seen (ten
    folds of whole designs, in closed form, hyperparameters kept). For a comparison of
    models with refits use kiribench cv.

    Parameters
    ----------
    table
        Design space: CSV, TSV or Parquet with a_percent, b_percent and stretches (of
        kiribench simulate) or longitudinal_strain with poisson_ratio.
    out
        The model file, ending in .safetensors.
    model
        A model's name, such as gp (the paper's), gp_kronecker, svgp, random_forest.
    strain_measure
        log, engineering or green: for stretches the measure to compute (log by default),
        for strains the measure that they are in, unless the table's sidecar says it.
    seed
        Seed of the model and of the folds.
    device
        cpu or cuda.
    """
    from kiribench.errors import UsageError
    from kiribench.schema.design_space import read_design_space
    from kiribench.surrogate.keep import fit_table, save

    if out.suffix != ".safetensors" or out.is_dir():
        raise UsageError(
            "out-not-safetensors",
            "--out is the model file.",
            remedy="Give a file name that ends in .safetensors.",
            got=out,
        )
    space = read_design_space(table, measure=strain_measure)
    kept = fit_table(space, model, seed=seed, device=device)
    save(kept, out)
    size = out.stat().st_size
    summary = kept.summary
    lines = [
        f"{model}: {summary['rows']} rows, {summary['designs']} designs, "
        f"{space.measure} strain, {size / 1000:.0f} kB in {out}"
    ]
    for reason, count in space.dropped.items():
        lines.append(f"left out: {count} rows ({reason})")
    if summary.get("structure") == "resampled":
        lines.append(
            "strains differ by design: resampled to a common grid, estimated error "
            f"{summary['resampling_rms']:.1e} rms of Poisson's ratio"
        )
    left_out = summary.get("designs_left_out")
    if left_out and left_out["folds"]:
        lines.append(
            f"designs left out ({left_out['folds']} folds): rmse {left_out['rmse']:.5f}, "
            f"worst {left_out['max_error']:.4f}, "
            f"95 % intervals hold {100 * left_out['coverage95']:.1f} %"
        )
    if kept.stress is not None:
        stress = kept.stress.summary["designs_left_out"]
        lines.append(
            "nominal stress kept too"
            + (
                f"; designs left out: relative error {stress['median_error']:.1e} (median), "
                f"{stress['rmse']:.3f} rms"
                if stress["folds"]
                else ""
            )
        )
    lines.append("Fitted and kept.")
    return Outcome(
        result={
            "schema": "kiribench.fit/1",
            "model": model,
            "strain_measure": space.measure,
            "file": str(out),
            "bytes": size,
            "summary": summary,
            "stress": None if kept.stress is None else kept.stress.summary,
        },
        text="\n".join(lines),
        inputs=space.files,
    )
