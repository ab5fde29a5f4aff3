"""``kiribench validate``: every fault of a dataset at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kiribench.cli.command import Common, Outcome
from kiribench.errors import EXIT_BAD_DATA, EXIT_GATE_FAILED, EXIT_OK, Fault

if TYPE_CHECKING:
    from kiribench.dataset import Dataset, Subject
    from kiribench.surface.scan_check import ScanCheck

SCHEMA = "kiribench.validate/1"

SHOWN_PER_KIND = 8
"""Faults of one kind in one file that the text lists; --json lists all."""


def validate(
    dataset: Path,
    /,
    *,
    participant: str | None = None,
    strict: bool = False,
    common: Common | None = None,
) -> Outcome:
    """Check a dataset and report every fault with its file, row and remedy.

    Exit code 3 if there is any error; warnings alone leave it at 0, or 1 with --strict.

    Parameters
    ----------
    dataset
        Folder that holds dataset_description.json.
    participant
        Check this participant only.
    strict
        Fail on warnings too.
    common
        Output options.
    """
    from kiribench.dataset.folder import read_dataset, subject_faults

    common = common or Common()
    opened, found = read_dataset(dataset)
    faults = list(found)
    participants: list[dict[str, Any]] = []
    inputs: list[Path] = []
    if opened is not None:
        inputs += opened.files
        for subject, checks in _checks(opened, participant, common.quiet):
            inputs += subject.files
            faults += subject_faults(subject)
            for check in checks:
                faults += check.faults
            participants.append(_participant(subject, checks))
    faults = list(dict.fromkeys(faults))
    errors = sum(fault.severity == "error" for fault in faults)
    warnings = len(faults) - errors
    result = {
        "schema": SCHEMA,
        "dataset": None if opened is None else opened.description.name,
        "valid": errors == 0,
        "errors": errors,
        "warnings": warnings,
        "participants": participants,
        "faults": [fault.as_dict() for fault in faults],
    }
    exit_code = EXIT_BAD_DATA if errors else EXIT_GATE_FAILED if strict and warnings else EXIT_OK
    text = _text(dataset, participants, faults, errors, warnings, strict)
    return Outcome(result=result, text=text, exit_code=exit_code, inputs=tuple(inputs))


def _checks(
    dataset: Dataset, participant: str | None, quiet: bool
) -> Iterable[tuple[Subject, tuple[ScanCheck, ...]]]:
    from kiribench.cli.progress import progress
    from kiribench.surface.scan_check import check_scan

    subjects = list(dataset.subjects(participant))
    total = sum(len(subject.acquisitions) for subject in subjects)
    done = 0
    with progress("checking scans", quiet=quiet) as advance:
        for subject in subjects:
            checks = []
            for name in subject.acquisitions:
                check = check_scan(subject, name)
                if check is not None:
                    checks.append(check)
                done += 1
                advance(done, total)
            yield subject, tuple(checks)


def _participant(subject: Subject, checks: Sequence[ScanCheck]) -> dict[str, Any]:
    layout = subject.layout
    by_name = {check.acquisition: check for check in checks}
    scans = []
    for name, acquisition in subject.acquisitions.items():
        check, nodes = by_name.get(name), acquisition.nodes
        scan: dict[str, Any] = {
            "acquisition": name,
            "file": None if acquisition.scan is None else acquisition.scan.name,
            "units": None if acquisition.sidecar is None else acquisition.sidecar.units,
            "health": None if check is None else _health(check),
            "repairs": [] if check is None else list(check.repairs),
        }
        if nodes is not None:
            scan["nodes"] = {
                "expected": nodes.shape[0] * nodes.shape[1],
                "listed": len(nodes),
                "seen": int(nodes.present.sum()),
                "sd_source": nodes.sd_source,
            }
            if check is not None and check.offset_mm is not None:
                scan["nodes"]["median_offset_mm"] = check.offset_mm[0]
                scan["nodes"]["largest_offset_mm"] = check.offset_mm[1]
        scans.append(scan)
    return {
        "id": subject.id,
        "side": subject.side,
        "body_part": layout.body_part,
        "grid": [layout.grid.rows, layout.grid.columns],
        "patch": [layout.patch.rows, layout.patch.columns],
        "scans": scans,
    }


def _health(check: ScanCheck) -> dict[str, Any] | None:
    if check.health is None:
        return None
    entries = asdict(check.health)
    entries.pop("faults", None)
    return entries


def _text(
    root: Path,
    participants: Sequence[dict[str, Any]],
    faults: Sequence[Fault],
    errors: int,
    warnings: int,
    strict: bool,
) -> str:
    scans = sum(len(entry["scans"]) for entry in participants)
    lines = [
        f"{root}: {_count(len(participants), 'participant')}, {_count(scans, 'acquisition')}",
        "",
    ]
    by_file: dict[str, list[Fault]] = {}
    for fault in faults:
        by_file.setdefault(fault.file or "(dataset)", []).append(fault)
    for file, listed in by_file.items():
        lines.append(file)
        lines += _file_lines(listed)
        lines.append("")
    if errors:
        verdict = f"Not valid: {_count(errors, 'error')}, {_count(warnings, 'warning')}."
    elif warnings:
        verdict = f"Valid, with {_count(warnings, 'warning')}."
        if strict:
            verdict = f"Refused by --strict: {_count(warnings, 'warning')}."
    else:
        verdict = "Valid: no faults."
    return "\n".join([*lines, verdict])


def _file_lines(faults: Sequence[Fault]) -> list[str]:
    lines: list[str] = []
    kinds: dict[tuple[str, str], list[Fault]] = {}
    for fault in faults:
        kinds.setdefault((fault.severity, fault.code), []).append(fault)
    for (severity, code), listed in sorted(kinds.items()):
        for fault in listed[:SHOWN_PER_KIND]:
            place = ", ".join(
                part
                for part in (
                    None if fault.row is None else f"row {fault.row}",
                    None if fault.column is None else f"column {fault.column}",
                )
                if part
            )
            lines.append(f"  {severity} [{code}]{f' {place}' if place else ''}: {fault.what}")
            detail = [] if fault.got is None else [f"got {fault.got}"]
            detail += [] if fault.expected is None else [f"expected {fault.expected}"]
            if detail:
                lines.append(f"    {'; '.join(detail)}")
            lines.append(f"    remedy: {fault.remedy}")
        if len(listed) > SHOWN_PER_KIND:
            lines.append(f"  ... and {len(listed) - SHOWN_PER_KIND} more [{code}]; see --json")
    return lines


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
