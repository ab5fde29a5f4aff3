"""Where compiled kernels are kept: one folder for each state of the kernels' sources.

numba's own cache looks at the file of the called function only: a caller compiled against
an older kernel of another file would go on running the old code without a word. And it
raises where neither the package folder nor the home can be written.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"


def key_kernel_cache() -> None:
    """Point numba's cache at a folder keyed by the kernels' sources.

    Does nothing where ``NUMBA_CACHE_DIR`` is set: the user's choice stands.
    """
    if os.environ.get(_VARIABLE):
        return
    folder = str(_cache_home() / f"kernels-{_sources_key(Path(__file__).parent)}")
    os.environ[_VARIABLE] = folder
    if "numba" in sys.modules:  # imported before us: it has read its settings already
        sys.modules["numba"].config.CACHE_DIR = folder


def _sources_key(package: Path) -> str:
    """Sixteen hexadecimal digits that change with any source that is compiled."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        source = path.read_bytes()
        if b"njit" in source:
            digest.update(str(path.relative_to(package)).encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def _cache_home() -> Path:
    """The user's cache folder; where that cannot be written, one that goes with the process."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    home = Path(base) / "kiribench"
    try:
        home.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=home):
            return home
    except OSError:
        folder = tempfile.mkdtemp(prefix="kiribench-")  # ours alone: others cannot plant code
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        return Path(folder)
