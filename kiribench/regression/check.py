"""One check of the regression suite, and what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree


@dataclass(frozen=True)
class Check:
    """One comparison.

    Attributes:
        group: ``truth``, ``record`` or ``invariant``.
        name: what is compared, such as ``S1 overlap_paper``.
        passed: whether it holds.
        worst: the largest difference found, or None where nothing could be compared.
        bound: the largest admissible one.
        detail: where the worst is, or why nothing could be compared.
        seconds: time taken.
    """

    group: str
    name: str
    passed: bool
    worst: float | None
    bound: float
    detail: str
    seconds: float = 0.0

    def line(self) -> str:
        """The check in one line of text."""
        verdict = "ok  " if self.passed else "FAIL"
        worst = "   n/a  " if self.worst is None else f"{self.worst:.2e}"
        return f"  {verdict} {self.name:<34} {worst}  bound {self.bound:.1e}  {self.detail}"


def junit_xml(checks: Sequence[Check], suite: str) -> str:
    """The checks as a JUnit XML document."""
    root = ElementTree.Element(
        "testsuite",
        name=suite,
        tests=str(len(checks)),
        failures=str(sum(not check.passed for check in checks)),
        errors="0",
        skipped="0",
        time=f"{sum(check.seconds for check in checks):.3f}",
    )
    for check in checks:
        case = ElementTree.SubElement(
            root,
            "testcase",
            classname=f"{suite}.{check.group}",
            name=check.name,
            time=f"{check.seconds:.3f}",
        )
        if not check.passed:
            worst = "nothing to compare" if check.worst is None else f"{check.worst:.6g}"
            failure = ElementTree.SubElement(
                case, "failure", message=f"{worst}, bound {check.bound:.6g}", type=check.group
            )
            failure.text = check.detail
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"
