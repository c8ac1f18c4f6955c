"""The `mjsheaf` command: what it can do, and one line for everything that goes wrong.

Only typer is imported here; each command imports what it needs, so that help comes at once.
"""

import atexit
import logging
import os
import signal
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from mjsheaf._version import __version__
from mjsheaf.cli.signals import Stopped, raise_if_stopped, stoppable, was_stopped
from mjsheaf.cli.streams import open_streams
from mjsheaf.errors import InputError, MjsheafError

app = typer.Typer(
    name="mjsheaf",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Teams of unlike vehicles track targets by a decentralized sheaf law, on ideal kinematics and MuJoCo bodies.",
    epilog="Begin with [bold]mjsheaf list[/bold], then [bold]mjsheaf run midpoint[/bold]. "
    "Exit codes: 0 done; 1 it does not hold; 2 bad input; 3 the simulation blew up.",
)

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name from `mjsheaf list`, or the path of a YAML file.")
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Override a field of the scenario; may be repeated. Items of lists go by id, name or number: "
        "controller.gain=30, agents.A1.heading=90, sensing.0.weight=2.",
    ),
]

QualityOption = Annotated[
    str | None,
    typer.Option(
        metavar="good|draft",
        help="Of the video. A draft takes a fraction of the time: the scene is coarse, with hard edges, and there are "
        "at most 15 frames a second; the writing is as sharp.",
        show_default="as the scenario says: good",
    ),
]


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


@app.command(
    epilog="Example: [bold]mjsheaf run paper --backend ideal --set controller.gain=30 --no-video[/bold]",
)
def run(
    scenario: ScenarioArgument,
    backend: Annotated[
        str, typer.Option(metavar="physics|ideal", help="MuJoCo bodies, or the paper's first-order kinematics.")
    ] = "physics",
    overrides: SetOption = None,
    seed: Annotated[int | None, typer.Option(help="Seed of disturbances and of spread initial conditions.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Directory of the results.", show_default="runs/NAME-BACKEND")
    ] = None,
    video: Annotated[bool, typer.Option("--video/--no-video", help="Whether to draw video.mp4.")] = True,
    expect: Annotated[
        bool, typer.Option("--expect", help="Exit with 1 if the run misses the scenario's `expect:` block.")
    ] = False,
    allow_drift: Annotated[
        bool, typer.Option("--allow-drift", help="Run it though agents are free to drift, against the least q*.")
    ] = False,
    quality: QualityOption = None,
) -> None:
    """Simulate a scenario and leave data, plots and a video.

    Writes result.nc, summary.json, scenario.yaml, errors.png, trajectories.png, configurations.png and video.mp4 into
    the directory, all at once when done. Refuses, with exit code 1, a team in which some agent is free to drift.
    """
    from mjsheaf.cli.run import run_command

    run_command(scenario, backend, overrides or [], seed, out, video, expect, allow_drift, quality)


@app.command(epilog="Example: [bold]mjsheaf video runs/paper-physics --speed 2 --azimuth 90 --elevation -60[/bold]")
def video(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a finished run.")],
    out: Annotated[Path | None, typer.Option(help="The MP4 to write.", show_default="DIR/video.mp4")] = None,
    width: Annotated[int | None, typer.Option(help="Frame width in pixels, even.")] = None,
    height: Annotated[int | None, typer.Option(help="Frame height in pixels, even.")] = None,
    fps: Annotated[int | None, typer.Option(help="Frames per second.")] = None,
    speed: Annotated[float | None, typer.Option(help="Simulated seconds per second of video.")] = None,
    azimuth: Annotated[float | None, typer.Option(help="Bearing of the camera, degrees.")] = None,
    elevation: Annotated[float | None, typer.Option(help="Elevation of the camera, degrees; -90 from above.")] = None,
    distance: Annotated[float | None, typer.Option(help="Distance of the camera, m; default follows the team.")] = None,
    trail: Annotated[float | None, typer.Option(help="Length of the trails, s.")] = None,
    scale: Annotated[float | None, typer.Option(help="Draw vehicles this many times larger.")] = None,
    quality: QualityOption = None,
) -> None:
    """Draw the video of a finished run again, without running it.

    What is not given is taken from the run's scenario.
    """
    from mjsheaf.cli.video import video_command

    changes = {
        "width": width,
        "height": height,
        "fps": fps,
        "speed": speed,
        "azimuth": azimuth,
        "elevation": elevation,
        "distance": distance,
        "trail": trail,
        "vehicle_scale": scale,
        "quality": quality,
    }
    video_command(directory, out, changes)


