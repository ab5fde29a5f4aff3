"""SVG files that no library should be given."""

from __future__ import annotations

from pathlib import Path

import pytest

from kiribench.errors import DataError
from kiribench.fabrication.reading import read_drawing
from kiribench.fabrication.svg_guard import DEEPEST, look_into

OPEN = '<svg xmlns="http://www.w3.org/2000/svg" width="10mm" height="10mm" viewBox="0 0 10 10">'
XLINK = OPEN.replace("<svg", '<svg xmlns:xlink="http://www.w3.org/1999/xlink"')
LINE = '<path d="M0 0L1 1" stroke="red"/>'

LAUGHS = "".join(
    f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' if k else '<!ENTITY l0 "ha">' for k in range(9)
)
USES = "".join(
    f'<g id="u{k}">' + f'<use xlink:href="#u{k - 1}"/>' * 10 + "</g>"
    if k
    else f'<g id="u0">{LINE}</g>'
    for k in range(9)
)

BAD = {
    "svg-syntax": [
        f"{OPEN}{LINE}",
        f"{OPEN}<path d='M0 0L1 1></svg>",
        "not xml at all",
        "",
        '<?xml version="1.0" encoding="nonsense"?>' + f"{OPEN}{LINE}</svg>",
    ],
    "svg-not-svg": ["<html><body/></html>"],
    "svg-entities": [
        f"<!DOCTYPE svg [{LAUGHS}]>{OPEN}<title>&l8;</title></svg>",
        f'<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>{OPEN}<title>&x;</title></svg>',
    ],
    "svg-references": [
        f"{XLINK}<defs>{USES}</defs><use xlink:href='#u8'/></svg>",
        f"{XLINK}<g id='a'><use xlink:href='#b'/></g><g id='b'><use xlink:href='#a'/></g></svg>",
        f"{XLINK}<g id='a'><use xlink:href='#a'/></g></svg>",
        f"{XLINK}<use xlink:href='https://example.org/x.svg#a'/></svg>",
    ],
    "svg-too-large": [f"{OPEN}{'<g>' * (DEEPEST + 1)}{'</g>' * (DEEPEST + 1)}</svg>"],
}


@pytest.mark.parametrize(("code", "text"), [(code, t) for code, many in BAD.items() for t in many])
def test_refused_by_name(tmp_path, code, text):
    path = tmp_path / "bad.svg"
    path.write_text(text)
    with pytest.raises(DataError) as caught:
        read_drawing(path)
    assert caught.value.code == code
    assert caught.value.faults[0].remedy


def test_a_doctype_without_entities_is_harmless():
    doctype = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/x.dtd">'
    head = look_into(f"{doctype}{OPEN}{LINE}</svg>".encode(), file=Path("a.svg"))
    assert head.mm_per_unit == (1.0, 1.0)


@pytest.mark.parametrize(
    ("size", "view", "mm"),
    [
        ('width="10mm" height="10mm"', "0 0 10 10", (1.0, 1.0)),
        ('width="1in" height="1in"', "0 0 25.4 25.4", (1.0, 1.0)),
        ('width="96px" height="96"', "0 0 25.4 25.4", (1.0, 1.0)),
        ('width="10mm" height="20mm"', "0,0,10,10", (1.0, 2.0)),
        ('width="100%" height="100%"', "0 0 10 10", None),
        ('width="-3mm" height="10mm"', "0 0 10 10", None),
        ('width="10mm" height="10mm"', "0 0 zero 10", (25.4 / 96, 25.4 / 96)),
    ],
)
def test_scale_that_the_file_states(size, view, mm):
    text = f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="{view}"/>'
    assert look_into(text.encode(), file=Path("a.svg")).mm_per_unit == (
        mm if mm is None else pytest.approx(mm)
    )
