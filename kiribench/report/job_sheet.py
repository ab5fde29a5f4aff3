"""The job sheet: one printable page for the person at the laser."""

from __future__ import annotations

from collections.abc import Sequence

from kiribench.errors import Fault
from kiribench.fabrication.export import Export
from kiribench.fabrication.patch import PatchPlan
from kiribench.fabrication.placement import Placement
from kiribench.fabrication.preview import draw_preview
from kiribench.fabrication.profile import Profile
from kiribench.fabrication.verify import Limits
from kiribench.fabrication.work import Work, work_of
from kiribench.report.html import Html, bullets, paragraphs, table, tag, text
from kiribench.report.page import document

_PICTURES = (("patch", "Patch, outer face"), ("foam", "Foam"), ("template", "Skin template"))


def job_sheet(
    plan: PatchPlan,
    profile: Profile,
    export: Export,
    limits: Limits,
    *,
    kerf_known: bool,
    warnings: Sequence[Fault],
    placement: Placement | None,
) -> str:
    """The whole HTML document; the same input gives the same text.

    Args:
        plan: the patch.
        profile: the machine.
        export: its files and what the readers found in them.
        limits: that they were held against.
        kerf_known: whether a kerf was given.
        warnings: of the plan and of the work.
        placement: tolerance from ``kiribench check``, None where there is none.
    """
    design = plan.design
    rows, columns = design.shape
    lateral = "right" if plan.mirrored else "left"
    who = f"sub-{design.participant}" if design.participant else "a design without a subject"
    body = tag(
        "main",
        tag("style", Html(_STYLE)),
        tag("h1", f"Job sheet: {who}, {design.side or 'side not stated'}"),
        tag(
            "p",
            f"{rows} × {columns} cells of {design.cell_mm:g} mm, method {design.method}, sheet "
            f"{design.thickness_mm:g} mm thick, {len(plan.slits)} slits "
            f"({int(plan.slits.notch.sum())} of them notches), for {profile.title}. The drawing "
            f"shows the outer face: lateral on the {lateral}, proximal on top.",
        ),
        _verdict(export, limits, kerf_known),
        _warnings([*warnings, *[f for f in export.faults if f.severity == "warning"]]),
        _pictures(export),
        tag("h2", "Files"),
        _files(export, profile),
        tag("h2", "Layers, in the order of work"),
        _layers(profile),
        bullets(profile.notes) if profile.notes else None,
        _paper(profile),
        tag("h2", "Place on the skin"),
        _place(plan, placement),
        tag("h2", "Kerf coupon"),
        _coupon(),
    )
    return document(f"Job sheet {who}", body)


def _verdict(export: Export, limits: Limits, kerf_known: bool) -> Html:
    errors = [fault for fault in export.faults if fault.severity == "error"]
    patch = export.verifications[0].measured
    if errors:
        return tag(
            "div",
            tag("p", tag("strong", "Do not cut."), " The files failed their verification:"),
            bullets([f"[{fault.code}] {fault}" for fault in errors]),
            class_="stop",
        )
    readers = "ezdxf, svgelements and svgpathtools"
    narrow = patch.get("narrowest_ligament_mm")
    kerf = f"a kerf of {limits.kerf_mm:g} mm" if kerf_known else "no kerf (none was given)"
    sentence = (
        f"Read again by {readers}: counts, lengths and places agree within "
        f"{limits.tolerance_mm:g} mm. With {kerf} the patch is one piece without crossings or "
        "doubles"
    )
    if narrow is not None:
        sentence += (
            f"; its narrowest ligament is {narrow:.2f} mm (at least {limits.ligament_mm:g} mm)"
        )
    return tag("p", tag("strong", "Ready to cut. "), f"{sentence}.", class_="go")


def _warnings(warnings: Sequence[Fault]) -> Html | None:
    if not warnings:
        return None
    shown = [f"{fault.what} {fault.remedy}" for fault in dict.fromkeys(warnings)]
    return tag("section", tag("h2", "Know before cutting"), bullets(shown))


def _pictures(export: Export) -> Html:
    figures = [
        tag(
            "figure",
            Html(draw_preview(export.drawings[kind], standalone=False)),  # type: ignore[index]
            tag("figcaption", caption),
        )
        for kind, caption in _PICTURES
    ]
    return tag("div", figures, class_="pictures")


def _files(export: Export, profile: Profile) -> Html:
    rows = [_work_row(work_of(drawing, profile)) for drawing in export.drawings.values()]
    head = ("file (.svg, .dxf)", "cuts", "cut (m)", "marked (m)", "travel (m)", "time")
    known = profile.cut_mm_s is not None and profile.travel_mm_s is not None
    note = (
        "Time at the profile's speeds, without acceleration and pauses."
        if known
        else "No time: the machine profile states no speeds (cut_mm_s, mark_mm_s, travel_mm_s)."
    )
    return table(
        head,
        rows,
        caption=f"Lengths of what is cut through, of what is marked, and of the head's way "
        f"with the beam off. {note}",
        numeric=(1, 2, 3, 4, 5),
    )


