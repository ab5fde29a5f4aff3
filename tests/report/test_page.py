"""One file a subject: complete, honest, self-contained, the same every time."""

from __future__ import annotations

import itertools
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from report_cases import conformability_case, strain_case, subject_case

from kiribench.errors import Fault
from kiribench.report import write_subject_report
from kiribench.report.page import subject_page
from kiribench.report.sections.beside_paper import paper_section
from kiribench.report.subject import SubjectReport
from kiribench.schema.layout import Grid, Layout, Patch, Regions

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>\"'&"


class Outline(HTMLParser):
    """Elements with their attributes, ids, figures with captions, and the text."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.figures: list[dict[str, object]] = []
        self.words: list[str] = []
        self._in_caption = False
        self._raw = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "figure":
            self.figures.append({"caption": "", "svg": None})
        if tag == "figcaption":
            self._in_caption = True
        if tag == "svg" and self.figures:
            self.figures[-1]["svg"] = dict(attrs)
        if tag in ("script", "style"):
            self._raw += 1

    def handle_endtag(self, tag: str) -> None:
        if tag == "figcaption":
            self._in_caption = False
        if tag in ("script", "style"):
            self._raw -= 1

    def handle_data(self, data: str) -> None:
        if self._in_caption:
            self.figures[-1]["caption"] = str(self.figures[-1]["caption"]) + data
        if not self._raw:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).replace("\u00a0", " ").split())


def outline(page: str) -> Outline:
    parsed = Outline()
    parsed.feed(page)
    parsed.close()
    return parsed


@pytest.fixture(scope="module")
def page() -> str:
    return subject_page(subject_case())


@pytest.fixture(scope="module")
def parsed(page: str) -> Outline:
    return outline(page)


def test_the_file_is_written_and_small(tmp_path: Path, page: str) -> None:
    path = write_subject_report(tmp_path / "a" / "sub-S1.html", subject_case())
    assert path.read_text(encoding="utf-8") == page
    assert path.stat().st_size <= 3_000_000


def test_it_is_self_contained(page: str, parsed: Outline) -> None:
    policies = [a["content"] for t, a in parsed.elements if a.get("http-equiv")]
    assert len(policies) == 1
    assert "default-src 'none'" in str(policies[0])
    assert "unsafe-eval" not in str(policies[0])
    assert "'unsafe-inline'" not in str(policies[0]).split("script-src")[1]
    for tag, attributes in parsed.elements:
        assert "src" not in attributes or str(attributes["src"]).startswith("data:"), tag
        assert not any(name.startswith("on") for name in attributes), tag
        if tag != "a":
            for name in ("href", "xlink:href"):
                assert str(attributes.get(name) or "#").startswith(("#", "data:")), tag
    assert "@import" not in page
    assert "<link" not in page


def test_ids_are_unique_and_links_lead_somewhere(parsed: Outline) -> None:
    ids = [str(a["id"]) for _, a in parsed.elements if a.get("id")]
    assert len(ids) == len(set(ids))
    inside = [str(a["href"])[1:] for t, a in parsed.elements if t == "a" and "href" in a
              and str(a["href"]).startswith("#")]  # fmt: skip
    assert len(inside) == 10
    assert set(inside) <= set(ids)


def test_every_figure_has_a_caption_and_an_alternative_text(parsed: Outline) -> None:
    assert len(parsed.figures) == 2 + 3 + 6 + 1 + 4
    for figure in parsed.figures:
        assert len(str(figure["caption"])) > 40
        svg = figure["svg"]
        assert isinstance(svg, dict)
        assert svg["role"] == "img"
        assert len(str(svg["aria-label"])) > 20


def test_headings_go_down_one_level_at_a_time(parsed: Outline) -> None:
    levels = [int(tag[1]) for tag, _ in parsed.elements if re.fullmatch(r"h[1-6]", tag)]
    assert levels.count(1) == 1
    assert levels[0] == 1
    assert all(b <= a + 1 for a, b in itertools.pairwise(levels))


def test_the_verdict_has_the_numbers_of_the_score(parsed: Outline) -> None:
    whole = conformability_case().whole
    assert whole.satisfactory is not None
    assert whole.satisfactory_low is not None
    assert whole.satisfactory_high is not None
    assert (
        f"On synthetic subject S1, {whole.good + whole.fair} of {whole.scored} cells "
        f"({100 * whole.satisfactory:.1f} %; 95 % interval {100 * whole.satisfactory_low:.1f} to "
        f"{100 * whole.satisfactory_high:.1f} %)" in parsed.text
    )
    assert "1 of 72 cells could not be scored" in parsed.text


def test_synthetic_data_is_called_synthetic_and_other_data_is_not(parsed: Outline) -> None:
    synthetic = parsed.text
    real = outline(subject_page(subject_case(synthetic=False, surface=None))).text
    assert "Synthetic data:" in synthetic
    assert "Nobody was scanned" in synthetic
    assert "synthetic" not in real.lower()


def test_all_cells_and_all_three_definitions_are_in_the_table(page: str) -> None:
    score = conformability_case()
    rows = re.findall(r"<tr><th scope=\"row\">(\d+), (\d+)</th>(.*?)</tr>", page)
    fit = [row for row in rows if row[2].count("<td") == 15]
    assert len(fit) == 72
    for r, c, cells in fit:
        place = int(r), int(c)
        if score.reason[place]:
            assert "missing or hidden" in cells
        else:
            for overlap in (score.overlap_paper, score.overlap_strict, score.overlap_iou):
                assert f">{overlap[place]:.3f}<" in cells
    strain = [row for row in rows if row[2].count("<td") == 8]
    assert len(strain) == 16 * 12


def test_map_and_table_of_regions_have_the_counts_of_the_score(page: str) -> None:
    score = conformability_case()
    region_svg = page[page.index('aria-label="Map of 7 regions') :].split("</svg>")[0]
    for region in score.regions:
        assert region.satisfactory is not None
        counted = f">{region.good + region.fair} of {region.scored}<"
        assert counted in region_svg
        share = f"{100 * region.satisfactory:.1f}"
        row = re.search(rf'<tr><th scope="row"><span>{region.label}<.*?</tr>', page)
        assert row is not None
        cells = re.findall(r'<td class="n">(.*?)</td>', row[0])
        assert cells[0] == f"{share}\u00a0%"
        assert [int(cell) for cell in cells[2:5]] == [region.good, region.fair, region.poor]


def test_the_three_definitions_have_their_own_counts(parsed: Outline) -> None:
    score = conformability_case()
    for name, grades in score.grades.items():
        counts = [int((grades == grade).sum()) for grade in ("good", "fair", "poor")]
        caption = next(
            str(f["caption"]) for f in parsed.figures if str(f["caption"]).startswith(name)
        )
        assert f"{counts[0]} good, {counts[1]} fair, {counts[2]} poor" in caption


def test_the_worst_cells_are_the_worst(parsed: Outline) -> None:
    score = conformability_case()
    shown = [tuple(map(int, m)) for m in re.findall(r"Row (\d+), column (\d+) \(", parsed.text)]
    order = np.argsort(np.where(score.scored, score.overlap, np.inf), axis=None)[:6]
    assert shown == [divmod(int(i), 6) for i in order]


def test_outside_text_stays_text(parsed: Outline) -> None:
    fault = Fault(HOSTILE, HOSTILE, HOSTILE, file=HOSTILE, got=HOSTILE, expected=HOSTILE)
    case = subject_case(
        HOSTILE,
        conformability=replace(conformability_case(HOSTILE), notes=(HOSTILE,)),
        dataset=HOSTILE,
        settings={HOSTILE: HOSTILE, "list": [HOSTILE]},
        provenance={"kiribench": HOSTILE, "python": HOSTILE, "libraries": {HOSTILE: HOSTILE},
                    "inputs": {HOSTILE: {"sha256": HOSTILE, "bytes": HOSTILE}}},
        warnings=(fault,),
    )  # fmt: skip
    hostile, plain = outline(subject_page(case)), parsed
    for tag in ("script", "img", "style", "meta", "svg"):
        count = [sum(t == tag for t, _ in o.elements) for o in (hostile, plain)]
        assert count[0] == count[1], tag
    assert not any(name.startswith("on") for _, a in hostile.elements for name in a)
    assert HOSTILE in hostile.text


def test_the_same_input_gives_the_same_bytes(page: str) -> None:
    assert subject_page(subject_case()) == page


def test_strain_alone_makes_a_report() -> None:
    seen = outline(subject_page(subject_case(conformability=None))).text
    assert "No worn scan was scored" in seen
    assert "How the skin deforms" in seen
    assert "Where it fits" not in seen


def test_a_score_alone_makes_a_report() -> None:
    page = outline(subject_page(subject_case(strain=None, surface=None)))
    seen = page.text
    assert "Where it fits" in seen
    assert "How the skin deforms" not in seen
    assert not any(tag == "script" for tag, _ in page.elements)
    assert any("script-src 'none'" in str(a.get("content")) for _, a in page.elements)


def test_a_patch_without_any_scored_cell_makes_a_report() -> None:
    every = tuple((r, c) for r in range(12) for c in range(6))
    case = subject_case(conformability=conformability_case(missing=every))
    seen = outline(subject_page(case)).text
    assert "no cell of the patch could be scored" in seen
    assert "The worst cells" not in seen


def test_masked_strain_everywhere_makes_a_report() -> None:
    strain = strain_case()
    nothing = np.full(strain.shape, np.nan)
    none = type(strain.shear)(nothing, nothing, nothing, nothing)
    reason = np.full(strain.shape, "node-missing")
    empty = replace(
        strain, longitudinal_stretch=none, lateral_stretch=none, longitudinal_strain=none,
        lateral_strain=none, shear=none, poisson_ratio=none, reason=reason, poisson_reason=reason,
    )  # fmt: skip
    assert "none measured" in subject_page(subject_case(strain=empty, conformability=None))


def test_another_body_part_and_size_makes_a_report() -> None:
    patch = Patch(rows=3, columns=2, cell_mm=15.0, row_offset=1, column_offset=1)
    regions = Regions(labels=(("upper", "upper"), ("upper", "lower"), ("lower", "lower")))
    layout = Layout.of(Grid(rows=6, columns=5), patch, regions, "elbow")
    case = subject_case(
        side="left",
        layout=layout,
        conformability=conformability_case(
            rows=3, columns=2, side="left", missing=(), regions=regions
        ),
        strain=strain_case(rows=6, columns=5),
    )
    seen = outline(subject_page(case)).text
    assert "left elbow" in seen
    assert "patella" not in seen
    assert "Beside the paper" not in seen


def paper_row(case: SubjectReport) -> bool:
    return "91.7\u00a0%, 80.6\u00a0% and 77.8\u00a0%" in str(paper_section(case))


def test_the_papers_ratio_stands_only_beside_what_means_the_same() -> None:
    complete = conformability_case(missing=())
    assert paper_row(subject_case(conformability=complete))
    strict = conformability_case(missing=(), grade_by="strict")
    assert not paper_row(subject_case(conformability=strict))
    assert "not by the paper" in str(paper_section(subject_case(conformability=strict)))
    assert not paper_row(subject_case())  # one cell has no score
