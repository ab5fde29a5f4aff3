"""One self-contained HTML file of a tensile test: curves, overlays, what was corrected."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.report.figures.tensile import force_figure, poisson_figure, strain_figure
from kiribench.report.html import Html, bullets, table, tag, text
from kiribench.report.page import document
from kiribench.report.svg import figure_block
from kiribench.tensile.result import STATES, TensileTest

UInt8Array = NDArray[np.uint8]


def write_tensile_report(
    path: Path,
    test: TensileTest,
    drawn: Sequence[tuple[str, UInt8Array]],
    *,
    title: str,
    measure: str,
    min_strain: float,
) -> Path:
    """Write the page of a test.

    Args:
        path: the HTML file. test: as measured. drawn: name and overlay of some frames.
        title: of the page. measure: of all strains and ratios.
        min_strain: Poisson's ratio is left out below.

    Returns:
        ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    page = tensile_page(test, drawn, title=title, measure=measure, min_strain=min_strain)
    path.write_text(page, encoding="utf-8", newline="\n")
    return path


def tensile_page(
    test: TensileTest,
    drawn: Sequence[tuple[str, UInt8Array]],
    *,
    title: str,
    measure: str,
    min_strain: float,
) -> str:
    """The whole HTML document; the same test gives the same text."""
    sections = [
        _head(test, title, measure),
        _curves(test, measure, min_strain),
        _overlays(drawn),
        _states(test),
        _frames(test, measure, min_strain),
    ]
    return document("kiribench: tensile test", text([tag("main", sections)]))


def _head(test: TensileTest, title: str, measure: str) -> Html:
    later = test.measured[1:]
    lost = int(later.size - later.sum())
    furthest = float(np.nanmax(test.curve(measure).longitudinal_strain))
    verdict = (
        f"Every cell was measured in every frame; {measure} strain up to {furthest:.3f}."
        if not lost
        else f"{lost} of {later.size} readings of a cell were lost and are marked; {measure} "
        f"strain up to {furthest:.3f}."
    )
    scale = test.scale_mm_per_px
    notes = [
        *test.notes,
        f"Noise of the pictures: strain sd {test.strain_sd:.5f} for one cell.",
        None if scale is None else f"Scale: {scale:.5f} mm a pixel at the block's middle.",
        *(f"{fault.what} ({fault.got})" if fault.got else fault.what for fault in test.warnings),
    ]
    return tag(
        "header",
        tag("p", "Tensile test", class_="kicker"),
        tag("h1", f"{title}: {len(test.frame)} frames, {len(test.cell)} cells by {test.marker}"),
        tag("p", verdict, class_="verdict"),
        bullets([note for note in notes if note]),
    )


def _curves(test: TensileTest, measure: str, min_strain: float) -> Html:
    curve = test.curve(measure, min_strain)
    blocks = [
        figure_block(
            poisson_figure(curve, test.poisson(measure, min_strain), test.strain(measure)),
            f"Each grey point is one cell in one frame; the line is their mean, the band one "
            f"standard deviation over cells. Below a strain of {min_strain:g} the ratio is left "
            "out: noise divided by next to nothing.",
        ),
        figure_block(strain_figure(curve), "Mean over the measured cells; bands as above."),
    ]
    if np.isfinite(test.force_n).any():
        blocks.append(
            figure_block(
                force_figure(curve, test.force_n),
                "The machine's force over the strain that the camera saw in the cells: not the "
                "crosshead's.",
            )
        )
    return tag("section", tag("h2", "Curves"), blocks)


def _overlays(drawn: Sequence[tuple[str, UInt8Array]]) -> Html:
    blocks = [
        tag(
            "figure",
            tag(
                "img",
                src=f"data:image/jpeg;base64,{_jpeg(picture)}",
                alt=f"Frame {name} with the followed cells outlined",
                style="max-width:100%;max-height:32rem",
            ),
            tag("figcaption", name),
        )
        for name, picture in drawn
    ]
    return tag(
        "section",
        tag("h2", "What was followed"),
        tag(
            "p",
            "Blue outlines are the cells as they were found; a red cross marks a cell that was "
            "not, where it was last seen.",
        ),
        tag("div", blocks, style="display:flex;flex-wrap:wrap;gap:1rem;align-items:flex-end"),
    )


def _jpeg(picture: UInt8Array) -> str:
    import cv2

    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 80])
    return base64.b64encode(np.asarray(data).tobytes()).decode("ascii")


def _states(test: TensileTest) -> Html:
    rows = []
    for state, words in STATES.items():
        count = int((test.status[1:] == state).sum())
        if count:
            rows.append((state, words, f"{count}"))
    return tag(
        "section",
        tag("h2", "State of the readings"),
        table(("State", "Meaning", "Readings"), rows, caption="Cells times frames", numeric=(2,)),
    )


def _frames(test: TensileTest, measure: str, min_strain: float) -> Html:
    curve = test.curve(measure, min_strain)

    def show(value: float, digits: int = 4) -> str:
        return f"{value:.{digits}f}" if np.isfinite(value) else "n/a"

    rows = [
        (
            name,
            show(test.displacement_mm[n], 2),
            show(test.force_n[n], 3),
            show(curve.longitudinal_strain[n]),
            show(curve.lateral_strain[n]),
            show(curve.poisson_ratio[n], 3),
            show(curve.poisson_sd[n], 3),
            f"{curve.cells[n]}",
        )
        for n, name in enumerate(test.frame)
    ]
    return tag(
        "section",
        tag("h2", "Frames"),
        table(
            ("Frame", "Way, mm", "Force, N", "Longitudinal", "Lateral", "ν", "sd of ν", "Cells"),
            rows,
            caption=f"Means over cells, {measure} strain; way is the crosshead's",
            numeric=tuple(range(1, 8)),
        ),
    )
