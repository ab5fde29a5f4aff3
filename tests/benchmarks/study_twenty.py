"""Twenty subjects, five designs each: what the worn model predicts. Run as a script; resumable.

    python tests/benchmarks/study_twenty.py FOLDER [--methods uniform,paper,...] [--table]
    python tests/benchmarks/study_twenty.py FOLDER --poses 24 [--only S1,S2,...]

Three stored subjects and seventeen generated ones: varied build, asymmetry, shear (twist of the
skin), hollows, scan and node noise. R001 to R007 may be looked at while building; R008 to R017
are of another seed and were fixed before any of them was run. Each finished design is a line of
FOLDER/study.tsv; a second run goes on with what is missing. `--table` prints the summary.

`--poses` puts `worn` and `robust` on in random poses (drawn from the errors that `robust` is
designed for; not its own poses), with node noise, and beside them `carried`: corners that are on
their nodes and move as the straps do. Each pose is a line of FOLDER/poses.tsv.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from kiribench.conformability.score import ScoreOptions
from kiribench.dataset import Dataset
from kiribench.design.methods import design_patch
from kiribench.design.on_skin import design_on_skin
from kiribench.design.problem import DesignProblem, problem_from_subject
from kiribench.design.robust import Spread, design_robust
from kiribench.design.skin import skin_of
from kiribench.design.surrogates import Surrogates
from kiribench.design.worn import Pose
from kiribench.design.worn_model import KneeModel
from kiribench.design.worn_record import worn_table
from kiribench.errors import NotConvergedError
from kiribench.lattice import CutMap
from kiribench.reference.check import CheckOptions, check_design
from kiribench.reference.export import check_object
from kiribench.reference.fast_overlap import FastOverlap
from kiribench.reference.ground import KneeGround
from kiribench.reference.side_by_side import best_uniform
from kiribench.schema.design_space import read_design_space
from kiribench.schema.patch_design import PatchDesign, read_design, write_design
from kiribench.surrogate.keep import fit_table, save
from kiribench.synthetic import STORED, Imperfections, Knee, random_knee, write_dataset

METHODS = ("uniform", "paper", "balanced", "worn", "robust")
SEEN, UNSEEN = (20261122, range(1, 8)), (4711, range(8, 18))
CONFIRM = 16
COLUMNS = (
    "subject", "unseen", "method", "fair_paper", "good_paper", "mean_paper", "fair_strict",
    "good_strict", "mean_strict", "fair_low", "fair_high", "least_paper", "causes",
    "design_cpu_s", "check_cpu_s", "elements",
)  # fmt: skip
POSED = ("carried", "worn", "robust")
POSE_COLUMNS = (
    "subject", "pose", "method", *(f"{name}_{by}" for by in ("paper", "strict", "iou")
                                  for name in ("fair", "good", "mean")),
)  # fmt: skip
POSE_SEED, POSE_ELEMENTS, NOISE_DRAWS = 97, 6, 8
ROOT = Path(__file__).parents[2]


def generated(seed: int, index: int) -> tuple[Knee, Imperfections]:
    """A random knee with shear, hollows and noise beyond those of `random_knee`."""
    knee = random_knee(index, seed)
    rng = np.random.default_rng([seed, index, 1])
    slide = replace(
        knee.build.slide,
        twist=float(rng.uniform(-6.0, 6.0)),
        medial_excess=float(rng.uniform(-0.4, 0.4)),
    )
    deeper = float(rng.uniform(1.0, 1.6))
    bumps = tuple(
        replace(bump, height_mm=deeper * bump.height_mm) if bump.height_mm < 0 else bump
        for bump in knee.build.bent.bumps
    )
    build = replace(knee.build, slide=slide, bent=replace(knee.build.bent, bumps=bumps))
    flaws = Imperfections(
        noise_mm=float(rng.choice([0.0, 0.05])),
        node_noise_mm=float(rng.choice([0.0, 0.1, 0.25])),
        seed=index,
    )
    return replace(knee, build=build), flaws


def subjects() -> dict[str, tuple[bool, Path | None, tuple[Knee, Imperfections] | None]]:
    """Label -> whether unseen, dataset where shipped, knee where generated."""
    out: dict[str, tuple[bool, Path | None, tuple[Knee, Imperfections] | None]] = {}
    for label in STORED:
        out[label] = (False, ROOT / "data" / "synthetic", None)
    for unseen, (seed, indices) in ((False, SEEN), (True, UNSEEN)):
        for index in indices:
            made = generated(seed, index)
            out[made[0].label] = (unseen, None, made)
    return out


def surrogate(folder: Path) -> Surrogates:
    """Of the shipped table of periodic cells, fitted once."""
    path = folder / "gp.safetensors"
    if not path.exists():
        space = read_design_space(ROOT / "data/synthetic/design_space/cell.parquet", measure="log")
        save(fit_table(space, "gp_kronecker", seed=0, device="cpu"), path)
    return Surrogates.of(path)


def done(folder: Path) -> set[tuple[str, str]]:
    """Subject and method of the lines that are there."""
    path = folder / "study.tsv"
    if not path.exists():
        path.write_text("\t".join(COLUMNS) + "\n", encoding="utf-8")
    lines = path.read_text(encoding="utf-8").splitlines()[1:]
    return {(line.split("\t")[0], line.split("\t")[2]) for line in lines}


def run(folder: Path, methods: tuple[str, ...], only: tuple[str, ...]) -> None:
    """Design and check what is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    finished, models = done(folder), surrogate(folder)
    for label, (unseen, root, made) in subjects().items():
        wanted = [method for method in methods if (label, method) not in finished]
        if not wanted or (only and label not in only):
            continue
        if made is not None:
            root = folder / "data" / label
            if not (root / "dataset_description.json").exists():
                write_dataset(root, [made[0]], made[1])
        assert root is not None
        subject = Dataset.open(root).subject(label)
        skin = skin_of(subject)
        problem = problem_from_subject(subject, strain_measure="log")
        options = CheckOptions(elements=CONFIRM, score=ScoreOptions(samples=200))
        model = KneeModel(skin)
        for method in wanted:
            try:
                line = one(label, unseen, method, folder, model, problem, models, options)
            except NotConvergedError as error:
                # No answer is no success: it counts as a patch without a satisfactory cell.
                print(f"{label} {method}: {error}", flush=True)
                values = ["0.0000"] * 9
                line = "\t".join(
                    [label, "yes" if unseen else "no", method, *values,
                     "not-converged", "0.0", "0.0", str(CONFIRM)]
                )  # fmt: skip
            with (folder / "study.tsv").open("a", encoding="utf-8") as table:
                table.write(line + "\n")
            print(line, flush=True)


