"""Where a result comes from: version, libraries and the hash of every input."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from kiribench import __version__

LIBRARIES = (
    "gpytorch",
    "numba",
    "numpy",
    "pandas",
    "scikit-learn",
    "scipy",
    "shapely",
    "torch",
    "trimesh",
)


def file_sha256(path: Path) -> str:
    """The SHA-256 of a file, as 64 hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def provenance(inputs: Iterable[Path]) -> dict[str, Any]:
    """What a result was computed from, ready for JSON.

    The record holds no time and no host name: the same input gives the same record.

    Args:
        inputs: every file that was read.
    """
    return {
        "kiribench": __version__,
        "python": platform.python_version(),
        "libraries": {name: _version(name) for name in LIBRARIES},
        "inputs": {
            str(path): {"sha256": file_sha256(path), "bytes": path.stat().st_size}
            for path in sorted(set(inputs))
        },
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
