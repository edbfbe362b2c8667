"""The `levelhead` command: one verb, one file; errors are one sentence on stderr."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from levelhead.cli import check, compare, convert, demo, estimate, simulate, tune, validate
from levelhead.cli.console import say_error
from levelhead.errors import LevelheadError
from levelhead.version import __version__

app = typer.Typer(
    name="levelhead",
    help="What is wrong with a land vehicle's inertial sensors: gyro and accelerometer biases, roll, pitch and heading "
    "from its IMU + GNSS log.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(demo.demo)
app.command()(estimate.estimate)
app.command()(check.check)
app.command()(compare.compare)
app.command()(tune.tune)
app.command()(validate.validate)
app.command()(simulate.simulate)
app.command()(convert.convert)


def _show_version(show: bool) -> None:
    if show:
        typer.echo(f"levelhead {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    _debug: Annotated[bool, typer.Option("--debug", help="Show a traceback on errors.")] = False,
) -> None:
    """Options before the verb; `main` looks for --debug itself, because it must know it when everything else fails."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit: 0 done, 1 unexpected, 2 usage, 3 the log was not read whole or not trusted."""
    given = sys.argv[1:] if arguments is None else arguments
    debug = given[:1] == ["--debug"]
    try:
        app(args=given)
    except LevelheadError as error:
        if debug:
            raise
        say_error(str(error))
        raise SystemExit(error.exit_code) from error
    except Exception as error:
        if debug:
            raise
        say_error(f"Unexpected {type(error).__name__}: {error}. Run `levelhead --debug ...` and report what it shows.")
        raise SystemExit(1) from error