def one(
    label: str, unseen: bool, method: str, folder: Path, model: KneeModel,
    problem: DesignProblem, models: Surrogates, options: CheckOptions,
) -> str:  # fmt: skip
    """Design, keep and judge one patch; a line of the table."""
    skin = model.skin
    ground = KneeGround(skin)
    began = time.process_time()
    if method == "robust":
        kept = read_design(folder / "designs" / label / "worn")
        made_robust = design_robust(model, CutMap(kept.a, kept.b, kept.cell_mm))
        design = worn_table(kept, made_robust, method="robust")
    elif method == "worn":
        design = design_on_skin("worn", problem, models, skin).design
    elif method == "uniform":
        like = design_patch("uniform", problem, models).design
        checked, _ = best_uniform(like, ground, replace(options, elements=6))
        design = checked.design
    else:
        design = design_patch(method, problem, models).design
    spent = time.process_time() - began
    write_design(folder / "designs" / label / method, design)
    return judged(label, unseen, method, design, ground, options, spent)


def judged(
    label: str, unseen: bool, method: str, design: PatchDesign, ground: KneeGround,
    options: CheckOptions, spent: float,
) -> str:  # fmt: skip
    """One line of the table."""
    checked = check_design(design, ground, options)
    content = check_object(checked)
    share, whole = content["share"], checked.conformability.whole
    causes = ",".join(f"{n} {name}" for name, n in content["cells_below_good"].items()) or "none"
    values = (
        share["paper"]["fair"], share["paper"]["good"], share["paper"]["mean"],
        share["strict"]["fair"], share["strict"]["good"], share["strict"]["mean"],
        whole.satisfactory_low, whole.satisfactory_high,
        float(np.nanmin(checked.conformability.overlap_paper)),
    )  # fmt: skip
    words = [label, "yes" if unseen else "no", method, *(f"{value:.4f}" for value in values)]
    return "\t".join(
        [*words, causes, f"{spent:.1f}", f"{checked.cpu_seconds:.1f}", str(options.elements)]
    )


