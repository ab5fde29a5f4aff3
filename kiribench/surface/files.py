"""What a scan may name beside itself: files inside its own folder, and nothing else.

A scan is data from elsewhere. An ``mtllib`` line or a glTF ``uri`` that points out of the
scan's folder (an absolute path, ``..``, a link that leads out, a device) is refused with a
warning and never opened.
"""

from __future__ import annotations

import re
from pathlib import Path

from kiribench.errors import Fault, MeshError

_DRIVE = re.compile(r"^[A-Za-z]:")
_URL = re.compile(r"^[A-Za-z][A-Za-z0-9+.-]*://")


def regular_file(path: Path) -> Path:
    """``path`` itself, once it is known to be a readable file of some length.

    Raises:
        MeshError: ``mesh-file-missing``, ``mesh-file-not-regular`` (a folder, a pipe or a
            device, which could block for ever) or ``mesh-file-empty``.
    """
    if not path.exists():
        raise MeshError(
            "mesh-file-missing",
            "The scan does not exist.",
            remedy="Check the name, or that the link leads somewhere.",
            file=path,
        )
    if not path.is_file():
        raise MeshError(
            "mesh-file-not-regular",
            "The scan is no regular file.",
            remedy="Give a file, not a folder, a pipe or a device.",
            file=path,
        )
    try:
        size = path.stat().st_size
        with path.open("rb"):
            pass
    except OSError as error:
        raise MeshError(
            "mesh-file-unreadable",
            f"The scan cannot be opened: {error.strerror}.",
            remedy="Check the file's permissions.",
            file=path,
        ) from error
    if size == 0:
        raise MeshError(
            "mesh-file-empty",
            "The scan has no content (0 bytes).",
            remedy="Export or copy the scan again; the copy was cut off.",
            file=path,
        )
    return path


def inside_folder(folder: Path, name: str, *, scan: Path, what: str) -> Path | Fault:
    """The regular file that ``name`` means inside ``folder``, or the warning why not.

    Args:
        folder: the folder of the scan.
        name: the name as the scan spells it.
        scan: the scan, for the warning.
        what: what is named, such as ``material library``.
    """
    shown = repr(name if len(name) <= 80 else name[:77] + "...")
    spelled = name.strip().strip('"').replace("\\", "/")
    outside = Fault(
        "scan-path-outside",
        f"The scan names a {what} outside its own folder; it was not opened.",
        remedy="Put the file beside the scan and name it without a folder.",
        file=str(scan),
        got=shown,
        severity="warning",
    )
    if not spelled or "\0" in spelled or len(spelled) > 1024:
        return outside
    if spelled.startswith(("/", "~")) or _DRIVE.match(spelled) or _URL.match(spelled):
        return outside
    try:
        root = folder.resolve(strict=True)
        target = (root / spelled).resolve()
        if not target.is_relative_to(root):
            return outside
        found = target.is_file()
    except (OSError, RuntimeError):  # a loop of links, a name that is too long
        return outside
    if not found:
        return Fault(
            "scan-companion-missing",
            f"The scan names a {what} that is not there.",
            remedy="Copy it beside the scan, or leave it: only the picture on the scan is lost.",
            file=str(scan),
            got=shown,
            severity="warning",
        )
    return target
