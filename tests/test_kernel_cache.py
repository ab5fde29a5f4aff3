"""Compiled kernels: a changed source is never answered by old code; no folder is no crash."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from kiribench.kernel_cache import _sources_key


def _cache_dir(**environment: str) -> str:
    code = "import os, kiribench; print(os.environ['NUMBA_CACHE_DIR'])"
    kept = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=kept | environment,
    )
    return done.stdout.strip()


def test_the_key_changes_with_a_kernel_and_with_nothing_else(tmp_path):
    (tmp_path / "kernel.py").write_text("@njit\ndef f(): return 1\n")
    (tmp_path / "plain.py").write_text("x = 1\n")
    key = _sources_key(tmp_path)
    (tmp_path / "plain.py").write_text("x = 2\n")
    assert _sources_key(tmp_path) == key
    (tmp_path / "kernel.py").write_text("@njit\ndef f(): return 2\n")
    assert _sources_key(tmp_path) != key


def test_the_users_cache_is_used_and_his_choice_stands(tmp_path):
    assert _cache_dir(XDG_CACHE_HOME=str(tmp_path)).startswith(str(tmp_path / "kiribench"))
    assert _cache_dir(NUMBA_CACHE_DIR="mine") == "mine"


def test_a_cache_that_cannot_be_made_falls_back(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    folder = _cache_dir(XDG_CACHE_HOME=str(blocked))
    assert "kiribench-" in folder
    assert not Path(folder).parent.exists()  # it went with its process
