"""What is said about table 1 of the paper."""

from types import SimpleNamespace
from typing import Any, cast

from kiribench.validation.table1 import against_table_one


def _summaries(**r2: float) -> Any:
    return {
        name: {"gp": SimpleNamespace(scores={"r2": SimpleNamespace(mean=value)})}
        for name, value in r2.items()
    }


def test_the_range_names_the_splits_that_it_holds() -> None:
    """An edge of the design space is no tenfold split, and the sentence does not claim it."""
    found = against_table_one(cast("Any", _summaries(grouped=0.9998, shuffled=0.9999, edge=0.5)))
    said = found.sentences[0]
    assert "over all settings and ten-fold splits tried ours runs from 0.9998 to 0.9999." in said
    assert {one.protocol for one in found.matches} == {"grouped", "shuffled", "edge"}
