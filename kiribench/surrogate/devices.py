"""Where torch computes, and with how many threads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from kiribench.errors import UsageError


def device_of(name: str) -> torch.device:
    """The torch device ``"cpu"`` or ``"cuda"``.

    Raises:
        UsageError: the name is another one, or this machine has no CUDA device.
    """
    if name not in ("cpu", "cuda"):
        raise UsageError(
            "device-unknown", "There is no such device.", remedy="Use cpu or cuda.", got=name
        )
    if name == "cuda" and not torch.cuda.is_available():
        raise UsageError(
            "device-absent",
            "torch sees no CUDA device on this machine.",
            remedy="Use --device cpu, or install a CUDA build of torch where there is a GPU.",
            got=name,
        )
    return torch.device(name)


@contextmanager
def torch_threads(count: int | None) -> Iterator[None]:
    """Let torch use ``count`` CPU threads inside the block (``None``: leave it as it is).

    One thread gives the same sums in the same order however many folds run side by side,
    and no folds fight for cores.
    """
    before = torch.get_num_threads()
    if count is not None and count != before:
        torch.set_num_threads(count)
    try:
        yield
    finally:
        if torch.get_num_threads() != before:
            torch.set_num_threads(before)
