"""The launcher: finds the command, reads the settings, prints the outcome, sets the exit code."""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import App, CycloptsError, Parameter
from cyclopts.config import Toml

from kiribench import __version__
from kiribench.cli.command import Common, Outcome
from kiribench.cli.settings import effective_settings
from kiribench.errors import (
    EXIT_BUG,
    EXIT_INTERRUPTED,
    EXIT_OK,
    Fault,
    KiribenchError,
    UsageError,
)

#: Every command with its line in ``kiribench --help``; the function's own docstring says more.
COMMANDS = {
    "validate": "Check a dataset and report every fault at once.",
    "measure": "Measure skin strain cell by cell from two bare scans.",
    "conform": "Score how well each patch cell lies on its cell of skin.",
    "simulate": "Simulate kirigami sheets by finite elements.",
    "calibrate": "Fit hyperelastic laws to a tension test, with uncertainty.",
    "cv": "Compare surrogate models by cross-validation.",
    "fit": "Fit a surrogate model and keep it.",
    "predict": "Predict Poisson's ratio with a kept surrogate.",
    "check": "Simulate designs as worn and score them before they are cut.",
    "export": "Write the files for the laser and read them again.",
    "tensile": "Measure strain and Poisson's ratio in the pictures of a tensile test.",
    "design": "Design the cuts of a patch from strain targets.",
    "synth": "Make synthetic subjects with known truth.",
    "regress": "Check the synthetic subjects against truth and record.",
    "demo": "Score the three synthetic subjects and write the report.",
}
SETTINGS_FILE = "kiribench.toml"


def build_app() -> App:
    """The command line application with all commands registered by name only."""
    app = App(
        name="kiribench",
        help="Validation and conformability analysis of body-conformable kirigami patches.",
        help_epilogue=(
            "Exit codes: 0 ok, 1 a gate failed, 2 usage, 3 bad data, 4 not converged, "
            "70 a bug of ours, 130 interrupted."
        ),
        version=__version__,
        help_format="markdown",
        suppress_keyboard_interrupt=False,
    )
    for name, line in COMMANDS.items():
        app.command(f"kiribench.cli.{name}:{name}", name=name, help=line)
    app.register_install_completion_command(add_to_startup=False)
    return app


def main(tokens: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code (see :mod:`kiribench.errors`)."""
    argv = list(sys.argv[1:] if tokens is None else tokens)
    as_json = "--json" in argv
    try:
        return _launch(argv)
    except CycloptsError as error:
        error_ = UsageError(
            "usage",
            str(error).strip(),
            remedy="See 'kiribench --help' or 'kiribench COMMAND --help'.",
        )
        return _report_error(error_, as_json)
    except KiribenchError as error:
        return _report_error(error, as_json)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        _reader_gone()
        return EXIT_OK
    except SystemExit as error:  # cyclopts ends --help and --version so
        return error.code if isinstance(error.code, int) else EXIT_OK
    except Exception as error:  # noqa: BLE001 - the last resort, named as our bug
        return _report_bug(error, as_json)


def _launch(argv: list[str]) -> int:
    app = build_app()
    exit_code = EXIT_OK

    @app.meta.default
    def launcher(
        *argument: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
        config: Path | None = None,
    ) -> None:
        """Read the settings file, then run the command.

        Parameters
        ----------
        config
            Settings file (TOML), one table a command with the same names as the flags; flags
            win. Without it, kiribench.toml of the current folder is read if it is there.
        """
        nonlocal exit_code
        exit_code = _run(app, list(argument), config)

    app.meta.suppress_keyboard_interrupt = False
    app.meta(argv, exit_on_error=False, print_error=False, result_action="return_value")
    return exit_code


def _run(app: App, argv: list[str], config: Path | None) -> int:
    if config is not None and not config.is_file():
        raise UsageError(
            "settings-missing",
            "The settings file does not exist.",
            file=config,
            remedy="Check the path given with --config.",
        )
    app.config = (Toml(config or SETTINGS_FILE, must_exist=False),)
    command, bound, _ = app.parse_args(argv, exit_on_error=False, print_error=False)
    if not getattr(command, "__module__", "").startswith("kiribench.cli."):
        command(*bound.args, **bound.kwargs)  # --help, --version, completion
        return EXIT_OK
    bound.apply_defaults()
    common = bound.arguments.get("common") or Common()
    bound.arguments["common"] = common
    if common.out is not None:
        _make_out(common.out)
    outcome = command(*bound.args, **bound.kwargs)
    if not isinstance(outcome, Outcome):
        raise TypeError(f"command {command.__name__} gave {type(outcome).__name__}, not Outcome")
    _publish(command.__name__, outcome, common, effective_settings(bound.arguments, config))
    return outcome.exit_code


def _make_out(folder: Path) -> None:
    """Make the folder of the results first, so that no long computation ends in vain."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        writable = os.access(folder, os.W_OK | os.X_OK)
        why = "no permission to write"
    except OSError as error:  # a file in its place, a read-only disk, a name too long
        writable, why = False, error.strerror or type(error).__name__
    if not writable:
        raise UsageError(
            "out-not-writable",
            "The folder of the results cannot be written.",
            file=folder,
            remedy="Give --out a folder that can be made and written, not a file.",
            got=why,
        )


def _publish(name: str, outcome: Outcome, common: Common, settings: dict[str, Any]) -> None:
    from kiribench.provenance import provenance

    result = {
        **outcome.result,
        "settings": settings,
        "provenance": provenance(outcome.inputs),
    }
    text = json.dumps(result, indent=2, allow_nan=False, ensure_ascii=False)
    if common.out is not None:
        common.out.mkdir(parents=True, exist_ok=True)
        (common.out / f"{name}.json").write_text(text + "\n", encoding="utf-8")
    for fault in outcome.faults:
        if fault.severity == "error" or not common.quiet:
            print(fault, file=sys.stderr)
    _say(text if common.json else outcome.text)


def _report_error(error: KiribenchError, as_json: bool) -> int:
    for fault in error.faults:
        print(fault, file=sys.stderr)
    if as_json:
        _print_error_object(error.faults)
    return error.exit_code


def _report_bug(error: Exception, as_json: bool) -> int:
    traceback.print_exception(error)
    fault = Fault(
        "bug",
        f"This is a bug of kiribench: {type(error).__name__}: {error}",
        "Please report it with the lines above and, if you can, the input.",
    )
    print(fault, file=sys.stderr)
    if as_json:
        _print_error_object((fault,))
    return EXIT_BUG


def _print_error_object(faults: Sequence[Fault]) -> None:
    error = {"schema": "kiribench.error/1", "faults": [fault.as_dict() for fault in faults]}
    _say(json.dumps(error, indent=2))


def _say(text: str) -> None:
    """Print; a reader that has gone (``| head``) changes neither the exit code nor the log."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _reader_gone()


def _reader_gone() -> None:
    """Nobody reads our output any more: what is left of it goes nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