@app.command(epilog="Example: [bold]mjsheaf check air_tracks_surface --plot check.png[/bold]")
def check(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the record as JSON (see mjsheaf schema --check).")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw spectrum, graph and the bounded difference into this file.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="lambda_V of Theorem 1, 1/s; the best one unless given.")] = None,
    radius: Annotated[float, typer.Option(help="Ultimate radius for which the smallest gain is wanted, m.")] = 1.0,
    rho: Annotated[
        str | None,
        typer.Option(
            metavar="C0[,C1,...]",
            help="Your own bound of the agents' slopes, C0 + C1 |e| + ..., 1/s; the flow's unless given.",
        ),
    ] = None,
) -> None:
    """Decide the paper's assumptions for a scenario, and say who is free to drift and what would mend it.

    Computes Theorem 1 over the region to which its own bound confines the agents, the margins that theory leaves out,
    and which single loss breaks an assumption. Exit code 1 where a numbered assumption fails or is undecided, or the
    loop of the vehicles is unstable; the gain condition does not change it.
    """
    from mjsheaf.cli.check import check_command

    check_command(scenario, overrides or [], as_json, plot, rate, radius, rho)


@app.command(epilog="Example: [bold]mjsheaf compare midpoint --no-video[/bold]")
def compare(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    seed: Annotated[int | None, typer.Option(help="Seed of disturbances and of spread initial conditions.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Directory of the results.", show_default="runs/NAME-compare")
    ] = None,
    video: Annotated[bool, typer.Option("--video/--no-video", help="Whether to draw compare.mp4.")] = True,
) -> None:
    """Compare ideal kinematics with bodies: what each effect costs, and what to change.

    Climbs a ladder from the theory's kinematics to the scenario's own bodies, one effect at a time. Writes
    compare.json, report.txt, errors.png, budget.png, convergence.png, scenario.yaml and compare.mp4 (ideal left,
    bodies right).
    """
    from mjsheaf.cli.compare import compare_command

    compare_command(scenario, overrides or [], seed, out, video)


@app.command(epilog="Example: [bold]mjsheaf sweep midpoint --grid controller.gain=0.1,1,10 --seeds 0:20 --out s[/bold]")
def sweep(
    source: Annotated[
        str, typer.Argument(metavar="STUDY|SCENARIO", help="A study file or a scenario: a name, or a YAML file.")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="Directory of the study: new, or one to be gone on with.")],
    grid: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH=V1,V2,...", help="Sweep a field that --set reaches; each with every other."),
    ] = None,
    seeds: Annotated[str | None, typer.Option(metavar="A:B", help="Every point with the seeds A to B - 1.")] = None,
    overrides: SetOption = None,
    backend: Annotated[
        str | None, typer.Option(metavar="physics|ideal", help="As for run.", show_default="physics")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes of this machine.", show_default="one a core")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A dask scheduler that exists, instead of this machine.")
    ] = None,
    threads: Annotated[bool, typer.Option("--threads", help="Threads of one process instead of processes.")] = False,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Run again what ended otherwise than finished.")
    ] = False,
    trajectories: Annotated[
        bool, typer.Option("--trajectories", help="Keep result.nc of every run in DIR/trajectories.")
    ] = False,
    measure: Annotated[
        str | None, typer.Option(metavar="ERROR", help="The error that plots show.", show_default="all")
    ] = None,
) -> None:
    """Run a scenario many times, on every core or a cluster; killed at any moment, the same command goes on.

    Writes table.csv and table.parquet with a row a run, plots and index.html. A run that fails is told of in the table
    and the others go on; the exit code is then still 0.
    """
    from mjsheaf.cli.sweep import sweep_command

    sweep_command(
        source, grid or [], seeds, overrides or [], backend, workers, scheduler, threads, retry_failed, trajectories,
        measure, out,
    )  # fmt: skip


@app.command(epilog="Example: [bold]mjsheaf expect midpoint.yaml --update[/bold]")
def expect(
    scenario: ScenarioArgument,
    update: Annotated[bool, typer.Option("--update", help="Write the `expect:` block from what is found.")] = False,
    backend: Annotated[
        list[str] | None,
        typer.Option(
            metavar="physics|ideal", help="May be repeated; both, or those with an expectation, unless given."
        ),
    ] = None,
    margin: Annotated[float, typer.Option(help="How far --update puts bounds above what is found, as a share.")] = 0.05,
) -> None:
    """Hold runs of a scenario against its `expect:` block, or write that block from them.

    Writes no directory. Exit code 1 where an expectation is missed. --update keeps the rest of the file as it is; a
    team that is refused is expected to be refused, and a run that blows up is not written (exit code 3).
    """
    from mjsheaf.cli.expect import expect_command

    expect_command(scenario, update, backend or [], margin)


