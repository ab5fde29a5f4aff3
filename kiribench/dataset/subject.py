"""One subject of a dataset: scans, sidecars and nodes of the three acquisitions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from kiribench.errors import DatasetError, Fault
from kiribench.schema.layout import ACQUISITIONS, Layout
from kiribench.schema.nodes import NodesTable
from kiribench.schema.sidecars import ScanSidecar, Side
from kiribench.schema.strict_json import short

REQUIRED_ACQUISITIONS = ("flex000", "flex090")


@dataclass(frozen=True, eq=False)
class Acquisition:
    """What one acquisition's files hold; None for what is absent or wrong.

    Attributes:
        name: one of ``ACQUISITIONS``.
        scan: the scan's path.
        sidecar: its metadata.
        nodes: its nodes.
        files: every file that was found, for provenance.
        faults: what is wrong with them.
    """

    name: str
    scan: Path | None
    sidecar: ScanSidecar | None
    nodes: NodesTable | None
    files: tuple[Path, ...]
    faults: tuple[Fault, ...]


@dataclass(frozen=True, eq=False)
class Subject:
    """A subject, read from disk; access to anything that is wrong raises its faults.

    Attributes:
        root: the dataset's folder.
        id: the label, without ``sub-``.
        side: ``left``, ``right`` or ``none`` (not one of a pair); None if nobody says.
        layout: grid, patch and regions.
        acquisitions: by name; only those of which any file exists.
        own_faults: what is wrong with the subject as a whole (layout, side, poses).
    """

    root: Path
    id: str
    side: Side | None
    layout: Layout
    acquisitions: Mapping[str, Acquisition]
    own_faults: tuple[Fault, ...]

    @property
    def faults(self) -> tuple[Fault, ...]:
        """Everything that is wrong with this subject, warnings included."""
        listed = list(self.own_faults)
        for acquisition in self.acquisitions.values():
            listed += acquisition.faults
        return tuple(listed)

    @property
    def files(self) -> tuple[Path, ...]:
        """Every input file of the subject, for provenance."""
        return tuple(path for acq in self.acquisitions.values() for path in acq.files)

    def has(self, acquisition: str) -> bool:
        """Whether the scan and the nodes of ``acquisition`` are there and readable."""
        found = self.acquisitions.get(acquisition)
        return found is not None and found.scan is not None and found.nodes is not None

    def require(self, *acquisitions: str) -> None:
        """Refuse to go on unless these acquisitions are complete and without errors.

        Raises:
            DatasetError: every error of the subject and of these acquisitions at once; code
                ``acquisition-missing`` for one that is not there.
        """
        faults = [fault for fault in self.own_faults if fault.severity == "error"]
        if any(fault.code == "path-unreadable" for fault in faults):
            acquisitions = ()  # what cannot be listed is not missing
        for name in acquisitions:
            found = self.acquisitions.get(name)
            if found is None:
                faults.append(self.missing(name))
            else:
                faults += [fault for fault in found.faults if fault.severity == "error"]
        if faults:
            raise DatasetError.of(faults)

    def scan_path(self, acquisition: str) -> Path | None:
        """The scan's file, or None if the acquisition has none."""
        found = self.acquisitions.get(acquisition)
        return None if found is None else found.scan

    def scan_sidecar(self, acquisition: str) -> ScanSidecar:
        """The scan's metadata (units, flexion angle, side).

        Raises:
            DatasetError: all errors of the acquisition, if it has any or is not there.
        """
        self.require(acquisition)
        sidecar = self.acquisitions[acquisition].sidecar
        if sidecar is None:
            raise DatasetError.of([self.missing(acquisition)])
        return sidecar

    def nodes(self, acquisition: str) -> NodesTable:
        """The nodes table, complete and in range.

        Raises:
            DatasetError: all errors of the acquisition, if it has any or is not there.
        """
        self.require(acquisition)
        nodes = self.acquisitions[acquisition].nodes
        if nodes is None:
            raise DatasetError.of([self.missing(acquisition)])
        return nodes

    def missing(self, acquisition: str) -> Fault:
        """The fault that says that ``acquisition`` is not there."""
        if acquisition not in ACQUISITIONS:
            raise ValueError(f"acquisition must be one of {ACQUISITIONS}, not {acquisition!r}")
        return Fault(
            "acquisition-missing",
            f"Participant {self.id} has no acquisition {acquisition}.",
            f"Add sub-{self.id}_acq-{acquisition}_scan.obj with its .json, and "
            f"sub-{self.id}_acq-{acquisition}_nodes.tsv.",
            file=f"sub-{self.id}/surf",
            got=_names_in(self.root / f"sub-{self.id}" / "surf"),
        )


def _names_in(folder: Path) -> str:
    """What the folder holds, for the message of what is missing."""
    try:
        names = sorted(path.name for path in folder.iterdir())
    except OSError:
        return f"no readable folder {folder.name}"
    return short(", ".join(names), 200)[1:-1] or "an empty folder"
