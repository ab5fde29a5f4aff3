"""A text file as runs of whole lines in one reused buffer, for the OBJ reader."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import MeshError
from kiribench.surface.obj_state import PADDING

BLOCK_BYTES = 1 << 22
LONGEST_LINE_BYTES = 1 << 26
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOT_TEXT = {
    b"\xff\xfe": "UTF-16 text",
    b"\xfe\xff": "UTF-16 text",
    b"\x1f\x8b": "a gzip archive",
    b"PK\x03\x04": "a zip archive",
    b"ply\n": "a PLY file",
    b"ply\r": "a PLY file",
    b"glTF": "a binary glTF file",
}


def count_lines(path: Path) -> int:
    """An upper bound on the number of text lines: the line ends of either kind, and one."""
    buffer = np.empty(1 << 20, dtype=np.uint8)
    lines = 1
    with path.open("rb", buffering=0) as stream:
        while got := stream.readinto(buffer.data):
            lines += int(np.count_nonzero(buffer[:got] == 10))
            lines += int(np.count_nonzero(buffer[:got] == 13))
    return lines


def blocks(path: Path, block_bytes: int) -> Iterator[tuple[NDArray[np.uint8], int]]:
    """The file as runs of whole lines in one reused buffer, padded: (buffer, length)."""
    storage = np.full(block_bytes + PADDING, 10, dtype=np.uint8)
    buffer = storage[:block_bytes]
    kept = 0
    first = True
    with path.open("rb", buffering=0) as stream:
        while True:
            got = stream.readinto(buffer[kept:].data) or 0
            size = kept + got
            if first and got:
                _refuse_other_formats(path, bytes(buffer[:4]))
                if bytes(buffer[:3]) == _BYTE_ORDER_MARK:
                    buffer[:3] = 32
                first = False
            if got == 0:
                if size:
                    buffer[size:] = 10
                    yield storage, size
                return
            cut = _last_whole_line(buffer, size)
            if cut == 0:
                if size < len(buffer):
                    kept = size
                    continue
                if len(buffer) >= LONGEST_LINE_BYTES:
                    raise MeshError(
                        "obj-line-too-long",
                        f"A line is longer than {LONGEST_LINE_BYTES >> 20} MiB.",
                        remedy="This is no OBJ text file; export the scan again.",
                        file=path,
                    )
                larger = np.full(2 * len(buffer) + PADDING, 10, dtype=np.uint8)
                larger[:size] = buffer
                storage, buffer = larger, larger[:-PADDING]
                kept = size
                continue
            yield storage, cut
            rest = buffer[cut:size].copy()
            buffer[: len(rest)] = rest
            kept = len(rest)


def _last_whole_line(buffer: NDArray[np.uint8], size: int) -> int:
    """Length of the longest run of whole lines at the buffer's start (0 if there is none)."""
    view = buffer[:size].data
    data = bytes(view[max(0, size - 65536) : size])
    base = size - len(data)
    while True:
        at = len(data)
        while (at := data.rfind(b"\n", 0, at)) >= 0:
            before = data[max(0, at - 2) : at]
            if not (before.endswith(b"\\") or before == b"\\\r"):
                return base + at + 1
        # Carriage returns alone end the lines of some old files; the last byte may be half
        # of a pair.
        at = len(data) - 1
        while data.find(b"\n") < 0 and (at := data.rfind(b"\r", 0, at)) >= 0:
            if data[at - 1 : at] != b"\\":
                return base + at + 1
        if base == 0:
            return 0
        data = bytes(view[:size])
        base = 0


def _refuse_other_formats(path: Path, start: bytes) -> None:
    for magic, what in _NOT_TEXT.items():
        if start.startswith(magic):
            raise MeshError(
                "obj-not-text",
                f"The file is called .obj but is {what}.",
                remedy="Export it as OBJ text (UTF-8), or give it the right ending.",
                file=path,
            )
