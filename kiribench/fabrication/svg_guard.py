"""A first look into an SVG file from outside, before any library may read it.

One pass of expat without building a tree: it stops at the first entity, at nesting and sizes
that no drawing needs, and at references that multiply (a ``use`` of a ``use`` of ...). What is
let through declares no entities, refers to nothing outside and is of bounded size.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from kiribench.errors import DataError

MOST_BYTES = 50_000_000
MOST_ELEMENTS = 200_000
DEEPEST = 60

_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Z%]*)\s*")
_TRANSFORM = re.compile(r"(^|;|\{)(transform|translate|rotate|scale|zoom):")
MM_PER_UNIT = {
    "": 25.4 / 96,
    "px": 25.4 / 96,
    "pt": 25.4 / 72,
    "pc": 25.4 / 6,
    "mm": 1.0,
    "cm": 10.0,
    "in": 25.4,
    "q": 0.25,
}
"""Units of CSS, mm; a number without unit is in pixels of 1/96 inch."""


@dataclass(frozen=True)
class SvgHead:
    """What an SVG says about itself.

    Attributes:
        width, height: number and unit as written, None where absent or not a length.
        view_box: the four numbers, None where absent or not four numbers.
        elements: how often each element occurs, by its name without namespace.
        hidden: number of elements that are switched off (display or visibility).
        keeps_ratio: whether the drawing keeps its ratio where the page has another one.
        styled: number of transforms in styles, which only browsers follow.
    """

    width: tuple[float, str] | None
    height: tuple[float, str] | None
    view_box: tuple[float, float, float, float] | None
    elements: Counter[str] = field(default_factory=Counter)
    hidden: int = 0
    keeps_ratio: bool = True
    styled: int = 0

    @property
    def mm_per_unit(self) -> tuple[float, float] | None:
        """(2,) mm a user unit across and down, None where the file does not say."""
        if self.view_box is None:
            return (MM_PER_UNIT[""], MM_PER_UNIT[""])
        sides = (self.width, self.height)
        if any(s is None or s[1].lower() not in MM_PER_UNIT for s in sides):
            return None
        scale = [
            side[0] * MM_PER_UNIT[side[1].lower()] / extent
            for side, extent in zip(sides, self.view_box[2:], strict=True)
            if side is not None
        ]
        return scale[0], scale[1]

    @property
    def placed_mm(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Scale (2,) and offset (2,) of the viewBox on the page, mm, by the rules of SVG.

        The default keeps the ratio and centres; pixels where the file says nothing.
        """
        scale = self.mm_per_unit or (MM_PER_UNIT["px"],) * 2
        if not self.keeps_ratio or self.view_box is None:
            return scale, (0.0, 0.0)
        small = min(scale)
        sides = [small * side for side in self.view_box[2:]]
        off = [(large * side / small - side) / 2 for large, side in zip(scale, sides, strict=True)]
        return (small, small), (off[0], off[1])


def look_into(data: bytes, *, file: Path) -> SvgHead:
    """Refuse what no reader should be given; else what the file says about itself.

    Raises:
        DataError: ``svg-too-large``, ``svg-entities``, ``svg-syntax`` (truncated, not XML),
            ``svg-not-svg``, ``svg-references``; the message names the line.
    """
    if len(data) > MOST_BYTES:
        raise _refused("svg-too-large", "The file is larger than any drawing here.", file, None)
    scan = _Scan(file)
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler = lambda tag, attributes: scan.begin(tag, attributes, parser)
    parser.EndElementHandler = lambda tag: scan.end()
    parser.CharacterDataHandler = lambda words: scan.read_style(words)
    parser.EntityDeclHandler = lambda *_: scan.refuse_entities(parser)
    parser.StartDoctypeDeclHandler = lambda name, system, public, internal: (
        scan.refuse_entities(parser) if internal else None
    )
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        raise _refused(
            "svg-syntax",
            f"The file is not whole XML: {expat.errors.messages[error.code]}.",
            file,
            error.lineno,
            "Export the drawing again; the file may have been cut off.",
        ) from error
    except (UnicodeError, LookupError, ValueError) as error:
        raise _refused(
            "svg-syntax",
            "The file is not text in the encoding that it states.",
            file,
            None,
            "Save it as UTF-8.",
        ) from error
    if scan.head is None:
        raise _refused("svg-not-svg", "The file is XML, but no SVG drawing.", file, None)
    _bounded_references(scan, file)
    return SvgHead(
        *scan.head,
        elements=scan.elements,
        hidden=scan.hidden,
        keeps_ratio=scan.keeps_ratio,
        styled=scan.styled,
    )


