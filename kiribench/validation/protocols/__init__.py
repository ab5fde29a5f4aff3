"""The table of the protocols: name, what it asks of a model, and its folds."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from kiribench.errors import UsageError
from kiribench.validation.fold import Fold
from kiribench.validation.protocols import (
    blocks,
    contiguous,
    edge,
    grouped,
    learning_curve,
    leave_design,
    leave_level,
    one_row,
    own_folds,
    shuffled,
)
from kiribench.validation.settings import CvSettings
from kiribench.validation.table import CvTable

HEADLINE = "grouped"


@dataclass(frozen=True)
class Protocol:
    """One row of the table of protocols.

    Attributes:
        name: as a person types it.
        title: for tables and figures.
        question: what it asks of a model, one sentence.
        folds: makes the folds; none where the protocol does not apply to the table.
        needs_cuts: whether it needs columns a and b.
        needs_groups: whether it says nothing new where each row is its own group.
        closed_form: whether Gaussian processes are not refitted but leave the folds out in
            closed form, the kernel parameters being those of the whole table.
        leaky: whether rows of one group may stand on both sides.
    """

    name: str
    title: str
    question: str
    folds: Callable[[CvTable, CvSettings], tuple[Fold, ...]]
    needs_cuts: bool = False
    needs_groups: bool = False
    closed_form: bool = False
    leaky: bool = False


_ROWS = (
    Protocol(
        HEADLINE,
        "Grouped by design",
        "How well are designs predicted that were never seen, amid others that were?",
        grouped.folds,
    ),
    Protocol(
        "leave-design-out",
        "Leave one design out",
        "The same with all other designs to learn from.",
        leave_design.folds,
        needs_groups=True,
        closed_form=True,
    ),
    Protocol(
        "leave-level-a-out",
        "Leave one level of a out",
        "How well does the model bridge a missing line of the lattice, and its two ends?",
        leave_level.folds_a,
        needs_cuts=True,
        closed_form=True,
    ),
    Protocol(
        "leave-level-b-out",
        "Leave one level of b out",
        "The same across b.",
        leave_level.folds_b,
        needs_cuts=True,
        closed_form=True,
    ),
    Protocol(
        "blocks",
        "Leave one block out",
        "How far does it reach into a hole of a ninth of the design space?",
        blocks.folds,
        needs_cuts=True,
    ),
    Protocol(
        "edge",
        "Edge of the design space",
        "Are the longest cuts (95 % and more) predicted from the shorter ones?",
        edge.folds,
        needs_cuts=True,
    ),
    Protocol(
        "learning-curve",
        "Learning curve",
        "How many designs does it take?",
        learning_curve.folds,
    ),
    Protocol(
        "shuffled",
        "Shuffled rows (leaky)",
        "What does a score claim where rows of one design stand on both sides?",
        shuffled.folds,
        needs_groups=True,
        closed_form=True,
        leaky=True,
    ),
    Protocol(
        "contiguous",
        "Contiguous, unshuffled",
        "What does a naive split of the sorted table claim?",
        contiguous.folds,
        leaky=True,
    ),
    Protocol(
        "one-row",
        "One row a design",
        "What if a sample is one row of each design, as the paper's words may be read?",
        one_row.folds,
        needs_groups=True,
    ),
    Protocol("own-folds", "Own folds", "The user's own question.", own_folds.folds, leaky=True),
)
_PROTOCOLS = {row.name: row for row in _ROWS}


def protocol_names() -> tuple[str, ...]:
    """The names of all protocols, in the table's order."""
    return tuple(_PROTOCOLS)


def protocol(name: str) -> Protocol:
    """The table's row for ``name``.

    Raises:
        UsageError: no protocol has this name; the message lists the names.
    """
    if name not in _PROTOCOLS:
        raise UsageError(
            "protocol-unknown",
            "There is no such protocol.",
            remedy="Choose one of the expected names.",
            got=name,
            expected=", ".join(_PROTOCOLS),
        )
    return _PROTOCOLS[name]


@dataclass(frozen=True)
class Planned:
    """The folds of the protocols that apply, and why others do not.

    Attributes:
        folds: by protocol, in the table's order.
        left_out: reason by protocol.
    """

    folds: dict[str, tuple[Fold, ...]]
    left_out: dict[str, str]


def plan(table: CvTable, settings: CvSettings) -> Planned:
    """The folds of every protocol that was asked for and applies to the table.

    Raises:
        UsageError: a protocol is unknown, or was asked for by name and does not apply.
    """
    asked = settings.protocols or protocol_names()
    folds: dict[str, tuple[Fold, ...]] = {}
    left_out: dict[str, str] = {}
    for row in [entry for entry in _ROWS if entry.name in {protocol(n).name for n in asked}]:
        made: tuple[Fold, ...] = ()
        if row.needs_cuts and not table.is_design_space:
            reason = "the table has no columns a_percent and b_percent"
        elif row.needs_groups and table.group_word == "row":
            reason = "each row is its own group: it would repeat the grouped protocol"
        else:
            made = row.folds(table, settings)
            reason = "it gives no fold on this table"
        if made:
            folds[row.name] = made
        elif settings.protocols:
            raise UsageError(
                "protocol-does-not-apply",
                f"The protocol {row.name} does not apply: {reason}.",
                remedy="Leave it out of --protocols, or give the columns that it needs.",
                got=row.name,
            )
        else:
            left_out[row.name] = reason
    return Planned(folds, left_out)


def said_of(table: CvTable, words: str) -> str:
    """A title or a question with the table's own word for a group: patients are no designs."""
    return re.sub(r"\bdesign(s?)\b(?! space)", rf"{table.group_word}\1", words)
