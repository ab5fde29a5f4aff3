"""Files of a dataset, read without following anything that leads out of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from kiribench.errors import Fault
from kiribench.schema.strict_json import short

SCAN_SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf")


@dataclass(frozen=True)
class Folder:
    """The root of a dataset, resolved once; every access goes through it.

    Attributes:
        root: as the user gave it.
        resolved: without symbolic links.
    """

    root: Path
    resolved: Path

    @classmethod
    def at(cls, root: Path) -> Folder:
        """The folder at ``root``, which exists."""
        return cls(root, root.resolve())

    def name(self, path: Path) -> str:
        """``path`` relative to the dataset, printable, for messages."""
        text = path.relative_to(self.root).as_posix()
        return text if text.isprintable() else short(text, 200)[1:-1]

    def refuse(self, path: Path) -> Fault | None:
        """Why ``path`` may not be read as a file, or None."""
        name = self.name(path)
        try:
            resolved = path.resolve()
        except (OSError, RuntimeError, ValueError):  # a loop of links, a NUL byte
            return Fault(
                "path-unreadable",
                "The path cannot be resolved: its links lead in a circle.",
                "Put the file itself there.",
                file=name,
            )
        if not resolved.is_relative_to(self.resolved):
            return Fault(
                "path-outside",
                "The path leads out of the dataset.",
                "Copy the file into the dataset; links may only lead inside it.",
                file=name,
                got="a symbolic link to somewhere else",
            )
        if path.is_dir():
            return Fault(
                "path-not-a-file",
                "A folder has the name of a file.",
                "Put the file there, or rename the folder.",
                file=name,
                got="a folder",
                expected="a file",
            )
        if not path.is_file():
            return Fault(
                "path-not-a-file",
                "Something that is no plain file has its name (a dangling link, a pipe, a device).",
                "Put the file itself there.",
                file=name,
                expected="a file",
            )
        try:
            with path.open("rb"):
                pass
        except OSError as error:
            return unreadable(error, name)
        return None

    def usable(self, path: Path) -> bool:
        """Whether ``path`` is a readable file inside the dataset, that may be opened."""
        return present(path) and self.refuse(path) is None

    def read(self, path: Path) -> tuple[bytes | None, tuple[Fault, ...]]:
        """The bytes of a file, or None with the fault that says why there are none."""
        fault = self.refuse(path)
        if fault is not None:
            return None, (fault,)
        try:
            return path.read_bytes(), ()
        except OSError as error:
            return None, (unreadable(error, self.name(path)),)


def unreadable(error: OSError, file: str) -> Fault:
    """The fault for what the operating system refuses (permissions, a broken disk)."""
    return Fault(
        "path-unreadable",
        "A file or folder cannot be read.",
        "Check the permissions of the folder and of everything in it.",
        file=file,
        got=error.strerror or type(error).__name__,
    )


def present(path: Path) -> bool:
    """Whether anything has this name, a dangling link included."""
    return path.is_symlink() or path.exists()


def find_scans(folder: Path, stem: str) -> tuple[Path, ...]:
    """Everything in ``folder`` named ``stem`` with a scan's suffix, in any letter case."""
    if not folder.is_dir():
        return ()
    return tuple(
        sorted(
            path
            for path in folder.iterdir()
            if path.stem == stem and path.suffix.lower() in SCAN_SUFFIXES
        )
    )


def near_names(folder: Path, wanted: str, limit: int = 3) -> tuple[str, ...]:
    """Names in ``folder`` that look like a misspelt ``wanted``."""
    import difflib

    if not folder.is_dir():
        return ()
    names = sorted(path.name for path in folder.iterdir())
    close = difflib.get_close_matches(wanted, names, n=limit, cutoff=0.75)
    return tuple(name for name in close if name.isprintable())
