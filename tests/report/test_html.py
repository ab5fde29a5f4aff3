"""Nothing that comes from outside can become markup."""

from __future__ import annotations

from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kiribench.report.html import Html, bullets, table, tag, text


class Reader(HTMLParser):
    """Collects what a browser would see."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.words = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.words += data


def read(markup: str) -> Reader:
    reader = Reader()
    reader.feed(markup)
    reader.close()
    return reader


@given(st.text())
def test_text_comes_back_as_text(words: str) -> None:
    seen = read(tag("p", words))
    assert seen.tags == ["p"]
    assert seen.words.replace("\u00a0%", " %") == words.replace("\u00a0%", " %")


@given(st.text())
def test_attributes_come_back_as_attributes(words: str) -> None:
    seen = read(tag("p", "x", aria_label=words))
    assert seen.tags == ["p"]
    assert seen.attributes == [("aria-label", words)]


def test_markup_of_ours_is_kept_and_strings_are_not() -> None:
    assert tag("p", tag("b", "x"), "<b>") == "<p><b>x</b>&lt;b&gt;</p>"
    assert text(["a", None, 1, Html("<i>")]) == "a1<i>"


def test_an_html_string_that_is_changed_is_no_longer_trusted() -> None:
    joined = Html("<b>") + "<script>"
    assert not isinstance(joined, Html)
    assert text(joined) == "&lt;b&gt;&lt;script&gt;"


@pytest.mark.parametrize("name", ["p onload", "p>", "", "1"])
def test_a_bad_element_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="element name"):
        tag(name)


def test_a_bad_attribute_name_is_refused() -> None:
    with pytest.raises(ValueError, match="attribute name"):
        tag("p", **{'x="1" onclick': "1"})


def test_an_unknown_type_is_refused() -> None:
    with pytest.raises(TypeError, match="object"):
        tag("p", object())


def test_table_rows_have_heads_and_equal_length() -> None:
    made = table(("Cell", "Overlap"), [("a", 0.5)], caption="Cells", numeric=(1,))
    assert '<th scope="col">Cell</th>' in made
    assert '<th scope="row">a</th><td class="n">0.5</td>' in made
    with pytest.raises(ValueError, match="1 cells, the head 2"):
        table(("Cell", "Overlap"), [("a",)], caption="Cells")


def test_number_and_percent_sign_stay_together() -> None:
    assert tag("p", "91.7 % of") == "<p>91.7\u00a0% of</p>"
    assert bullets(["5 % x"]) == "<ul><li>5\u00a0% x</li></ul>"
