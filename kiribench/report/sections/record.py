"""Methods, assumptions, provenance and the full tables: what others need to check us."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from kiribench.conformability.result import REASONS as FIT_REASONS
from kiribench.conformability.result import Conformability
from kiribench.report.html import Html, bullets, paragraphs, table, tag, text
from kiribench.report.methods import assumptions, facts, methods, references
from kiribench.report.sections.worst import amounts
from kiribench.report.subject import SubjectReport
from kiribench.report.words import ABSENT, number, span
from kiribench.strain.result import REASONS as STRAIN_REASONS
from kiribench.strain.result import StrainField


def methods_section(subject: SubjectReport) -> Html:
    """What was done, in sentences, with the sources."""
    notes = facts(subject)
    return tag(
        "section",
        tag("h2", "Methods"),
        paragraphs(methods(subject)),
        [tag("h3", "Notes of this run"), bullets(notes)] if notes else None,
        tag("h3", "Assumptions"),
        bullets(assumptions(subject)),
        tag("h3", "Sources"),
        bullets(
            [
                text([reference.words, " ", tag("a", reference.url, href=reference.url)])
                for reference in references(subject)
            ]
        ),
        id="methods",
    )


def provenance_section(subject: SubjectReport) -> Html:
    """Version, settings and the hash of every input."""
    record = subject.provenance
    inputs: Mapping[str, Any] = record.get("inputs", {})
    libraries: Mapping[str, Any] = record.get("libraries", {})
    return tag(
        "section",
        tag("h2", "Provenance"),
        tag(
            "p",
            f"kiribench {record.get('kiribench', ABSENT)}, Python {record.get('python', ABSENT)}; ",
            ", ".join(f"{name} {version}" for name, version in libraries.items() if version),
            ". The same inputs, settings and versions give the same report, byte for byte.",
        ),
        table(
            ("Option", "Value"),
            [(name, _shown(value)) for name, value in sorted(subject.settings.items())],
            caption="Settings in force",
        )
        if subject.settings
        else None,
        table(
            ("Input", "Bytes", "SHA-256"),
            [
                (tag("code", name), item.get("bytes", ABSENT), tag("code", item.get("sha256", "")))
                for name, item in sorted(inputs.items())
            ],
            caption="Inputs",
            numeric=(1,),
            class_="hashes",
        )
        if inputs
        else None,
        id="provenance",
    )


def tables_section(subject: SubjectReport) -> Html:
    """Every cell of both results, folded away."""
    return tag(
        "section",
        tag("h2", "All cells"),
        _fit_table(subject.conformability) if subject.conformability else None,
        _strain_table(subject.strain) if subject.strain else None,
        id="cells",
    )


def _shown(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _fit_table(score: Conformability) -> Html:
    rows = []
    for r, c in np.ndindex(*score.shape):
        cell = (int(r), int(c))
        place = f"{r}, {c}"
        if score.reason[cell]:
            code = str(score.reason[cell])
            rows.append((place, score.region[cell], FIT_REASONS.get(code, code), *[ABSENT] * 13))
            continue
        amount = amounts(score, cell)
        rows.append(
            (
                place,
                score.region[cell],
                score.grade[cell],
                number(float(score.overlap_paper[cell]), 3),
                number(float(score.overlap_strict[cell]), 3),
                number(float(score.overlap_iou[cell]), 3),
                span(float(score.overlap_low[cell]), float(score.overlap_high[cell]), 3),
                " / ".join(f"{p:.2f}" for p in score.probability[cell]),
                number(float(score.perfect_fit_reading[cell]), 3),
                str(score.causes.main[cell]).replace("-", " "),
                *amount.values(),
            )
        )
    return tag(
        "details",
        tag("summary", f"Fit of all {len(rows)} cells"),
        table(
            (
                "Row, column",
                "Region",
                "Grade",
                "paper",
                "strict",
                "iou",
                "95 % interval",
                "P(good / fair / poor)",
                "Perfect fit reads",
                "Main cause",
                "Shift",
                "Rotation",
                "Length",
                "Width",
                "Shear",
                "Rest",
            ),
            rows,
            caption="Overlap by the three definitions, with the interval of the graded one, and "
            "the size of each cause.",
            numeric=(3, 4, 5, 6, 7, 8, 10, 11, 12, 13, 14, 15),
        ),
    )


def _strain_table(strain: StrainField) -> Html:
    rows = []
    for r, c in np.ndindex(*strain.shape):
        cell = (int(r), int(c))
        code = str(strain.poisson_reason[cell])
        rows.append(
            (
                f"{r}, {c}",
                number(float(strain.longitudinal_stretch.value[cell]), 4),
                number(float(strain.lateral_stretch.value[cell]), 4),
                number(float(strain.longitudinal_strain.value[cell]), 4),
                number(float(strain.lateral_strain.value[cell]), 4),
                number(float(strain.shear.value[cell]), 4),
                number(float(strain.poisson_ratio.value[cell]), 3),
                span(float(strain.poisson_ratio.low[cell]), float(strain.poisson_ratio.high[cell])),
                STRAIN_REASONS.get(code, code) if code else "",
            )
        )
    return tag(
        "details",
        tag("summary", f"Strain of all {len(rows)} cells"),
        table(
            (
                "Row, column",
                "Long. stretch",
                "Lat. stretch",
                "Long. strain",
                "Lat. strain",
                "Shear",
                "ν",
                "95 % interval of ν",
                "Remark",
            ),
            rows,
            caption=f"Stretch (length ratio), strain ({strain.strain_measure}), shear and "
            "Poisson's ratio.",
            numeric=(1, 2, 3, 4, 5, 6, 7),
        ),
    )
