"""The texture picture of an OBJ scan: its material libraries, read with distrust.

The format: http://paulbourke.net/dataformats/mtl/.
"""

from __future__ import annotations

from pathlib import Path

from kiribench.errors import Fault
from kiribench.surface.files import inside_folder

_LARGEST_LIBRARY_BYTES = 1 << 20
_PICTURES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".tga", ".webp"})
# How many numbers follow each option of a map_Kd line.
_OPTIONS = {
    "-blendu": 1,
    "-blendv": 1,
    "-boost": 1,
    "-bm": 1,
    "-cc": 1,
    "-clamp": 1,
    "-imfchan": 1,
    "-mm": 2,
    "-o": 3,
    "-s": 3,
    "-t": 3,
    "-texres": 1,
    "-type": 1,
}


def texture_of(
    scan: Path, libraries: list[str], materials: list[str]
) -> tuple[Path | None, list[Fault]]:
    """The picture of the first used material that has one, and the warnings met on the way.

    Args:
        scan: the OBJ file; nothing outside its folder is opened.
        libraries: the texts after ``mtllib``, in order.
        materials: the texts after ``usemtl``, in order.
    """
    faults: list[Fault] = []
    pictures: dict[str, str] = {}
    for text in libraries:
        for library in _library_files(scan, text, faults):
            for material, picture in _pictures_in(scan, library, faults).items():
                pictures.setdefault(material, picture)
    used = [name for name in materials if name in pictures] or list(pictures)
    names = list(dict.fromkeys(pictures[name] for name in used))
    if len(names) > 1:
        faults.append(
            Fault(
                "scan-many-textures",
                f"The scan uses {len(names)} texture pictures; only the first is kept.",
                remedy="Export the scan with one texture atlas.",
                file=str(scan),
                got=", ".join(repr(name) for name in names[:4]),
                severity="warning",
            )
        )
    for name in names:
        found = inside_folder(scan.parent, name, scan=scan, what="texture picture")
        if isinstance(found, Fault):
            faults.append(found)
        elif found.suffix.lower() not in _PICTURES:
            faults.append(
                Fault(
                    "scan-texture-format",
                    "The texture is no picture format that is read here.",
                    remedy="Export the texture as PNG or JPEG.",
                    file=str(scan),
                    got=repr(name[:80]),
                    severity="warning",
                )
            )
        else:
            return found, faults
    return None, faults


def _library_files(scan: Path, text: str, faults: list[Fault]) -> list[Path]:
    """The library files of one ``mtllib`` line: one name with blanks, or several names."""
    whole = inside_folder(scan.parent, text, scan=scan, what="material library")
    if isinstance(whole, Path):
        return [whole]
    names = text.split()
    if len(names) <= 1:
        faults.append(whole)
        return []
    found = []
    for name in names[:16]:
        file = inside_folder(scan.parent, name, scan=scan, what="material library")
        if isinstance(file, Fault):
            faults.append(file)
        else:
            found.append(file)
    return found


def _pictures_in(scan: Path, library: Path, faults: list[Fault]) -> dict[str, str]:
    """Material name to picture name."""
    with library.open("rb") as stream:
        data = stream.read(_LARGEST_LIBRARY_BYTES + 1)
    if len(data) > _LARGEST_LIBRARY_BYTES or b"\0" in data:
        faults.append(
            Fault(
                "scan-material-unreadable",
                "The material library is no text of reasonable length; it was left out.",
                remedy="Export the scan again with its .mtl file.",
                file=str(library),
                severity="warning",
            )
        )
        return {}
    pictures: dict[str, str] = {}
    material = ""
    for line in data.decode("utf-8", errors="replace").splitlines():
        words = line.split("#", 1)[0].split(maxsplit=1)
        if len(words) < 2:
            continue
        keyword, rest = words[0].lower(), words[1].strip()
        if keyword == "newmtl":
            material = rest
        elif keyword == "map_kd":
            pictures.setdefault(material, _without_options(rest))
    return pictures


def _without_options(text: str) -> str:
    """The picture's name behind the options of a ``map_Kd`` line."""
    words = text.split()
    if not words or not words[0].startswith("-"):
        return text
    while len(words) > 1 and words[0].lower() in _OPTIONS:
        option = words.pop(0).lower()
        for given in range(_OPTIONS[option]):
            # -o, -s and -t may carry one, two or three numbers.
            if len(words) == 1 or (given and not _is_number(words[0])):
                break
            words.pop(0)
    return " ".join(words)


def _is_number(word: str) -> bool:
    return word.lstrip("+-").replace(".", "", 1).isdigit()