def posed(folder: Path, count: int, only: tuple[str, ...]) -> None:
    """Put the designs on in random poses, and keep the shares of each pose."""
    path = folder / "poses.tsv"
    if not path.exists():
        path.write_text("\t".join(POSE_COLUMNS) + "\n", encoding="utf-8")
    finished = {line.split("\t")[0] for line in path.read_text(encoding="utf-8").splitlines()}
    spread = Spread()
    for number, (label, (_, root, _)) in enumerate(subjects().items()):
        kept = {name: folder / "designs" / label / name for name in POSED[1:]}
        ready = all(one.exists() for one in kept.values())
        if label in finished or (only and label not in only) or not ready:
            continue
        skin = skin_of(Dataset.open(root or folder / "data" / label).subject(label))
        model, fast = KneeModel(skin), FastOverlap.of(skin)
        tables = {name: read_design(one) for name, one in kept.items()}
        rng = np.random.default_rng([POSE_SEED, number])
        lines = []
        for index, pose in enumerate(spread.draw(count, rng)):
            noise = rng.standard_normal((NOISE_DRAWS, *model.target_q_mm.shape))
            for name in POSED:
                if name == "carried":
                    corner = carried(model, pose)
                else:
                    cuts = CutMap(tables[name].a, tables[name].b, tables[name].cell_mm)
                    corner = model.worn(cuts, POSE_ELEMENTS, **pose).corner_q_mm
                areas = fast.areas(corner + spread.node_mm * noise)
                shares = []
                for values in (areas.paper, areas.strict, areas.iou):
                    known = values[np.isfinite(values)]
                    shares += [(known >= 0.75).mean(), (known >= 0.9).mean(), known.mean()]
                words = (f"{value:.4f}" for value in shares)
                lines.append("\t".join([label, str(index), name, *words]))
        with path.open("a", encoding="utf-8") as table:
            table.write("\n".join(lines) + "\n")
        slides = ", ".join(f"{name} {slide(model, table):.2f}" for name, table in tables.items())
        print(f"{label}: {count} poses; corners slide / offset across: {slides}", flush=True)


def slide(model: KneeModel, design: PatchDesign) -> float:
    """rms way of the corners for an offset across of half a millimetre, over that offset."""
    cuts = CutMap(design.a, design.b, design.cell_mm)
    there = model.worn(cuts, POSE_ELEMENTS, offset_mm=(0.5, 0.0)).corner_q_mm
    way = there - model.worn(cuts, POSE_ELEMENTS).corner_q_mm
    return float(np.sqrt((way**2).sum(axis=-1).mean()) / 0.5)


def carried(model: KneeModel, pose: Pose) -> np.ndarray:
    """(R+1, C+1, 2) nodes moved as the straps are: turned, displaced, slipped evenly."""
    target = model.target_q_mm
    size = target[-1, -1] - target[0, 0]
    centre = target[0, 0] + size / 2
    angle = np.deg2rad(pose["turn_deg"])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = (target - centre) @ turn.T + centre + np.array(pose["offset_mm"])
    moved[..., 1] -= pose["strap_slip_mm"] * (target[..., 1] - target[0, 0, 1]) / size[1]
    return np.asarray(moved)


