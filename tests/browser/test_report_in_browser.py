"""The report in headless Chromium: no network, no scripts needed, nothing clipped."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("browser")]

Opener = Callable[..., tuple[Any, Any]]

SECTIONS = ["verdict", "fit", "definitions", "worst", "space", "skin", "paper", "methods",
            "provenance", "cells"]  # fmt: skip

#: Text of a drawing that lies outside of it or on other text, in pixels of overlap.
MESSY_TEXT = """
() => {
  const found = [];
  for (const svg of document.querySelectorAll("figure svg")) {
    const frame = svg.getBoundingClientRect();
    const boxes = [...svg.querySelectorAll("text")].map((node) => {
      const box = node.getBoundingClientRect();
      return {words: node.textContent, box};
    });
    for (const {words, box} of boxes) {
      if (box.left < frame.left - 1 || box.right > frame.right + 1 ||
          box.top < frame.top - 1 || box.bottom > frame.bottom + 1) found.push("out: " + words);
    }
    for (let i = 0; i < boxes.length; i++) for (let j = i + 1; j < boxes.length; j++) {
      const a = boxes[i].box, b = boxes[j].box;
      const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      // Line boxes are taller than letters: a third of the height may touch.
      if (across > 1 && down > 0.34 * Math.min(a.height, b.height))
        found.push("on: " + boxes[i].words + " | " + boxes[j].words);
    }
  }
  return found;
}
"""

SMALL_TEXT = """
() => [...document.querySelectorAll("figure svg")].flatMap((svg) => {
  const scale = svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
  return [...svg.querySelectorAll("text")].map((node) =>
    ({words: node.textContent, size: scale * parseFloat(getComputedStyle(node).fontSize)}));
}).filter((item) => item.size < LIMIT)
"""


@pytest.fixture
def subject(pages: Path) -> Path:
    return pages / "sub-S1.html"


def test_everything_but_the_turning_view_is_there_without_scripts(
    open_page: Opener, subject: Path
) -> None:
    page, watch = open_page(subject, scripts=False)
    for name in SECTIONS:
        assert page.locator(f"#{name} h2").is_visible(), name
    figures = page.locator("figure")
    assert figures.count() == 16
    for index in range(16):
        assert figures.nth(index).locator("svg").is_visible()
        assert figures.nth(index).locator("figcaption").is_visible()
    assert page.locator("#view-load").is_hidden()
    assert page.get_by_text("The turning view needs scripts").is_visible()
    details = page.locator("#cells details").first
    details.locator("summary").click()
    assert details.locator("tbody tr").count() == 72
    assert details.locator("tbody tr").first.is_visible()
    assert len(watch.requests) == 1


def test_a_click_loads_the_turning_view(open_page: Opener, subject: Path) -> None:
    page, watch = open_page(subject)
    assert page.evaluate("typeof window.Plotly") == "undefined"
    assert page.locator("#knee-3d").is_hidden()
    page.click("#view-load")
    page.wait_for_selector("#knee-3d[data-ready=yes] canvas", timeout=60_000)
    page.wait_for_timeout(500)
    names = page.evaluate("document.getElementById('knee-3d')._fullData.map(trace => trace.name)")
    assert names[:2] == ["skin", "skin cells"]
    # The gl canvas is not blank: pixels of several colours are drawn.
    import io

    from PIL import Image

    shot = Image.open(io.BytesIO(page.locator("#knee-3d").screenshot())).convert("RGB")
    colours = shot.resize((120, 120), Image.Resampling.NEAREST).getcolors(120 * 120)
    assert colours is not None
    assert len(colours) > 20
    blue = sum(n for n, (r, g, b) in colours if b > r + 60)
    yellow = sum(n for n, (r, g, b) in colours if r > b + 100 and g > b + 60)
    assert blue > 20
    assert yellow > 20
    assert page.locator("#view-load").is_hidden()
    watch.check()


def test_without_webgl_the_view_says_so(pages: Path, chromium: Any) -> None:
    context = chromium.new_context(offline=True)
    page = context.new_page()
    page.add_init_script("delete window.DecompressionStream")
    page.goto((pages / "sub-S1.html").as_uri())
    page.click("#view-load")
    page.get_by_text("This browser cannot show the 3-D view").wait_for()
    assert page.locator("#view-load").is_enabled()
    context.close()


@pytest.mark.parametrize("width", [400, 768, 1400])
@pytest.mark.parametrize("name", ["sub-S1.html", "index.html"])
def test_no_page_is_wider_than_its_window(
    open_page: Opener, pages: Path, name: str, width: int
) -> None:
    page, _ = open_page(pages / name, width=width)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize("width", [400, 1400])
def test_the_words_of_the_drawings_are_whole_apart_and_large_enough(
    open_page: Opener, pages: Path, width: int
) -> None:
    for path in sorted(pages.glob("*.html")):
        page, _ = open_page(path, width=width)
        assert page.evaluate(MESSY_TEXT) == []
        limit = 7.0 if width == 400 else 8.5
        assert page.evaluate(SMALL_TEXT.replace("LIMIT", str(limit))) == []


def test_a_hostile_id_is_shown_as_text(open_page: Opener, pages: Path) -> None:
    page, _ = open_page(pages / "index.html")
    page.locator("table a", has_text="<b>S2</b>").click()
    assert page.locator("h1").inner_text().startswith("<b>S2</b>")
    assert page.locator("h1 b").count() == 0


def test_every_link_of_the_index_opens_a_page(open_page: Opener, pages: Path) -> None:
    page, _ = open_page(pages / "index.html")
    links = page.eval_on_selector_all("a", "nodes => nodes.map(node => node.href)")
    assert len(links) == 2 * 3
    for link in links:
        page.goto(link)
        assert page.locator("#verdict").is_visible()


def test_it_prints(open_page: Opener, subject: Path) -> None:
    page, _ = open_page(subject)
    data = page.pdf(format="A4")
    assert data.startswith(b"%PDF")
    page.emulate_media(media="print")
    assert page.locator("nav").is_hidden()
    assert page.locator("#view-load").is_hidden()
    assert page.locator("figure svg").first.is_visible()


def test_the_policy_stops_scripts_that_are_not_ours(
    chromium: Any, pages: Path, tmp_path: Path
) -> None:
    page_text = (pages / "sub-S1.html").read_text(encoding="utf-8")
    attacked = page_text.replace("</main>", "</main><script>document.title='bad'</script>")
    assert attacked != page_text
    path = tmp_path / "attacked.html"
    path.write_text(attacked, encoding="utf-8")
    context = chromium.new_context(offline=True)
    page = context.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.goto(path.as_uri())
    assert page.title() != "bad"
    assert any("Content Security Policy" in words for words in complaints)
    context.close()
