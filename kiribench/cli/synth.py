"""``kiribench synth``: synthetic subjects with known truth, as a subject folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kiribench.cli.command import Common, Outcome
from kiribench.errors import UsageError

if TYPE_CHECKING:
    from kiribench.synthetic import Knee, SyntheticSubject

SCHEMA = "kiribench.synth/1"
MAX_SUBJECTS = 1000


def synth(
    *,
    subjects: str | None = None,
    random: int = 0,
    seed: int = 0,
    edge_mm: float = 2.22,
    noise_mm: float = 0.0,
    node_noise_mm: float = 0.0,
    holes: int = 0,
    missing_nodes: int = 0,
    common: Common | None = None,
) -> Outcome:
    """Make synthetic knees with known truth and write them as a dataset under --out.

    Two bare scans and one worn scan a subject, each with texture and nodes, and the true
    strains and overlaps from closed forms under derivatives/truth. The same options give the
    same bytes; synth.json beside them is the record of the run.

    Parameters
    ----------
    subjects
        Stored subjects, separated by commas; S1,S2,S3 unless --random asks for others.
    random
        Make this many random subjects (R001, R002, ...): their build, side and fit vary.
    seed
        Of all random draws.
    edge_mm
        Edge length of the bent scans' triangles about the patella; longer elsewhere.
    noise_mm
        Standard deviation of white scan noise along the normals.
    node_noise_mm
        Standard deviation of the nodes' places along each surface direction.
    holes
        Holes in each scan, 5 to 9 mm in radius.
    missing_nodes
        Nodes of each table that were not found.
    common
        Output options.
    """
    from kiribench.cli.progress import progress
    from kiribench.synthetic import Imperfections, write_dataset

    common = common or Common()
    if common.out is None:
        raise UsageError(
            "synth-no-output",
            "No folder was given for the dataset.",
            remedy="Give a new or empty folder with --out.",
        )
    knees = _chosen(subjects, random, seed)
    flaws = Imperfections(
        edge_mm=edge_mm,
        noise_mm=noise_mm,
        node_noise_mm=node_noise_mm,
        holes=holes,
        missing_nodes=missing_nodes,
        seed=seed,
    )
    with progress("making subjects", quiet=common.quiet) as advance:
        made = write_dataset(common.out, knees, flaws, progress=advance)
    rows = [_row(person) for person in made]
    lines = [
        f"sub-{row['id']}  {row['side']:5}  good {row['good']}, fair {row['fair']}, "
        f"poor {row['poor']} of {row['cells']} cells ({row['satisfactory']:.1%} at least fair)"
        for row in rows
    ]
    verdict = f"Wrote {len(rows)} synthetic subject(s) with their truth to {common.out}."
    return Outcome(
        result={"schema": SCHEMA, "dataset": str(common.out), "participants": rows},
        text="\n".join([*lines, verdict]),
    )


def _chosen(subjects: str | None, random: int, seed: int) -> list[Knee]:
    from kiribench.synthetic import STORED, random_knee

    if not 0 <= random <= MAX_SUBJECTS:
        raise UsageError(
            "synth-option",
            "The number of random subjects is out of range.",
            got=random,
            expected=f"0 to {MAX_SUBJECTS}",
            remedy="Choose a number in the range.",
        )
    if subjects is None:
        names = [] if random else list(STORED)
    else:
        names = [name.strip().removeprefix("sub-") for name in subjects.split(",")]
    unknown = [name for name in names if name not in STORED]
    if unknown or len(set(names)) < len(names):
        raise UsageError(
            "synth-unknown-subject",
            "The list of stored subjects is wrong: unknown or named twice.",
            got=subjects,
            expected=",".join(STORED),
            remedy="Name each of these at most once, or use --random N.",
        )
    return [STORED[name] for name in names] + [
        random_knee(index, seed) for index in range(1, random + 1)
    ]


def _row(person: SyntheticSubject) -> dict[str, Any]:
    from kiribench.synthetic.truth_tables import counts

    truth = counts(person)
    truth.pop("Regions")
    summary = {key.lower(): value for key, value in truth.items()}
    return {
        "id": person.knee.label,
        "side": person.knee.build.side,
        "description": person.knee.description,
        **summary,
    }
