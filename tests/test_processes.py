"""Work in local processes: all results, errors as they are, nobody left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest

from kiribench.errors import DataError, NotConvergedError
from kiribench.processes import in_processes


def square(x: int) -> int:
    return x * x


def threads(_: int) -> str:
    return os.environ["OMP_NUM_THREADS"]


def refuse(x: int) -> int:
    raise DataError("work-refused", "No.", remedy="None.", got=x)


def die(_: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return 0


def grow(x: int) -> int:
    # 400 MB more than before: enough for a pool to take it for a leak.
    grow.kept = bytearray(x * 400_000_000)  # type: ignore[attr-defined]
    time.sleep(1.5)
    return len(grow.kept)  # type: ignore[attr-defined]


def test_every_result_once():
    assert sorted(in_processes(square, range(20), 2)) == [x * x for x in range(20)]
    assert list(in_processes(square, (), 2)) == []


def test_one_thread_each_and_only_there(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert list(in_processes(threads, (0,), 1)) == ["1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_an_error_keeps_its_name():
    with pytest.raises(DataError) as caught:
        list(in_processes(refuse, (3,), 2))
    assert caught.value.code == "work-refused"
    assert caught.value.faults[0].got == "3"


def test_a_killed_process_is_named():
    with pytest.raises(NotConvergedError) as caught:
        list(in_processes(die, (0,), 2))
    assert caught.value.code == "worker-ended"


def test_processes_that_grow_go_on():
    assert sorted(in_processes(grow, (0, 1, 0, 1), 2)) == [0, 0, 400_000_000, 400_000_000]


def test_no_process_outlives_a_killed_parent(tmp_path):
    script = tmp_path / "parent.py"
    script.write_text(
        "import time\nfrom kiribench.processes import in_processes\n"
        "if __name__ == '__main__':\n    list(in_processes(time.sleep, (60, 60), 2))\n"
    )
    parent = subprocess.Popen([sys.executable, str(script)])
    try:
        family = psutil.Process(parent.pid)
        deadline = time.monotonic() + 60
        while len(children := family.children(recursive=True)) < 2:
            assert time.monotonic() < deadline, "the processes did not start"
            time.sleep(0.1)
        time.sleep(3)
    finally:
        parent.kill()
        parent.wait()
    _, alive = psutil.wait_procs(children, timeout=30)
    assert not alive
