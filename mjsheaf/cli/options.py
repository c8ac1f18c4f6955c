"""Arguments, options and errors that several commands share.

Modules of this package import only typer at the top. Each command imports the rest when it runs, so that help appears
at once.
"""

from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from mjsheaf.cli.terminal import print_note
from mjsheaf.errors import InputError, MjsheafError, raise_first

if TYPE_CHECKING:
    from mjsheaf.scenario import Scenario
    from mjsheaf.show.style import FigureOptions


Backend = StrEnum("Backend", ["PHYSICS", "IDEAL"])
"""Model of the vehicles' motion; values are the names in lower case."""

Engine = StrEnum("Engine", ["MUJOCO", "FUSED"])
"""Engine that simulates bodies."""

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name from `mjsheaf list`, or the path of a YAML file.")
]
BackendOption = Annotated[Backend, typer.Option(help="MuJoCo bodies, or the paper's first-order kinematics.")]
EngineOption = Annotated[
    Engine,
    typer.Option(
        help="Engine for bodies: MuJoCo, or the same equations compiled, which is faster but has no contacts."
    ),
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Maximum number of threads of the fused engine; MuJoCo uses one. Results do not depend on it.",
        show_default="all cores",
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Override a field of the scenario; may be repeated. Select items of lists by id, name or index: "
        "controller.gain=30, agents.A1.heading=90, sensing.0.weight=2.",
    ),
]
SeedOption = Annotated[int | None, typer.Option(help="Seed of disturbances and of random initial conditions.")]
OutOption = Annotated[Path | None, typer.Option(metavar="DIR", help="Directory for the results.")]
VideoOption = Annotated[bool, typer.Option("--video/--no-video", help="Draw a video.")]
QualityOption = Annotated[
    Literal["good", "draft"] | None,
    typer.Option(
        help="Quality of the video. A draft takes a fraction of the time: the scene is coarse, with hard edges, at "
        "most 15 frames per second. Text stays sharp.",
        show_default="as the scenario says: good",
    ),
]


ControllerOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.py:NAME",
        help="Your own law in Python: a function or class, called once per control period. law(t, sample) "
        "returns the agents' velocities, shape (N, 3), in m/s.",
    ),
]
FormatOption = Annotated[
    str, typer.Option("--format", metavar="F1[,F2,...]", help="Formats of the plots: png, svg, pdf, or several.")
]
McapOption = Annotated[
    bool, typer.Option("--mcap", help="Write run.mcap, a log for Foxglove or PlotJuggler. Needs the extra mcap.")
]
Ros2Option = Annotated[
    bool, typer.Option("--ros2", help="Write run_ros2/, a bag for ROS 2 tools such as RViz. Needs the extra mcap.")
]
TitleOption = Annotated[bool, typer.Option("--title/--no-title", help="Give the plots a title.")]


def figure_options(formats: str, title: bool) -> "FigureOptions":
    """Return the options of figures that --format and --no-title select.

    Raises:
        InputError: There is no such format.
    """
    from mjsheaf.show.style import FigureOptions

    return FigureOptions(tuple(formats.split(",")), title)


def formats_of(mcap: bool, ros2: bool) -> list[str]:
    """Return the keys of `mjsheaf.export.FORMATS` that --mcap and --ros2 select."""
    return [name for name, chosen in (("mcap", mcap), ("ros2", ros2)) if chosen]


class NotHeldError(MjsheafError):
    """An assumption, an expectation or a bound does not hold."""

    exit_code = 1


def prepare(
    source: str, overrides: Iterable[str] | None, seed: int | None, out: Path | None, backend: str, kind: str
) -> "tuple[Scenario, Path, str]":
    """Return the scenario of `run` or `compare`, the directory for its results, and its origin.

    Raises:
        ScenarioError: The scenario or an override is not valid.
        PlaceError: The default directory contains results of another scenario with the same name.
    """
    from mjsheaf.results.store import require_same_origin
    from mjsheaf.scenario.load import load_scenario, origin

    changes = changes_of(overrides, seed)
    scenario = load_scenario(source, changes)
    if "seed" in changes and not scenario.uses_seed(backend):
        note_idle_seed(scenario.name, backend)
    directory = Path("runs") / f"{scenario.name}-{kind}" if out is None else out
    where = origin(source, directory)
    if out is None:
        require_same_origin(directory, where)
    return scenario, directory, where


def require_file_name(option: str, path: Path, *suffixes: str) -> None:
    """Refuse the name of a file that cannot be written.

    Raises:
        InputError: The name has another suffix or is a directory, or its directory does not exist.
    """
    expected = f"{option} {path}: expected a file whose name ends in {' or '.join(suffixes)}"
    raise_first(
        InputError,
        {
            expected: path.suffix not in suffixes or path.is_dir(),
            f"{option} {path}: there is no directory {path.parent}": not path.parent.is_dir(),
        },
    )


def note_idle_seed(scenario: str, backend: str) -> None:
    """Print a note that the seed has no effect."""
    print_note(f"the seed changes nothing: {scenario} has no spread and no disturbance on backend {backend}")


def changes_of(overrides: Iterable[str] | None, seed: int | None = None) -> dict[str, Any]:
    """Return the changes made by --set and --seed: field path to value.

    Raises:
        ScenarioError: An override is not PATH=VALUE.
    """
    from mjsheaf.scenario.load import parse_override

    changes = dict(parse_override(text) for text in overrides or ())
    return changes if seed is None else {**changes, "seed": seed}
