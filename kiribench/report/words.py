"""Numbers as a reader wants them: one way of writing each kind, for the whole report."""

from __future__ import annotations

import math
from collections.abc import Sequence

from kiribench.conformability.result import FAIR_FROM, GOOD_FROM

ABSENT = "–"


def percent(fraction: float | None, digits: int = 1) -> str:
    """``0.9167`` -> ``91.7 %``; a dash where there is none.

    >>> percent(0.91666), percent(None)
    ('91.7 %', '–')
    """
    if fraction is None or math.isnan(fraction):
        return ABSENT
    return f"{100 * fraction:.{digits}f} %"


def percent_span(low: float | None, high: float | None, digits: int = 1) -> str:
    """An interval of fractions in percent.

    >>> percent_span(0.888, 0.944)
    '88.8 to 94.4 %'
    """
    if low is None or high is None or math.isnan(low) or math.isnan(high):
        return ABSENT
    return f"{100 * low:.{digits}f} to {100 * high:.{digits}f} %"


def number(value: float | None, digits: int = 2, *, sign: bool = False) -> str:
    """A number with a true minus sign; a dash where there is none.

    >>> number(-0.3141), number(float("nan")), number(0.25, sign=True)
    ('−0.31', '–', '+0.25')
    """
    if value is None or math.isnan(value):
        return ABSENT
    shown = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    if float(shown) == 0:
        shown = shown.lstrip("+-")
    return shown.replace("-", "−")


def overlap_words(value: float) -> str:
    """An overlap with two decimals; with more where these would show another grade.

    >>> overlap_words(0.7496), overlap_words(0.8123), overlap_words(0.89999)
    ('0.7496', '0.81', '0.89999')
    """
    if math.isnan(value):
        return ABSENT
    digits = 2
    while digits < 6 and _grade_at(round(value, digits)) != _grade_at(value):
        digits += 1
    return number(value, digits)


def _grade_at(value: float) -> int:
    return (value >= FAIR_FROM) + (value >= GOOD_FROM)


def span(low: float | None, high: float | None, digits: int = 2) -> str:
    """An interval of numbers.

    >>> span(-0.5, 0.25)
    '−0.50 to 0.25'
    """
    first, last = number(low, digits), number(high, digits)
    return ABSENT if ABSENT in (first, last) else f"{first} to {last}"


def count(n: int, noun: str) -> str:
    """A count with its noun.

    >>> count(1, "cell"), count(3, "cell")
    ('1 cell', '3 cells')
    """
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def listing(items: Sequence[str], last: str = "and") -> str:
    """Items as a phrase.

    >>> listing(["S", "LS", "P"])
    'S, LS and P'
    """
    if len(items) < 2:
        return "".join(items)
    return ", ".join(items[:-1]) + f" {last} {items[-1]}"


def sentence_case(words: str) -> str:
    """The first letter in upper case, the rest as it is."""
    return words[:1].upper() + words[1:]
