"""Progress bars on stderr; silent where nobody looks."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[int, int], None]


def silent(done: int, total: int) -> None:
    """The progress callable that shows nothing."""


@contextmanager
def progress(description: str, *, quiet: bool = False) -> Iterator[Progress]:
    """A callable ``(done, total)`` that draws a bar with the time left on stderr.

    Args:
        description: what is under way, two or three words.
        quiet: show nothing. Nothing is shown either where stderr is no terminal.
    """
    if quiet or not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.progress import (
        Progress as RichProgress,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with RichProgress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(description, total=None)

        def show(done: int, total: int) -> None:
            bars.update(task, completed=done, total=total)

        yield show
