"""A headless Chromium without network; the tests are skipped where it is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from report_cases import subject_case

CHROMIUM = Path("/usr/bin/chromium")
ARGUMENTS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
#: Chromium's own advice about reading a canvas back; nothing is wrong.
ADVICE = "willReadFrequently"


@pytest.fixture(scope="session")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an index and the pages of a right and of a left leg."""
    from kiribench.report import report_name, write_index, write_subject_report

    folder = tmp_path_factory.mktemp("report")
    cases = [subject_case("S1"), subject_case("<b>S2</b>", side="left", synthetic=False)]
    for case in cases:
        write_subject_report(folder / report_name(case.participant), case)
    write_index(folder / "index.html", cases)
    return folder


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """The browser."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"Debian's chromium is not installed at {CHROMIUM}")
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), args=ARGUMENTS)
        yield browser
        browser.close()


class Watch:
    """What a page asked for and complained about."""

    def __init__(self, page: Any) -> None:
        self.requests: list[str] = []
        self.complaints: list[str] = []
        page.on("request", lambda request: self.requests.append(request.url))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("console", self._heard)

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning") and ADVICE not in message.text:
            self.complaints.append(message.text)

    def check(self) -> None:
        """Fail on any request that leaves the page, and on any complaint."""
        outside = [url for url in self.requests if not url.startswith(("file:", "data:", "blob:"))]
        assert outside == []
        assert self.complaints == []


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Callable[..., tuple[Any, Watch]]]:
    """Open a file; at the end, nothing may have been fetched or complained about."""
    contexts, watches = [], []

    def open_(
        path: Path, *, width: int = 1400, scripts: bool = True, **options: Any
    ) -> tuple[Any, Watch]:
        context = chromium.new_context(
            offline=True,
            java_script_enabled=scripts,
            viewport={"width": width, "height": 900},
            **options,
        )
        contexts.append(context)
        page = context.new_page()
        watch = Watch(page)
        watches.append(watch)
        page.goto(path.as_uri())
        return page, watch

    yield open_
    for watch in watches:
        watch.check()
    for context in contexts:
        context.close()
