"""Which participants a command works on, and what happens when some of them fail."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from kiribench.errors import DataError, Fault

if TYPE_CHECKING:
    from kiribench.dataset import Dataset, Subject

Result = TypeVar("Result")


def chosen(dataset: Dataset, participants: Sequence[str]) -> list[Subject]:
    """The subjects asked for, each once, or all.

    Raises:
        UsageError: ``participant-unknown``.
    """
    if not participants:
        return list(dataset.subjects())
    wanted = dict.fromkeys(name.removeprefix("sub-") for name in participants)
    return [dataset.subject(name) for name in wanted]


def each(
    subjects: Sequence[Subject],
    work: Callable[[Subject], Result],
    description: str,
    *,
    quiet: bool,
) -> list[Result]:
    """Do the work for every subject; if any has bad data, raise the faults of all of them.

    Raises:
        DataError: or its subclass where only one subject failed.
    """
    from kiribench.cli.progress import progress

    results: list[Result] = []
    errors: list[DataError] = []
    with progress(description, quiet=quiet) as advance:
        for done, subject in enumerate(subjects):
            advance(done, len(subjects))
            try:
                results.append(work(subject))
            except DataError as error:
                errors.append(error)
        advance(len(subjects), len(subjects))
    if len(errors) == 1:
        raise errors[0]
    if errors:
        faults: dict[Fault, None] = {}
        for kept in errors:
            faults.update(dict.fromkeys(kept.faults))
        raise DataError.of(faults)
    return results