def pose_summary(folder: Path) -> str:
    """Markdown: means over subjects and poses, and robust less worn with 95 % of bootstraps.

    Subjects are drawn with replacement, and poses within each.
    """
    lines = (folder / "poses.tsv").read_text(encoding="utf-8").splitlines()[1:]
    cells = [line.split("\t") for line in lines]
    labels = list(dict.fromkeys(row[0] for row in cells))
    values = np.array([[float(x) for x in row[3:]] for row in cells])
    table = values.reshape(len(labels), -1, len(POSED), values.shape[1])
    rng = np.random.default_rng(0)

    def words(value: float, name: str) -> str:
        return f"{value:+.3f}" if name.startswith("mean") else f"{100 * value:+.1f}"

    out = [
        f"{len(labels)} subjects ({', '.join(labels)}), {table.shape[1]} poses each",
        "| design | " + " | ".join(name.replace("_", ", ") for name in POSE_COLUMNS[3:]) + " |",
        "|---" * (1 + len(POSE_COLUMNS[3:])) + "|",
    ]
    for which, method in enumerate(POSED):
        mean = table[:, :, which].mean(axis=(0, 1))
        shown = [words(v, n).lstrip("+") for v, n in zip(mean, POSE_COLUMNS[3:], strict=True)]
        out.append(f"| {method} | " + " | ".join(shown) + " |")
    gain = table[:, :, 2] - table[:, :, 1]
    draws = []
    for _ in range(2000):
        chosen = rng.integers(0, len(gain), len(gain))
        poses = rng.integers(0, gain.shape[1], (len(gain), gain.shape[1]))
        draws.append(gain[chosen[:, None], poses].mean(axis=(0, 1)))
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    shown = [
        f"{words(v, n)} [{words(a, n)}, {words(b, n)}]"
        for v, a, b, n in zip(gain.mean(axis=(0, 1)), low, high, POSE_COLUMNS[3:], strict=True)
    ]
    out.append("| robust - worn | " + " | ".join(shown) + " |")
    by_subject = ", ".join(
        f"{label} {100 * g:+.1f}"
        for label, g in zip(labels, gain[:, :, 4].mean(axis=1), strict=True)
    )
    out.append(f"good by strict, robust - worn by subject: {by_subject}")
    return "\n".join(out)


def summary(folder: Path) -> str:
    """Markdown: mean over the subjects of each share, with a 95 % bootstrap interval."""
    lines = (folder / "study.tsv").read_text(encoding="utf-8").splitlines()
    rows = [dict(zip(COLUMNS, line.split("\t"), strict=True)) for line in lines[1:]]
    rng = np.random.default_rng(0)
    out = [
        "| design | subjects | fair, paper | good, paper | mean, paper | fair, strict | "
        "good, strict | mean, strict | all cells fair | good >= 95 % |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for which, words in (("all", ""), ("yes", ", unseen")):
        for method in METHODS:
            chosen = [
                row for row in rows if row["method"] == method and which in ("all", row["unseen"])
            ]
            if not chosen:
                continue
            cells = []
            for name in COLUMNS[3:9]:
                values = np.array([float(row[name]) for row in chosen])
                draws = rng.choice(values, (4000, len(values))).mean(axis=1)
                low, high = np.quantile(draws, [0.025, 0.975])
                if name.startswith("mean"):
                    cells.append(f"{values.mean():.3f} [{low:.3f}, {high:.3f}]")
                else:
                    cells.append(f"{100 * values.mean():.1f} [{100 * low:.1f}, {100 * high:.1f}]")
            fair = sum(float(row["fair_paper"]) == 1 for row in chosen)
            good = sum(float(row["good_paper"]) >= 0.95 for row in chosen)
            out.append(
                f"| {method}{words} | {len(chosen)} | "
                + " | ".join(cells)
                + f" | {fair} | {good} |"
            )
    return "\n".join(out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--only", default="")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--poses", type=int, default=0)
    given = parser.parse_args()
    labels_given = tuple(filter(None, given.only.split(",")))
    if given.poses:
        posed(given.folder, given.poses, labels_given)
    elif not given.table:
        run(given.folder, tuple(given.methods.split(",")), labels_given)
    if not given.poses:
        print(summary(given.folder))
    if (given.folder / "poses.tsv").exists():
        print(pose_summary(given.folder))
