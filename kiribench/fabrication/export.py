"""All files of a patch: drawn, written, read again, and only then put in their place."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from kiribench.errors import Fault
from kiribench.fabrication.drawing import Drawing
from kiribench.fabrication.dxf import write_dxf
from kiribench.fabrication.foam import draw_coupon, draw_foam, draw_template
from kiribench.fabrication.patch import PatchPlan, draw_patch
from kiribench.fabrication.profile import Profile
from kiribench.fabrication.svg import write_svg
from kiribench.fabrication.verify import Limits, Verification, verify_export

Kind = Literal["patch", "foam", "template", "coupon"]
KINDS: tuple[Kind, ...] = ("patch", "foam", "template", "coupon")

COUPON = "kerf-coupon"


@dataclass(frozen=True, eq=False)
class Export:
    """The files of a patch.

    Attributes:
        drawings: by kind.
        files: the files for the machine, in the order of the kinds, SVG before DXF; empty
            where a verification failed: a faulty file is not left where it could be cut.
        verifications: of every file, in the same order.
        faults: all that the readers found.
    """

    drawings: dict[Kind, Drawing]
    files: tuple[Path, ...]
    verifications: tuple[Verification, ...]
    faults: tuple[Fault, ...]

    @property
    def passed(self) -> bool:
        """Whether every file was read as it was drawn, and the sheet holds together."""
        return all(one.passed for one in self.verifications)


def stem(plan: PatchPlan) -> str:
    """``sub-ID``, or ``design`` without a subject."""
    return f"sub-{plan.design.participant}" if plan.design.participant else "design"


def draw(kind: Kind, plan: PatchPlan, profile: Profile) -> Drawing:
    """One of the drawings of a patch."""
    if kind == "coupon":
        return draw_coupon(COUPON, profile)
    name = f"{stem(plan)}_{'skin-template' if kind == 'template' else kind}"
    makers = {"patch": draw_patch, "foam": draw_foam, "template": draw_template}
    return makers[kind](plan, name, profile)


def export_patch(plan: PatchPlan, profile: Profile, limits: Limits, out: Path) -> Export:
    """Write every drawing as SVG and DXF, read them again, and keep them if all is well.

    Args:
        plan: the patch.
        profile: the machine.
        limits: what the files are held against.
        out: folder; files of an earlier export of the same name are replaced, or removed where
            the verification fails.
    """
    drawings = {kind: draw(kind, plan, profile) for kind in KINDS}
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out, prefix=".export-") as folder:
        written = list(_written(drawings, profile, Path(folder)))
        verifications = tuple(
            verify_export(path, drawings[kind], profile, limits, is_patch=kind == "patch")
            for kind, path in written
        )
        passed = all(one.passed for one in verifications)
        files = []
        for _, path in written:
            target = out / path.name
            target.unlink(missing_ok=True)
            if passed:
                files.append(path.rename(target))
    placed = tuple(
        Verification(
            out / v.file.name, v.readers, v.measured, tuple(_there(f, out) for f in v.faults)
        )
        for v in verifications
    )
    faults = tuple(dict.fromkeys(fault for one in placed for fault in one.faults))
    return Export(drawings, tuple(files), placed, faults)


def _there(fault: Fault, out: Path) -> Fault:
    """The fault with the file's final place."""
    if fault.file is None:
        return fault
    return Fault(
        fault.code,
        fault.what,
        fault.remedy,
        file=str(out / Path(fault.file).name),
        got=fault.got,
        expected=fault.expected,
        severity=fault.severity,
    )


def _written(
    drawings: dict[Kind, Drawing], profile: Profile, folder: Path
) -> Iterator[tuple[Kind, Path]]:
    for kind, drawing in drawings.items():
        for suffix, write in ((".svg", write_svg), (".dxf", write_dxf)):
            path = folder / f"{drawing.name}{suffix}"
            path.write_text(write(drawing, profile), encoding="utf-8", newline="\n")
            yield kind, path
