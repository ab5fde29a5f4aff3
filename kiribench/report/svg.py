"""Matplotlib figures as inline SVG: the same input gives the same bytes.

One unit of the drawing is one CSS pixel at natural size, so a font size of 10 is 10 px.
Text stays text (selectable, and set in the reader's own font, which is narrower than the
DejaVu Sans that the layout is measured with).
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from kiribench.report.html import Html, tag
from kiribench.report.palette import INK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_RC: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "kiribench",
    "svg.image_inline": True,
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    "text.usetex": False,
    "text.parse_math": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.unicode_minus": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "hatch.linewidth": 0.6,
    "path.simplify": True,
}
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


@contextmanager
def drawing() -> Iterator[None]:
    """Draw with the report's settings, whatever the user's matplotlibrc says."""
    import matplotlib as mpl
    from matplotlib.style import context

    with context("default"), mpl.rc_context(_RC):
        yield


def canvas(width_px: float, height_px: float) -> Figure:
    """An empty figure of the given natural size, without any global state."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_px / 72, height_px / 72), dpi=72, facecolor="none")
    FigureCanvasSVG(figure)
    return figure


def inline_svg(figure: Figure, name: str, alt: str) -> Html:
    """The figure as an ``<svg>`` element for an HTML page.

    Args:
        figure: from :func:`canvas`.
        name: unique on the page; it keeps the ids of several drawings apart.
        alt: what the drawing shows, for those who cannot see it.
    """
    if not re.fullmatch(r"[a-z][a-z0-9-]*", name):
        raise ValueError(f"{name!r} is no figure name (kebab case)")
    buffer = io.StringIO()
    with warnings.catch_warnings():
        # The reader's fonts draw what DejaVu Sans lacks (labels in other scripts).
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA, dpi=144)
    raw = buffer.getvalue()
    body = raw[raw.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r"<defs>\s*<style.*?</style>\s*</defs>\s*", "", body, flags=re.DOTALL)
    body = re.sub(r"<!--.*?-->\s*", "", body, flags=re.DOTALL)
    used = set(re.findall(r"url\(#([^)]+)\)", body)) | set(re.findall(r'href="#([^"]+)"', body))
    body = re.sub(
        r' id="([^"]*)"',
        lambda match: f' id="{name}-{match[1]}"' if match[1] in used else "",
        body,
    )
    body = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", body)
    body = re.sub(r'href="#([^"]+)"', rf'href="#{name}-\1"', body)
    # A hundredth of a pixel is enough; text is left alone.
    body = re.sub(r' (d|x|y)="[^"]*"', lambda match: re.sub(r"(\.\d{2})\d+", r"\1", match[0]), body)
    _head, _, inside = body.partition(">")
    width, height = (72 * inches for inches in figure.get_size_inches())
    shell = tag(
        "svg",
        Html("\n"),
        xmlns="http://www.w3.org/2000/svg",
        viewBox=f"0 0 {width:g} {height:g}",
        width=f"{width:g}",
        height=f"{height:g}",
        role="img",
        aria_label=alt,
    )
    start = shell[: shell.index(">") + 1]
    return Html(start.replace("<svg ", '<svg xmlns:xlink="http://www.w3.org/1999/xlink" ') + inside)


def figure_block(drawing_html: Html, caption: object, *, class_: str = "") -> Html:
    """A drawing with its caption, which says how to read it."""
    return tag(
        "figure",
        tag("div", drawing_html, class_="plot"),
        tag("figcaption", caption),
        class_=class_ or None,
    )
