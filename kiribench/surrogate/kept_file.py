"""A safetensors file of arrays and one JSON record, under one checksum.

Nothing in it runs when it is read. The checksum is over the record and every array with its
name, type and shape: a file that was cut off, altered or mixed up is not read.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kiribench.errors import TableError, UsageError

Arrays = dict[str, NDArray[Any]]
RECORD = "kiribench"  # the key of the record in the file's metadata


def write(path: Path, record: dict[str, Any], arrays: Arrays) -> None:
    """Write all of it or nothing: under another name first, then renamed.

    Args:
        path: its folder is made if it is not there.
        record: what JSON can hold; ``schema`` names the format.
        arrays: by name; the same content gives the same bytes.

    Raises:
        UsageError: the record holds what JSON cannot.
    """
    from safetensors.numpy import save as encode

    arrays = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
    try:
        text = json.dumps(record, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise UsageError(
            "settings-not-plain",
            f"The record cannot be written ({error}).",
            remedy="Use finite numbers, texts and lists only as settings.",
            file=path,
        ) from error
    whole = json.loads(text) | {"sha256": _checksum(text, arrays)}
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(encode(arrays, metadata={RECORD: json.dumps(whole, sort_keys=True)}))
        partial.replace(path)
    finally:
        with contextlib.suppress(FileNotFoundError):
            partial.unlink()


def read(path: Path, schema: str, *, what: str) -> tuple[dict[str, Any], Arrays]:
    """The record and the arrays that :func:`write` was given.

    Args:
        path: of the file.
        schema: that the record must name.
        what: for people: ``model``.

    Raises:
        TableError: the file is missing, cut off, altered, or of another format.
    """
    from safetensors import SafetensorError, safe_open

    if not path.is_file():
        raise TableError(
            f"{what}-file-missing", f"The {what} file does not exist.", remedy="Check it.",
            file=path,
        )  # fmt: skip
    try:
        with safe_open(path, framework="numpy") as stream:
            metadata = stream.metadata() or {}
            arrays = {name: stream.get_tensor(name) for name in stream.keys()}  # noqa: SIM118
        record = json.loads(metadata[RECORD])
        declared = record.pop("sha256")
        found = record["schema"]
    except (
        SafetensorError, OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError,
    ) as error:  # fmt: skip
        raise TableError(
            f"{what}-file-damaged",
            f"The file is no {what} of kiribench, or is truncated ({type(error).__name__}).",
            remedy=f"Copy it again, or make the {what} again.",
            file=path,
        ) from error
    if found != schema:
        raise TableError(
            f"{what}-file-version",
            f"The {what} file has another format: another version of kiribench wrote it.",
            remedy=f"Use that version, or make the {what} again with this one.",
            file=path,
            got=str(found)[:100],
            expected=schema,
        )
    if declared != _checksum(json.dumps(record, sort_keys=True), arrays):
        raise TableError(
            f"{what}-file-altered",
            "The file's content does not match its checksum.",
            remedy=f"It was changed after it was written: copy it again, or make the {what} again.",
            file=path,
        )
    return record, arrays


def _checksum(text: str, arrays: Arrays) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
