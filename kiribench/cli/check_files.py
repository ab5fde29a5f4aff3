"""The files of ``kiribench check``: a table and a placement for each design, and the page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kiribench.reference.check import CheckedDesign
    from kiribench.reference.placement import Placement


def write_files(
    out: Path,
    checked: list[CheckedDesign],
    tolerances: list[Placement | None],
    objects: list[dict[str, Any]],
    *,
    synthetic: bool,
    note: str | None,
) -> None:
    """Write all of them into the folder ``out``; ``placement.json`` is the first design's."""
    from kiribench.reference.export import check_rows, check_sidecar
    from kiribench.report.check_page import write_check_page
    from kiribench.schema.result_tables import write_table

    who = checked[0].design.participant
    stem = f"sub-{who}_" if who else ""
    used: set[str] = set()
    for one, content in zip(checked, objects, strict=True):
        name = file_name(one.design.method, used)
        write_table(out / f"{stem}{name}_check.tsv", check_rows(one), check_sidecar(one))
        if "placement" in content:
            path = out / f"{stem}{name}_placement.json"
            path.write_text(json.dumps(content["placement"], indent=2) + "\n", encoding="utf-8")
    if "placement" in objects[0]:
        first = json.dumps(objects[0]["placement"], indent=2) + "\n"
        (out / "placement.json").write_text(first, encoding="utf-8")
    page = out / f"{stem}check.html"
    write_check_page(page, checked, tolerances, synthetic=synthetic, note=note)


def file_name(method: str, used: set[str]) -> str:
    """A method as part of a file name that is not among those used; it is added to them."""
    plain = "".join(letter if letter.isalnum() else "-" for letter in method.lower()) or "given"
    name, count = plain, 2
    while name in used:
        name, count = f"{plain}-{count}", count + 1
    used.add(name)
    return name
