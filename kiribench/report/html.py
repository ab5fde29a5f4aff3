"""HTML that cannot be injected: every string is escaped unless it was built here.

A plain ``str`` that enters an element is text and is escaped. Only :class:`Html`, which
the functions of this module give, is taken as markup. The page is put together from these
functions alone, so a participant id such as ``<script>`` stays text wherever it turns up.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence

_VOID = frozenset({"meta", "br", "hr", "img", "col", "wbr"})
_PERCENT = re.compile(r"(\d) %")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9-]*")


class Html(str):
    """A string that is markup already, and therefore safe to put into a page."""

    __slots__ = ()


def text(content: object) -> Html:
    """``content`` as escaped markup; nested lists are joined, ``None`` is nothing."""
    if content is None:
        return Html("")
    if isinstance(content, Html):
        return content
    if isinstance(content, (str, int, float)):
        return Html(_escape(str(content)))
    if isinstance(content, Iterable):
        return Html("".join(text(item) for item in content))
    raise TypeError(f"cannot put {type(content).__name__} into a page")


def _escape(words: str) -> str:
    # A number and its percent sign stay on one line.
    return _PERCENT.sub("\\1\u00a0%", html.escape(words, quote=True))


def tag(name: str, /, *content: object, **attributes: str | int | None) -> Html:
    """One element ``<name ...>content</name>`` with escaped text and attributes.

    Args:
        name: the element's name.
        content: text (escaped), :class:`Html`, or lists of these.
        attributes: ``class_`` becomes ``class``, ``aria_label`` becomes ``aria-label``;
            ``None`` leaves the attribute out.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no element name")
    head = name
    for key, value in attributes.items():
        if value is None:
            continue
        shown = key.rstrip("_").replace("_", "-")
        if not _NAME.fullmatch(shown):
            raise ValueError(f"{key!r} is no attribute name")
        head += f' {shown}="{html.escape(str(value), quote=True)}"'
    if name in _VOID:
        return Html(f"<{head}>")
    return Html(f"<{head}>{text(content)}</{name}>")


def table(
    head: Sequence[object],
    rows: Iterable[Sequence[object]],
    *,
    caption: str,
    numeric: Sequence[int] = (),
    class_: str | None = None,
) -> Html:
    """A data table with a caption and column heads that screen readers announce.

    Args:
        head: the column heads.
        rows: one sequence of cells a row, as long as ``head``; the first is the row's head.
        caption: what the table holds, and the units.
        numeric: indices of the columns that are set flush right.
        class_: CSS classes of the table.
    """
    right = frozenset(numeric)

    def kind(column: int) -> str | None:
        return "n" if column in right else None

    body = []
    for row in rows:
        cells = [
            tag("th", cell, scope="row", class_=kind(column))
            if column == 0
            else tag("td", cell, class_=kind(column))
            for column, cell in enumerate(row)
        ]
        if len(cells) != len(head):
            raise ValueError(f"a row has {len(cells)} cells, the head {len(head)}")
        body.append(tag("tr", cells))
    heads = [tag("th", cell, scope="col", class_=kind(i)) for i, cell in enumerate(head)]
    return tag(
        "div",
        tag("p", caption, class_="caption"),
        tag(
            "div",
            tag(
                "table",
                tag("thead", tag("tr", heads)),
                tag("tbody", body),
                class_=class_,
                aria_label=caption,
            ),
            class_="scroll",
            tabindex=0,
            role="region",
            aria_label=caption,
        ),
        class_="table",
    )


def paragraphs(sentences: Iterable[str]) -> Html:
    """One ``<p>`` a string."""
    return text([tag("p", sentence) for sentence in sentences])


def bullets(items: Iterable[object]) -> Html:
    """An unordered list."""
    return tag("ul", [tag("li", item) for item in items])
