"""``kiribench regress``: have the numbers of a reference dataset drifted?"""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path

from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_GATE_FAILED, EXIT_OK, Fault, UsageError

SCHEMA = "kiribench.regress/1"


def regress(
    dataset: Path,
    /,
    *,
    junit: Path | None = None,
    update: bool = False,
    common: Common | None = None,
) -> Outcome:
    """Measure and score a synthetic dataset and compare with truth, records and invariants.

    Truth: the closed forms under derivatives/truth, within absolute bounds. Records: the
    tables under derivatives/kiribench, to rounding. Invariants of the first participant:
    a rigid motion, other units, the mirrored leg and another triangulation of the same
    surface change nothing. Exit code 1 on any drift.

    Parameters
    ----------
    dataset
        Folder with derivatives/truth, such as data/synthetic.
    junit
        Write the checks as JUnit XML to this file.
    update
        Write the recorded tables anew from today's numbers; refused where the environment
        says CI=true.
    common
        Options of every command.
    """
    if update and os.environ.get("CI", "").lower() in ("1", "true", "yes"):
        raise UsageError(
            "regress-update-in-ci",
            "Recorded tables are not updated in CI: drift would approve itself.",
            remedy="Run 'kiribench regress DATASET --update' by hand, review, commit.",
        )
    from kiribench.cli.progress import progress
    from kiribench.dataset import Dataset
    from kiribench.regression.check import junit_xml
    from kiribench.regression.suite import run_suite

    common = common or Common()
    opened = Dataset.open(dataset)
    with progress("regression", quiet=common.quiet) as advance:
        checks = run_suite(opened, advance, update=update)
    if junit is not None:
        junit.parent.mkdir(parents=True, exist_ok=True)
        junit.write_text(junit_xml(checks, "kiribench.regress"), encoding="utf-8")
    failed = [check for check in checks if not check.passed]
    lines = []
    for group in dict.fromkeys(check.group for check in checks):
        inside = [check for check in checks if check.group == group]
        lines.append(f"{group}: {sum(check.passed for check in inside)} of {len(inside)} hold")
        shown = inside if group != "record" else [check for check in inside if not check.passed]
        lines += [check.line() for check in shown]
    lines.append(
        f"Verdict: {len(checks) - len(failed)} of {len(checks)} checks hold; "
        + ("no drift." if not failed else f"{len(failed)} have drifted.")
    )
    subjects = [opened.subject(name) for name in opened.participants]
    return Outcome(
        result={
            "schema": SCHEMA,
            "dataset": opened.description.name,
            "passed": not failed,
            "updated": update,
            "checks": [asdict(check) for check in checks],
        },
        text="\n".join(lines),
        exit_code=EXIT_GATE_FAILED if failed else EXIT_OK,
        faults=tuple(
            Fault(
                "regress-drift",
                f"{check.group}: {check.name} has drifted.",
                "Find the change that did it; if it is meant, review and --update.",
                got="nothing to compare" if check.worst is None else f"{check.worst:.3g}",
                expected=f"at most {check.bound:.3g}",
            )
            for check in failed
        ),
        inputs=(*opened.files, *(path for subject in subjects for path in subject.files)),
    )