def _refused(
    code: str, what: str, file: Path, row: int | None, remedy: str | None = None
) -> DataError:
    return DataError(
        code,
        what,
        remedy=remedy or "Save the drawing as plain SVG, with nothing but its paths.",
        file=file,
        row=row,
    )


class _Scan:
    """What the pass over the elements collects."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.head: (
            tuple[
                tuple[float, str] | None,
                tuple[float, str] | None,
                tuple[float, float, float, float] | None,
            ]
            | None
        ) = None
        self.elements: Counter[str] = Counter()
        self.hidden = 0
        self.keeps_ratio = True
        self.styled = 0
        self.in_style = False
        self.open: list[str | None] = []
        # For every id the ids that it uses inside, and how many elements it holds.
        self.uses: dict[str | None, list[str]] = {}
        self.size: Counter[str | None] = Counter()

    def begin(self, tag: str, attributes: dict[str, str], parser: expat.XMLParserType) -> None:
        name = tag.rpartition(" ")[2].lower()
        self.elements[name] += 1
        self.in_style = name == "style"
        if len(self.open) >= DEEPEST or self.elements.total() > MOST_ELEMENTS:
            raise _refused(
                "svg-too-large",
                "The file holds more elements, or deeper nested ones, than any drawing here.",
                self.file,
                parser.CurrentLineNumber,
            )
        plain = {key.rpartition(" ")[2]: value for key, value in attributes.items()}
        if not self.open:
            if name != "svg":
                raise _refused("svg-not-svg", "The file is XML, but no SVG drawing.", self.file, 1)
            self.head = (
                _length(plain.get("width")),
                _length(plain.get("height")),
                _view_box(plain.get("viewBox")),
            )
            self.keeps_ratio = plain.get("preserveAspectRatio", "").strip() != "none"
        style = plain.get("style", "").replace(" ", "").lower()
        if (
            plain.get("display") == "none"
            or plain.get("visibility") in ("hidden", "collapse")
            or "display:none" in style
            or "visibility:hidden" in style
        ):
            self.hidden += 1
        self.styled += bool(_TRANSFORM.search(style))
        owner = plain.get("id")
        for holder in {*self.open, owner} - {None}:
            self.size[holder] += 1
        self.size[None] += 1
        self.open.append(owner)
        target = plain.get("href", "")
        if name == "use" and target:
            if not target.startswith("#"):
                raise _refused(
                    "svg-references",
                    "The file refers to something outside of it.",
                    self.file,
                    parser.CurrentLineNumber,
                )
            for holder in {*self.open, None}:
                self.uses.setdefault(holder, []).append(target[1:])

    def end(self) -> None:
        self.open.pop()
        self.in_style = False

    def read_style(self, words: str) -> None:
        """The text of a style sheet."""
        if self.in_style:
            self.styled += bool(_TRANSFORM.search("".join(words.lower().split())))

    def refuse_entities(self, parser: expat.XMLParserType) -> None:
        raise _refused(
            "svg-entities",
            "The file declares entities, which can hide or multiply its content.",
            self.file,
            parser.CurrentLineNumber,
            "Save the drawing as plain SVG (in Illustrator without 'preserve editing').",
        )


def _bounded_references(scan: _Scan, file: Path) -> None:
    """Refuse references that go in circles or multiply."""
    known: dict[str | None, int] = {}

    def weight(owner: str | None, above: frozenset[str | None]) -> int:
        if owner in above or len(above) > DEEPEST:
            raise _refused(
                "svg-references", "Elements refer to each other in a circle.", file, None
            )
        if owner not in known:
            inside = above | {owner}
            total = scan.size[owner]
            for target in scan.uses.get(owner, ()):
                total += weight(target, inside)
                if total > MOST_ELEMENTS:
                    raise _refused(
                        "svg-references", "References multiply beyond any drawing.", file, None
                    )
            known[owner] = total
        return known[owner]

    weight(None, frozenset())


def _length(words: str | None) -> tuple[float, str] | None:
    match = _LENGTH.fullmatch(words or "")
    if match is None or not 0 < float(match[1]) < 1e9:
        return None
    return float(match[1]), match[2]


def _view_box(words: str | None) -> tuple[float, float, float, float] | None:
    numbers = []
    for word in re.split(r"[\s,]+", (words or "").strip()):
        match = _LENGTH.fullmatch(word)
        if match is None or match[2]:
            return None
        numbers.append(float(match[1]))
    if len(numbers) != 4 or not all(0 < side < 1e9 for side in numbers[2:]):
        return None
    return numbers[0], numbers[1], numbers[2], numbers[3]
