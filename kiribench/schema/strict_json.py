"""JSON files read strictly: UTF-8, one object, no duplicate keys, no NaN."""

from __future__ import annotations

import json
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from kiribench.errors import Fault

MAX_JSON_BYTES = 4_000_000

_Model = TypeVar("_Model", bound=BaseModel)


def short(value: object, limit: int = 60) -> str:
    """``value`` as one printable ASCII line of at most ``limit`` characters."""
    text = ascii(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def decode_text(data: bytes, *, file: str) -> tuple[str | None, tuple[Fault, ...]]:
    """The text of a UTF-8 file, or None with the fault that says why there is none.

    A byte order mark is a warning; any other encoding and NUL bytes are errors.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return None, (
            Fault(
                "text-encoding",
                "The file is UTF-16.",
                "Save it as UTF-8 without a byte order mark.",
                file=file,
                got="a UTF-16 byte order mark",
                expected="UTF-8",
            ),
        )
    faults: tuple[Fault, ...] = ()
    if data[:3] == b"\xef\xbb\xbf":
        data = data[3:]
        faults = (
            Fault(
                "text-bom",
                "The file starts with a byte order mark, which was skipped.",
                "Save it as UTF-8 without a byte order mark.",
                file=file,
                severity="warning",
            ),
        )
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        return None, (
            *faults,
            Fault(
                "text-encoding",
                "The file is not UTF-8.",
                "Save it as UTF-8 (spreadsheets and old editors write other encodings).",
                file=file,
                row=data.count(b"\n", 0, error.start) + 1,
                got=f"byte 0x{data[error.start]:02x} at offset {error.start}",
                expected="UTF-8",
            ),
        )
    if "\0" in text:
        return None, (
            *faults,
            Fault(
                "text-binary",
                "The file holds NUL bytes: it is not a text file.",
                "Replace it with the text file that belongs here.",
                file=file,
                row=text.count("\n", 0, text.index("\0")) + 1,
            ),
        )
    return text, faults


class _Refused(Exception):
    """A key or constant that the strict reader refuses."""

    def __init__(self, code: str, what: str, remedy: str, column: str | None, got: str) -> None:
        super().__init__(what)
        self.code, self.what, self.remedy, self.column, self.got = code, what, remedy, column, got


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, value in pairs:
        if key in result:
            raise _Refused(
                "json-duplicate-key",
                "A key stands twice in one object, so that one of its values would be lost.",
                "Keep the key once.",
                short(key)[1:-1],
                f"{short(result[key], 30)} and {short(value, 30)}",
            )
        result[key] = value
    return result


def _constant(name: str) -> Any:
    raise _Refused(
        "json-not-finite",
        "The file holds a number that JSON does not have.",
        "Give a finite number, or leave the key out.",
        None,
        name,
    )


def parse_json(data: bytes, *, file: str) -> tuple[dict[str, Any] | None, tuple[Fault, ...]]:
    """The object of a JSON file, or None; and its faults.

    Codes: ``json-too-large``, ``text-encoding``, ``text-binary``, ``text-bom`` (warning),
    ``json-empty``, ``json-duplicate-key``, ``json-not-finite``, ``json-syntax``,
    ``json-not-object``.
    """
    if len(data) > MAX_JSON_BYTES:
        return None, (
            Fault(
                "json-too-large",
                "A sidecar is far larger than metadata can be.",
                "Keep measurements in tables, metadata in the sidecar.",
                file=file,
                got=f"{len(data)} bytes",
                expected=f"at most {MAX_JSON_BYTES}",
            ),
        )
    text, faults = decode_text(data, file=file)
    if text is None:
        return None, faults
    if not text.strip():
        return None, (
            *faults,
            Fault("json-empty", "The file is empty.", "Write one JSON object: {...}.", file=file),
        )
    try:
        value = json.loads(text, object_pairs_hook=_object, parse_constant=_constant)
    except _Refused as refused:
        return None, (
            *faults,
            Fault(
                refused.code,
                refused.what,
                refused.remedy,
                file=file,
                column=refused.column,
                got=refused.got,
            ),
        )
    except json.JSONDecodeError as error:
        return None, (
            *faults,
            Fault(
                "json-syntax",
                f"The file is not JSON: {error.msg.lower()} (character {error.colno}).",
                "Correct the line; commas stand between entries, never after the last one.",
                file=file,
                row=error.lineno,
            ),
        )
    except (RecursionError, ValueError) as error:  # nested too deep, integer too long
        return None, (
            *faults,
            Fault(
                "json-syntax",
                "The file is JSON that no sidecar needs: nested too deep, or a number too long.",
                "Write one flat JSON object.",
                file=file,
                got=type(error).__name__,
            ),
        )
    if not isinstance(value, dict):
        return None, (
            *faults,
            Fault(
                "json-not-object",
                "The file does not hold a JSON object.",
                "Write one JSON object: {...}.",
                file=file,
                got=short(value),
                expected="{...}",
            ),
        )
    return value, faults


def parse_model(
    model: type[_Model], value: dict[str, Any], *, file: str
) -> tuple[_Model | None, tuple[Fault, ...]]:
    """``value`` as a pydantic model, or None; every wrong key as a fault.

    Codes: ``json-key-missing``, ``json-key-unknown``, ``json-value``. Keys that differ from
    a known one only in their letter case give the warning ``json-key-case``, for the value
    is not read.
    """
    known = {field.alias or name: field.is_required() for name, field in model.model_fields.items()}
    lower = {key.lower(): key for key in known}
    faults = [
        Fault(
            "json-key-case",
            f"The key {short(key)} is not read: keys are case-sensitive.",
            f"Write {lower[key.lower()]}.",
            file=file,
            column=short(key)[1:-1],
            severity="warning",
        )
        for key in value
        if key not in known and key.lower() in lower
    ]
    try:
        return model.model_validate(value), tuple(faults)
    except ValidationError as error:
        for entry in error.errors(include_url=False, include_context=False):
            place = ".".join(str(part) for part in entry["loc"])
            kind = entry["type"]
            if kind == "missing":
                code, remedy = "json-key-missing", f"Add {place}."
            elif kind == "extra_forbidden":
                code, remedy = "json-key-unknown", f"Remove {place}, or correct its spelling."
            else:
                code, remedy = "json-value", f"Correct {place or 'the value'}."
            message = str(entry["msg"]).removeprefix("Value error, ")
            faults.append(
                Fault(
                    code,
                    "A required key is missing."
                    if kind == "missing"
                    else "A key is not known here."
                    if kind == "extra_forbidden"
                    else "A value cannot be used.",
                    remedy,
                    file=file,
                    column=short(place, 80)[1:-1] or None,
                    got=None if kind == "missing" else short(entry["input"]),
                    expected=message,
                )
            )
        return None, tuple(faults)
