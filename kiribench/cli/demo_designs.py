"""The second half of ``kiribench demo``: from the strain of one subject to files for the laser."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from kiribench.cli.command import Common

if TYPE_CHECKING:
    from kiribench.dataset import Dataset
    from kiribench.report.sections.designs import DesignsSummary

#: In the order of the check page, whose first design is shown in full; the check itself adds
#: the best uniform sheet.
METHODS: tuple[Literal["worn", "balanced", "exact", "paper"], ...] = (
    "worn",
    "balanced",
    "exact",
    "paper",
)
TABLES = ("sheet.parquet", "cell.parquet")


def find_design_space(dataset: Path) -> Path | None:
    """The shipped table of sheets, or else of periodic cells; None where there is neither."""
    for name in TABLES:
        path = dataset / "design_space" / name
        if path.is_file():
            return path
    return None


def design_and_check(
    dataset: Dataset, participant: str, space: Path, out: Path, *, quiet: bool
) -> DesignsSummary:
    """Design one subject's patch by every method, check all on its knee, export the best.

    Calls the commands themselves, so that what it shows is what they do.

    Args:
        dataset: with the subject's two bare scans.
        participant: id of the subject.
        space: design space table.
        out: the demonstration's folder; files go to ``sub-ID/``.
        quiet: no progress bars.
    """
    from kiribench.cli.check import check
    from kiribench.cli.design import design
    from kiribench.cli.export import export
    from kiribench.cli.fit import Printing, fit
    from kiribench.report.sections.designs import DesignsSummary

    folder = out / f"sub-{participant}"
    surrogate = folder / "surrogate.safetensors"
    folder.mkdir(parents=True, exist_ok=True)
    fit(space, out=surrogate, common=Printing(quiet=quiet))
    designs: dict[str, Path] = {}
    for method in METHODS:
        place = folder / "designs" / method
        design(
            dataset.root,
            surrogate=surrogate,
            method=method,
            participant=(participant,),
            figures=method == "exact",
            common=Common(out=place, quiet=quiet),
        )
        designs[method] = place
    checked = check(
        tuple(designs.values()),
        subject=dataset.root,
        participant=participant,
        common=Common(out=folder / "check", quiet=quiet),
    )
    # The job sheet says how exactly to put the patch on, where the design's folder says it.
    found = folder / "check" / f"sub-{participant}_worn_placement.json"
    shutil.copyfile(found, designs["worn"] / "placement.json")
    files = folder / "laser"
    exported = export(designs["worn"], common=Common(out=files, quiet=quiet))
    links = {
        "Predicted conformability of the five designs": folder
        / "check"
        / f"sub-{participant}_check.html",
        "Targets, surrogate and cuts": designs["exact"] / "design.html",
        "Job sheet of the worn design": next(files.glob("*_job-sheet.html")),
        "Drawing of the worn design": next(files.glob("*_preview.svg")),
    }
    return DesignsSummary(
        participant=participant,
        space=space.name,
        designs=checked.result["designs"],
        verdict=str(checked.result["verdict"]),
        links={title: path.relative_to(out).as_posix() for title, path in links.items()},
        ready=bool(exported.result["passed"]),
    )
