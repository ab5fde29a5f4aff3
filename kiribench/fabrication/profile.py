"""Machine profiles: which layer and colour each kind of work has, and how fast the machine is.

A profile is a TOML file. ``trotec``, ``epilog``, ``lightburn`` and ``plain`` come with the
program; a file of your own has the same keys::

    title = "Our machine"
    stroke_mm = 0.01          # width of the lines in the SVG
    kerf_mm = 0.15            # optional: measured with the kerf coupon
    closes_gaps_mm = 1.5      # optional: gaps that the machine's program may close by itself
    notes = ["..."]           # for the job sheet

    [speeds]                  # optional; without them no time is given
    cut_mm_s = 14.2
    mark_mm_s = 200
    travel_mm_s = 1000

    [[layers]]                # in the order of work; every role in exactly one layer
    name = "slits"
    roles = ["slit", "tile"]
    colour = "#ff0000"
    aci = 1                   # the colour's number in DXF
    work = "cut"
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from kiribench.errors import Fault, UsageError
from kiribench.fabrication.strokes import ROLES

#: The profiles that come with the program.
PROFILES = ("plain", "trotec", "epilog", "lightburn")

_COLOUR = re.compile(r"#[0-9a-f]{6}")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,30}")
_SPEEDS = ("cut_mm_s", "mark_mm_s", "travel_mm_s")


@dataclass(frozen=True)
class Layer:
    """One layer of a file.

    Attributes:
        name: of the layer, in SVG and DXF.
        roles: what it holds.
        colour: of its lines, as ``#rrggbb``.
        aci: the AutoCAD colour index for DXF, 1 to 255.
        work: what the machine does with it, for the job sheet.
    """

    name: str
    roles: tuple[str, ...]
    colour: str
    aci: int
    work: str


@dataclass(frozen=True)
class Profile:
    """How a machine wants its files.

    Attributes:
        name: of the profile.
        title: of the machine or its program.
        layers: in the order of work.
        stroke_mm: width of the lines in the SVG, mm.
        kerf_mm: width that the beam burns away, mm, or None where it was not measured.
        closes_gaps_mm: gaps up to this the machine's program may close, mm, or None.
        cut_mm_s, mark_mm_s, travel_mm_s: speeds, or None where they are not known.
        notes: for the person at the machine.
        paper_settings: settings that a publication states, for the record.
    """

    name: str
    title: str
    layers: tuple[Layer, ...]
    stroke_mm: float = 0.1
    kerf_mm: float | None = None
    closes_gaps_mm: float | None = None
    cut_mm_s: float | None = None
    mark_mm_s: float | None = None
    travel_mm_s: float | None = None
    notes: tuple[str, ...] = ()
    paper_settings: dict[str, str] = field(default_factory=dict)

    def layer_of(self, role: str) -> Layer:
        """The layer that holds ``role``."""
        return next(layer for layer in self.layers if role in layer.roles)


def read_profile(name: str) -> Profile:
    """One of :data:`PROFILES`, or a TOML file of the user.

    Raises:
        UsageError: no such profile, no such file, or every fault of the file at once.
    """
    if name in PROFILES:
        text = (
            files("kiribench.fabrication").joinpath("profiles", f"{name}.toml").read_text("utf-8")
        )
        return _parse(text, name, file=f"{name}.toml")
    path = Path(name)
    if path.suffix.lower() != ".toml" or not path.is_file():
        raise UsageError(
            "profile-missing",
            "There is no such machine profile.",
            remedy=f"Take one of {', '.join(PROFILES)}, or the path of a TOML file like theirs.",
            got=name,
        )
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise UsageError(
            "profile-syntax",
            "The machine profile is no UTF-8 text.",
            remedy="Save it as UTF-8.",
            file=path,
            got=f"byte {error.start}",
        ) from error
    return _parse(text, path.stem, file=str(path))


def _parse(text: str, name: str, *, file: str) -> Profile:
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(
            "profile-syntax",
            f"The machine profile is not TOML: {error}.",
            remedy="Correct the line.",
            file=file,
        ) from error
    faults: list[Fault] = []

    def wrong(key: str, got: object, expected: str) -> None:
        faults.append(
            Fault(
                "profile-value",
                "A value of the machine profile cannot be used.",
                "Correct it; the profiles that come with the program are examples.",
                file=file,
                column=key,
                got=ascii(got)[:60],
                expected=expected,
            )
        )

    def number(holder: dict[str, Any], key: str, at: str, *, zero: bool = False) -> float | None:
        value = holder.get(key)
        if value is None:
            return None
        plain = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not plain or not (0 <= value < 1e5) or (value == 0 and not zero):
            wrong(at, value, "a length or speed greater than 0")
            return None
        return float(value)

    known = {
        *("title", "stroke_mm", "kerf_mm", "closes_gaps_mm", "notes"),
        *("speeds", "layers", "paper_settings"),
    }
    for key in sorted(set(table) - known):
        wrong(key, table[key], f"one of {', '.join(sorted(known))}")
    speeds = table.get("speeds", {})
    if not isinstance(speeds, dict):
        wrong("speeds", speeds, "a table")
        speeds = {}
    for key in sorted(set(speeds) - set(_SPEEDS)):
        wrong(f"speeds.{key}", speeds[key], f"one of {', '.join(_SPEEDS)}")
    notes = table.get("notes", [])
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        wrong("notes", notes, "a list of sentences")
        notes = []
    settings = table.get("paper_settings", {})
    if not isinstance(settings, dict) or not all(isinstance(v, str) for v in settings.values()):
        wrong("paper_settings", settings, "a table of words")
        settings = {}
    layers = _layers(table.get("layers"), wrong)
    profile = Profile(
        name=name,
        title=str(table.get("title", name)),
        layers=layers,
        stroke_mm=number(table, "stroke_mm", "stroke_mm") or 0.1,
        kerf_mm=number(table, "kerf_mm", "kerf_mm", zero=True),
        closes_gaps_mm=number(table, "closes_gaps_mm", "closes_gaps_mm"),
        cut_mm_s=number(speeds, "cut_mm_s", "speeds.cut_mm_s"),
        mark_mm_s=number(speeds, "mark_mm_s", "speeds.mark_mm_s"),
        travel_mm_s=number(speeds, "travel_mm_s", "speeds.travel_mm_s"),
        notes=tuple(notes),
        paper_settings=dict(settings),
    )
    if faults:
        raise UsageError.of(faults)
    return profile


def _layers(value: Any, wrong: Any) -> tuple[Layer, ...]:
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        wrong("layers", value, "tables [[layers]]")
        return ()
    layers, seen = [], []
    for index, entry in enumerate(value):
        at = f"layers[{index}]"
        name, colour = entry.get("name"), str(entry.get("colour", "")).lower()
        roles, aci = entry.get("roles"), entry.get("aci", 7)
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            wrong(f"{at}.name", name, "a short name of letters, digits, - and _")
        if not _COLOUR.fullmatch(colour):
            wrong(f"{at}.colour", colour, "#rrggbb")
        if isinstance(aci, bool) or not isinstance(aci, int) or not 1 <= aci <= 255:
            wrong(f"{at}.aci", aci, "1 to 255")
            aci = 7
        if not isinstance(roles, list) or not all(role in ROLES for role in roles):
            wrong(f"{at}.roles", roles, f"some of {', '.join(ROLES)}")
            roles = []
        seen += roles
        layers.append(Layer(str(name), tuple(roles), colour, aci, str(entry.get("work", ""))))
    for role in ROLES:
        if seen.count(role) != 1:
            wrong("layers", f"{role} in {seen.count(role)} layers", f"{role} in exactly one")
    for what, values in (
        ("name", [layer.name.lower() for layer in layers]),
        ("colour", [layer.colour for layer in layers]),
    ):
        if len(set(values)) != len(values):
            wrong(f"layers.{what}", values, "another one for every layer")
    if layers and "outline" in seen and "outline" not in layers[-1].roles:
        wrong("layers", layers[-1].name, "the outline in the last layer: it is cut last")
    return tuple(layers)
