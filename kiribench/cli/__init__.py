"""The command line: arguments in, exit code out; no science.

One command a file, each imported only when it is called, so that ``kiribench --help``
answers at once.
"""

from __future__ import annotations

from kiribench.cli.launch import main

__all__ = ["main"]
