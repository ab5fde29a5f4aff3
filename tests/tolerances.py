"""Every tolerance behind a scientific claim of the tests: value, unit, reason.

A tolerance is a statement about a method's error. It is never widened to make a test pass.
"""

from __future__ import annotations