def _work_row(work: Work) -> tuple[object, ...]:
    if work.seconds is None:
        time = "not known"
    elif work.seconds < 120:
        time = f"{work.seconds:.0f} s"
    else:
        time = f"{work.seconds / 60:.1f} min"
    lengths = (f"{mm / 1000:.2f}" for mm in (work.cut_mm, work.marked_mm, work.travel_mm))
    return (work.name, work.cuts, *lengths, time)


def _layers(profile: Profile) -> Html:
    names = {"slit": "slits", "tile": "foam tiles", "slot": "strap windows, holes"}
    names |= {"info": "text beside the part", "label": "label", "fiducial": "registration marks"}
    rows = [
        (
            layer.name,
            text(
                [
                    Html(
                        '<svg class="swatch" viewBox="0 0 10 10"><rect width="10" height="10" '
                        f'fill="{layer.colour}"/></svg> '
                    ),
                    layer.colour,
                ]
            ),
            layer.aci,
            ", ".join(names.get(role, role) for role in layer.roles),
            layer.work,
        )
        for layer in profile.layers
    ]
    head = ("layer", "colour", "DXF colour", "holds", "work")
    return table(head, rows, caption="One layer and one colour a kind of work.", numeric=(2,))


def _paper(profile: Profile) -> Html | None:
    if not profile.paper_settings:
        return None
    settings = ", ".join(f"{name} {value}" for name, value in profile.paper_settings.items())
    return tag("p", f"For the record, not a recommendation, settings of a publication: {settings}.")


def _place(plan: PatchPlan, placement: Placement | None) -> Html:
    cell = plan.design.cell_mm
    parts: list[Html] = []
    if len(plan.fiducials_mm):
        rows = [
            (k + 1, f"{x:.2f}", f"{y:.2f}", f"{x / cell:.2f}", f"{y / cell:.2f}")
            for k, (x, y) in enumerate(plan.fiducials_mm)
        ]
        head = ("cross", "across (mm)", "along (mm)", "across (cells)", "along (cells)")
        parts.append(
            table(
                head,
                rows,
                caption="Crosses on patch, foam and template, from the patch's lateral and "
                "proximal edge. Mark the skin through the template's holes in the straight "
                "pose, its edge ticks on the drawn grid; each notch of the long edges lies on a "
                "drawn line, each tick of the ends on a grid node.",
                numeric=(0, 1, 2, 3, 4),
            )
        )
    if placement is None:
        parts.append(
            tag("p", "Placement tolerance: not known. kiribench check computes it from the design.")
        )
    else:
        goal = "" if placement.share is None else f" ({placement.share:.0%} of the cells kept)"
        parts.append(
            table(
                ("patch", "tolerated"),
                placement.allowed,
                caption=f"Placement tolerance, predicted by kiribench check{goal}.",
            )
        )
    return text(parts)


def _coupon() -> Html:
    lines = paragraphs(
        [
            "Cut the coupon in the same material with the same settings. It is not compensated.",
            "Left: facing slits whose paths end 0.05, 0.10, ... mm apart. The beam burns half a "
            "kerf beyond each end: bend the coupon, the kerf lies between the last gap that is "
            "cut through and the first that holds.",
            "Right: slits whose paths are 5, 10 and 20 mm long. Measure them under a loupe or in "
            "a scan; the kerf is the mean of measured length less path.",
        ]
    )
    blank = "\u00a0" * 14
    form = table(
        ("read", "1", "2", "3"),
        [
            ("last gap cut through (mm)", blank, blank, blank),
            ("first gap that holds (mm)", blank, blank, blank),
            ("5 mm slits measure (mm)", blank, blank, blank),
            ("10 mm slits measure (mm)", blank, blank, blank),
            ("20 mm slits measure (mm)", blank, blank, blank),
            ("kerf (mm), for --kerf-mm", blank, blank, blank),
        ],
        caption="To be filled in.",
    )
    return text([lines, form])


_STYLE = """
.pictures { display: flex; flex-wrap: wrap; gap: 1rem; align-items: flex-start; }
main > h2 { margin-top: 1.6rem; }
.pictures figure { margin: 0; flex: 1 1 14rem; max-width: 20rem; }
.pictures svg { width: 100%; height: auto; border: 1px solid #ccc; }
.swatch { width: .8em; height: .8em; vertical-align: -.05em; border: 1px solid #666; }
.go, .stop { padding: .6rem .9rem; border-left: .4rem solid #2a7f62; background: #eef6f2; }
.stop { border-color: #b3001b; background: #fbecee; }
@media print { h2 { break-after: avoid; } .table, figure { break-inside: avoid; } }
"""
