"""The `mjsheaf` command: what it can do, and one line for everything that goes wrong."""

import atexit
import gc
import logging
import os
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any

import typer

from mjsheaf._version import __version__
from mjsheaf.cli.options import Stopped, open_streams, raise_if_stopped, stoppable, was_stopped
from mjsheaf.cli.run import compare, compare_runs, expect, plot, report, run, sweep, video
from mjsheaf.cli.tools import check, export, list_, new, schema, view
from mjsheaf.errors import InputError, MjsheafError, printable

app = typer.Typer(
    name="mjsheaf",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Simulate teams of boats and drones that track targets under a decentralized sheaf law, on ideal kinematics "
    "or MuJoCo bodies.",
    epilog="Start with [bold]mjsheaf list[/bold] and [bold]mjsheaf run midpoint[/bold], then [bold]mjsheaf new mine"
    "[/bold]. Exit codes: 0 success; 1 an assumption, expectation or bound does not hold; 2 bad input; "
    "3 the simulation diverged.",
)

_COMMANDS: dict[Callable[..., None], str] = {
    run: "paper --backend ideal --set controller.gain=30 --no-video",
    video: "runs/paper-physics --speed 2 --azimuth 90 --elevation -60",
    plot: "runs/paper-physics --format pdf --no-title --out figures",
    report: "runs/paper-physics",
    export: "runs/paper-physics --mcap",
    view: "midpoint --backend ideal",
    check: "air_tracks_surface --plot check.png",
    compare: "midpoint --no-video",
    compare_runs: "runs/midpoint-ideal runs/midpoint-physics",
    sweep: "midpoint --grid controller.gain=0.1,1,10 --seeds 0:20 --out s",
    expect: "midpoint.yaml --update",
    new: "mine",
    list_: "--vehicles mine.yaml",
    schema: "--study",
}
"""Commands in the order of the help, and an example of each."""

for _command, _example in _COMMANDS.items():
    _name = _command.__name__.rstrip("_").replace("_", "-")
    app.command(_name, epilog=f"Example: [bold]mjsheaf {_name} {_example}[/bold]")(_command)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"mjsheaf {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit."""
    # Libraries make objects by the hundred thousand as they are loaded, little of it garbage: with Python's own
    # thresholds, looking for it takes a tenth of a short command's time.
    gc.set_threshold(10_000, 10, 10)
    open_streams()
    code = _exit_code(arguments)
    if not was_stopped():
        sys.exit(code)
    # Without taking the interpreter down: threads may still be inside MuJoCo or OpenGL, which crash when what they use
    # is freed.
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    atexit._run_exitfuncs()  # which end processes that libraries began
    os._exit(code)


def _exit_code(arguments: list[str] | None) -> int:
    """Run the command line and return its exit code; an error is printed in a line."""
    if sys.stderr.isatty():
        logger = logging.getLogger("mjsheaf")
        logger.setLevel(logging.INFO)
        logger.addHandler(_Notes())
    try:
        with warnings.catch_warnings(), stoppable():
            if not sys.warnoptions:
                warnings.simplefilter("ignore")
            return _run(arguments)
    except MjsheafError as error:
        return _complain(*error.args, code=error.exit_code)
    except Stopped as stopped:
        return _complain(stopped.message, code=int(stopped.code or 1))
    except BrokenPipeError:
        return _end_of_pipe()
    except OSError as error:
        return _complain(f"{_place_of(error)}: {error.strerror or error}")
    except ImportError as error:  # also a library without memory
        return _complain(f"cannot load what it needs: {error}")
    except (MemoryError, SystemError) as error:  # libraries that run out of memory in C raise the second one
        return _complain(f"not enough memory: use fewer samples or vehicles. {error}".strip())
    except Exception as error:
        return _refuse_usage(error)


def _run(arguments: list[str] | None) -> int:
    """Run the command line and return its exit code."""
    # What matters of a library's warnings is in the one line that mjsheaf prints.
    for library in ("imageio_ffmpeg", "matplotlib"):
        logging.getLogger(library).setLevel(logging.ERROR)
    try:
        code: Any = app(arguments, standalone_mode=False)
        sys.stdout.flush()  # here what it cannot say still has an exit code
    except Exception:
        # A terminal's signal reaches ffmpeg too, whose end may be noticed first; and what is raised while a library is
        # loaded comes out as an error of that.
        raise_if_stopped()
        raise
    except SystemExit as stop:
        if isinstance(stop.__context__, BrokenPipeError):  # which the command-line library turns into this
            return _end_of_pipe()
        raise
    return code if isinstance(code, int) else 0


def _refuse_usage(error: Exception) -> int:
    """Print what is wrong with the command's arguments, and return the exit code; raise any other error again.

    Usage errors are a class of the command-line library. Older and newer releases keep it in different places.
    """
    if not hasattr(error, "format_message"):
        raise error
    message = error.format_message()  # empty where help itself was the answer
    for its, ours in _PLAINER.items():
        message = message.replace(its, ours)
    return _complain(f"{message} (see mjsheaf --help)") if message else InputError.exit_code


_PLAINER = {
    "Value error, ": "",
    "Input should be greater than or equal to ": "expected at least ",
    "Input should be less than or equal to ": "expected at most ",
    "Input should be ": "expected ",
    " is not one of ": ": expected one of ",
}
"""What the command-line library and its validator say, and what mjsheaf says."""


class _Notes(logging.Handler):
    """Handler that prints log messages to the current stderr, which progress bars may redirect."""

    def emit(self, record: logging.LogRecord) -> None:
        print(f"note: {printable(record.getMessage())}", file=sys.stderr)


def _end_of_pipe() -> int:
    """The reader of the output went away, as `head` does: the code of what SIGPIPE ends."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is still to be flushed
    return 128 + signal.SIGPIPE


def _place_of(error: OSError) -> str:
    """Return the file or stream that an error of the operating system refers to."""
    if error.filename is not None:
        return os.fsdecode(error.filename)
    try:
        os.getcwd()
    except OSError:
        return "the working directory is gone"
    return "input or output"


def _complain(*lines: str, code: int = InputError.exit_code) -> int:
    with suppress(OSError):  # a terminal that has hung up
        for line in lines:
            print(f"mjsheaf: {printable(' '.join(line.split()))}", file=sys.stderr)
    return code