@app.command(epilog="Example: [bold]mjsheaf bench loop peers[/bold]")
def bench(
    topics: Annotated[
        list[str] | None, typer.Argument(metavar="[TOPIC]...", help="What to measure; everything unless given.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print figures and table as JSON.")] = False,
    full: Annotated[bool, typer.Option("--full", help="More repetitions and the largest sizes; minutes.")] = False,
) -> None:
    """Measure speed on this machine: each figure beside what it is held against, in about a minute.

    Topics: startup, ideal, loop, threads, peers, assembly, sheaf, video, memory.
    """
    from mjsheaf.cli.bench import bench_command

    bench_command(topics or [], as_json, full)


@app.command("list")
def list_(
    vehicles: Annotated[bool, typer.Option("--vehicles", help="List vehicles instead.")] = False,
) -> None:
    """List the scenarios and studies, or the vehicles, that come with mjsheaf."""
    from mjsheaf.cli.listing import list_scenarios_command, list_vehicles_command

    if vehicles:
        list_vehicles_command()
    else:
        list_scenarios_command()


@app.command()
def schema(
    check: Annotated[bool, typer.Option("--check", help="Of the record that `check --json` prints instead.")] = False,
    compare: Annotated[bool, typer.Option("--compare", help="Of compare.json instead.")] = False,
    study: Annotated[bool, typer.Option("--study", help="Of a study file, for sweep, instead.")] = False,
) -> None:
    """Print the JSON Schema of a scenario file."""
    if study:
        from mjsheaf.cli.sweep import print_schema as print_schema_of_study

        print_schema_of_study()
        return
    if compare:
        from mjsheaf.cli.compare import print_schema

        print_schema()
        return
    from mjsheaf.cli.listing import schema_command

    schema_command(check)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line and exit."""
    open_streams()
    code = _exit_code(arguments)
    if was_stopped():
        _leave(code)
    sys.exit(code)


def _leave(code: int) -> NoReturn:
    """End the process where a signal has stopped its work, without taking the interpreter down.

    Threads may still be inside MuJoCo or OpenGL, which crash when what they use is freed.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    atexit._run_exitfuncs()  # which end processes that libraries began
    os._exit(code)


def _exit_code(arguments: list[str] | None) -> int:
    # What matters of a library's warnings is in the one line that mjsheaf prints. dm_control sends MuJoCo's to absl.
    for library in ("absl", "imageio_ffmpeg", "matplotlib"):
        logging.getLogger(library).setLevel(logging.ERROR)
    if sys.stderr.isatty():
        logger = logging.getLogger("mjsheaf")
        logger.setLevel(logging.INFO)
        logger.addHandler(_Notes())
    try:
        with warnings.catch_warnings(), stoppable():
            if not sys.warnoptions:
                warnings.simplefilter("ignore")
            try:
                code: Any = app(arguments, standalone_mode=False)
                sys.stdout.flush()  # here what it cannot say still has an exit code
            except Exception:
                # A terminal's signal reaches ffmpeg too, whose end may be noticed first; and what is raised while a
                # library is loaded comes out as an error of that.
                raise_if_stopped()
                raise
            except SystemExit as stop:
                if isinstance(stop.__context__, BrokenPipeError):  # which the command-line library turns into this
                    return _end_of_pipe()
                raise
        return code if isinstance(code, int) else 0
    except MjsheafError as error:
        return _complain(str(error), error.exit_code)
    except Stopped as stopped:
        return _complain(stopped.message, int(stopped.code or 1))
    except BrokenPipeError:
        return _end_of_pipe()
    except OSError as error:
        return _complain(f"{_place_of(error)}: {error.strerror or error}", InputError.exit_code)
    except MemoryError as error:
        return _complain(f"not enough memory: {error}; ask for fewer samples or vehicles", InputError.exit_code)
    except Exception as error:
        # Usage errors are a class of the command-line library; older and newer releases keep it in different places.
        if not hasattr(error, "format_message"):
            raise
        message = error.format_message()  # empty where help itself was the answer
        return _complain(f"{message} (see mjsheaf --help)", InputError.exit_code) if message else InputError.exit_code


class _Notes(logging.Handler):
    """What the package tells of itself goes to stderr, wherever that is by then: progress bars redirect it."""

    def emit(self, record: logging.LogRecord) -> None:
        print(f"note: {record.getMessage()}", file=sys.stderr)


def _end_of_pipe() -> int:
    """The reader of the output went away, as `head` does: the code of what SIGPIPE ends."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what is still to be flushed
    return 128 + signal.SIGPIPE


def _place_of(error: OSError) -> str:
    """What an error of the operating system is about."""
    if error.filename is not None:
        return os.fsdecode(error.filename)
    try:
        os.getcwd()
    except OSError:
        return "the working directory is gone"
    return "input or output"


def _complain(message: str, code: int) -> int:
    with suppress(OSError):  # a terminal that has hung up
        print(f"mjsheaf: {' '.join(message.split())}", file=sys.stderr)
    return code
