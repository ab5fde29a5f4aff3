"""The stored synthetic subjects in memory, each made once a test session."""

from __future__ import annotations

from functools import cache

from kiribench.synthetic import SyntheticSubject, subject


@cache
def stored_subject(label: str) -> SyntheticSubject:
    """S1, S2 or S3 with the default options."""
    return subject(label)
