"""One self-contained HTML file of a tension test: curve, fits, errors, what the choice changes."""

from __future__ import annotations

from pathlib import Path

from kiribench.calibration.curve import STRAIN_SOURCE_WORDS
from kiribench.calibration.fit import WEIGHTING_WORDS
from kiribench.calibration.study import NOT_SIMULATED, Study, choice_words, stability_words
from kiribench.report.figures.calibrate import choice_figure, curve_figure, error_figure
from kiribench.report.html import Html, bullets, table, tag, text
from kiribench.report.page import document
from kiribench.report.svg import figure_block


def write_calibrate_report(path: Path, found: Study) -> Path:
    """Write the page of a study to ``path``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(calibrate_page(found), encoding="utf-8", newline="\n")
    return path


def calibrate_page(found: Study) -> str:
    """The whole HTML document; the same study gives the same text."""
    sections = [_head(found), _curve(found), _parameters(found), _ranges(found), _given(found)]
    if found.pulls:
        sections.append(_choice(found))
    sections.append(_set_up(found))
    return document("kiribench: calibration", text([tag("main", sections)]))


def _head(found: Study) -> Html:
    curve = found.curve
    name = "tension test" if curve.file is None else curve.file.name
    return tag(
        "header",
        tag("p", "Calibration", class_="kicker"),
        tag("h1", f"{name}: {len(curve.stretch)} rows up to strain {curve.strain[-1]:.2f}"),
        tag("p", found.verdict, class_="verdict"),
        bullets(
            [
                f"Strain by {STRAIN_SOURCE_WORDS[curve.source]}.",
                *(fault.what for fault in curve.notes),
                "One pull of one sample: how samples and batches differ is not in any interval "
                "here.",
                *([f"Data: {found.attribution}"] if found.attribution else []),
            ]
        ),
    )


def _curve(found: Study) -> Html:
    fit = found.fits[0]
    return tag(
        "section",
        tag("h2", "Test and fits"),
        figure_block(
            curve_figure(found),
            f"Dots: the test. Lines: laws fitted by least squares on strains {fit.range} (grey); "
            f"{WEIGHTING_WORDS[fit.weighting]}. Outside of the grey the lines are extrapolated.",
        ),
        figure_block(
            error_figure(found),
            "Error of each law's stress relative to the test. Above 0 the law is too stiff.",
        ),
    )


def _parameters(found: Study) -> Html:
    rows = []
    for fit, left in zip(found.fits, found.left, strict=True):
        for k, name in enumerate(fit.parameters):
            first = k == 0
            spread = left.jackknife_sd[k]
            rows.append(
                (
                    fit.name if first else "",
                    name.removesuffix("_mpa") + (", MPa" if name.endswith("_mpa") else ""),
                    f"{fit.values[k]:.4g}",
                    f"± {fit.uncertainty.half_width[k]:.2g}",
                    f"{fit.uncertainty.noise_sd[k]:.1g}",
                    f"{fit.uncertainty.misfit_sd[k]:.2g}",
                    f"{spread:.2g}" if spread == spread else "-",
                    f"{fit.rms_mpa:.4f}" if first else "",
                    f"{left.bridged_mpa:.4f} / {left.beyond_mpa:.4f}" if first else "",
                )
            )
    vanished = [
        f"{fit.name}: {fit.vanished} of its terms vanish; no further stable term fits better."
        for fit in found.fits
        if fit.vanished
    ]
    return tag(
        "section",
        tag("h2", "Parameters"),
        table(
            (
                "Law", "Parameter", "Value", "95 % interval", "sd, noise", "sd, misfit",
                "sd, parts left out", "rms", "rms of left-out parts (inner / last)",
            ),
            rows,
            caption="Least squares; the interval takes residuals of neighbouring rows as related; "
            "rms in MPa",
            numeric=(2, 3, 4, 5, 6, 7),
        ),
        bullets(
            [
                "Noise: what the readings scatter by. Misfit: what hangs together along the "
                "curve, above all what the law cannot follow; it wanders no more slowly than 0.3 "
                "of the range, for slower errors cannot be told from the parameters.",
                *(f"{fit.name}, Drucker: {stability_words(fit)}." for fit in found.fits),
                *vanished,
            ]
        ),
    )  # fmt: skip


def _ranges(found: Study) -> Html:
    ends = [one.range.high for one in found.ranges[0]]
    rows = []
    for fit, ranges in zip(found.fits, found.ranges, strict=True):
        cells = [
            "-"
            if not one.rows
            else f"{one.rms_mpa:.4f} ({100 * one.worst:+.0f} %){'' if one.fitted else ' *'}"
            for one in ranges
        ]
        rows.append((fit.name, *cells))
    return tag(
        "section",
        tag("h2", "How well, up to which strain"),
        table(
            ("Law", *(f"0 to {end:g}" for end in ends)),
            rows,
            caption="rms error of the nominal stress, MPa, and largest relative error; * beyond "
            "the fit, - beyond the test",
            numeric=tuple(range(1, len(ends) + 1)),
        ),
    )


def _given(found: Study) -> Html:
    given = found.given
    held = (
        f"It is the least-squares neo-Hookean modulus of strains up to {given.equal_up_to:.2f}."
        if given.equal_up_to is not None
        else "It is the least-squares neo-Hookean modulus of no range of this test."
    )
    return tag(
        "section",
        tag("h2", f"Neo-Hookean, {given.mu_mpa:g} MPa"),
        tag("p", held),
        table(
            ("Strain", *(f"{x:g}" for x in given.stress_error)),
            [("Error", *(f"{100 * e:+.0f} %" for e in given.stress_error.values()))],
            caption="Its stress relative to the test",
            numeric=tuple(range(1, len(given.stress_error) + 1)),
        ),
        table(
            ("Fitted up to", *(f"{x:g}" for x in given.modulus_by_range)),
            [("mu, MPa", *(f"{mu:.4f}" for mu in given.modulus_by_range.values()))],
            caption="Least-squares neo-Hookean modulus by range",
            numeric=tuple(range(1, len(given.modulus_by_range) + 1)),
        ),
    )


def _choice(found: Study) -> Html:
    words = [line for pulls in found.pulls for line in choice_words(pulls)]
    return tag(
        "section",
        tag("h2", "What the choice changes in a cut sheet"),
        figure_block(
            choice_figure(found),
            "The periodic cell pulled with each law at prescribed stretch. Tip stress: largest "
            "principal true stress, mean over the material within 4 % of a cell of the cut tips; "
            "it compares laws and is no strength.",
        ),
        bullets(words),
        tag("p", NOT_SIMULATED),
    )


def _set_up(found: Study) -> Html:
    whats = [change.what for change in found.changes[0]]
    return tag(
        "section",
        tag("h2", "What errors of the set-up would do"),
        table(
            ("Law", *whats),
            [
                (fit.name, *(f"{change.modulus_percent:+.1f} %" for change in changes))
                for fit, changes in zip(found.fits, found.changes, strict=True)
            ],
            caption="Change of the initial shear modulus; one pull cannot tell these from the "
            "material",
            numeric=tuple(range(1, len(whats) + 1)),
        ),
    )
