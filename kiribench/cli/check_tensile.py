"""``kiribench check --reference tensile``: designs against a tensile test of the cut patch."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kiribench.cli.check_files import file_name
from kiribench.cli.command import Common, Outcome
from kiribench.errors import UsageError

if TYPE_CHECKING:
    from kiribench.schema.patch_design import PatchDesign
    from kiribench.tensile.result import TensileTest


def check_tensile(
    designs: list[PatchDesign], data: Path | None, common: Common, schema: str
) -> Outcome:
    """Compare every design with the test in ``data``.

    Raises:
        UsageError: ``check-no-tensile-data``.
    """
    from kiribench.reference.tensile import compare_tensile
    from kiribench.report.tensile_comparison_page import write_tensile_comparison

    if data is None:
        raise UsageError(
            "check-no-tensile-data",
            "A comparison with a tensile test needs the test.",
            remedy="Give its folder, as 'kiribench tensile' writes it or of its pictures, "
            "with --data.",
        )
    test = _tensile_test(data, common)
    found = [compare_tensile(one, test) for one in designs]
    if common.out is not None:
        used: set[str] = set()
        for one, comparison in zip(designs, found, strict=True):
            name = file_name(one.method, used)
            write_tensile_comparison(
                common.out / f"{name}_tensile.html", comparison, f"{name} and {data.name}"
            )
    return Outcome(
        result={
            "schema": schema,
            "reference": "tensile",
            "designs": [
                {"method": one.method, **comparison.result}
                for one, comparison in zip(designs, found, strict=True)
            ],
        },
        text="\n\n".join(
            f"Design '{one.method}'"
            + (f" ({one.file.name})" if one.file else "")
            + ":\n"
            + comparison.text
            for one, comparison in zip(designs, found, strict=True)
        ),
        faults=test.warnings,
        inputs=(*(one.file for one in designs if one.file is not None), *test.files),
    )


def _tensile_test(data: Path, common: Common) -> TensileTest:
    """The tables that ``kiribench tensile`` wrote, or the pictures, which are measured now."""
    from kiribench.cli.progress import progress
    from kiribench.tensile.measure import measure_frames
    from kiribench.tensile.sidecar import NAMES
    from kiribench.tensile.tables import CELLS_FILE, CURVE_FILE, read_tensile

    tables = (data / CELLS_FILE).is_file() or (data / CURVE_FILE).is_file()
    if tables or not any((data / name).is_file() for name in NAMES):
        return read_tensile(data)
    with progress("following", quiet=common.quiet) as advance:
        return measure_frames(data, progress=advance)
