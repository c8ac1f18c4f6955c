"""Arguments and options that several commands share, and what commands raise.

Only typer is imported at the top of this package's commands; each imports what it needs when it runs, so that help
comes at once.
"""

from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from mjsheaf.cli.terminal import print_note
from mjsheaf.errors import InputError, MjsheafError

if TYPE_CHECKING:
    from mjsheaf.io.figures import FigureOptions
    from mjsheaf.scenario import Scenario


Backend = StrEnum("Backend", ["PHYSICS", "IDEAL"])
"""What moves the vehicles; values are the names in small letters."""

Engine = StrEnum("Engine", ["MUJOCO", "FUSED"])
"""What moves bodies."""

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name from `mjsheaf list`, or the path of a YAML file.")
]
BackendOption = Annotated[Backend, typer.Option(help="MuJoCo bodies, or the paper's first-order kinematics.")]
EngineOption = Annotated[
    Engine, typer.Option(help="What moves bodies: MuJoCo, or the same equations compiled, faster and without contacts.")
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Threads that move bodies; results are the same.", show_default="idle cores"),
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
SeedOption = Annotated[int | None, typer.Option(help="Seed of disturbances and of spread initial conditions.")]
OutOption = Annotated[Path | None, typer.Option(metavar="DIR", help="Directory of the results.")]
VideoOption = Annotated[bool, typer.Option("--video/--no-video", help="Whether to draw the video.")]
LegendOption = Annotated[
    bool | None,
    typer.Option(
        "--legend/--no-legend",
        help="Explain colours, lines and arrows in a panel of the video next to the scene.",
        show_default="as the scenario says: legend",
    ),
]
QualityOption = Annotated[
    Literal["good", "draft"] | None,
    typer.Option(
        help="Of the video. A draft takes a fraction of the time: the scene is coarse, with hard edges, and there are "
        "at most 15 frames a second; the writing is as sharp.",
        show_default="as the scenario says: good",
    ),
]


ControllerOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE.py:NAME",
        help="A law of your own in Python, a function or class, called once a control period: law(t, sample) "
        "returns the agents' velocities, shape (N, 3), in m/s.",
    ),
]
FormatOption = Annotated[
    str, typer.Option("--format", metavar="F1[,F2,...]", help="Of the plots: png, svg, pdf, or several of them.")
]
TitleOption = Annotated[bool, typer.Option("--title/--no-title", help="Whether the plots have a title.")]


def figure_options(formats: str, title: bool) -> "FigureOptions":
    """What --format and --no-title say.

    Raises:
        InputError: there is no such format.
    """
    from mjsheaf.io.figures import FigureOptions

    return FigureOptions(tuple(formats.split(",")), title)


class NotHeldError(MjsheafError):
    """What was asked does not hold: an assumption, an expectation or a bound."""

    exit_code = 1


def prepare(
    source: str, overrides: Iterable[str] | None, seed: int | None, out: Path | None, backend: str, kind: str
) -> "tuple[Scenario, Path, str]":
    """The scenario of `run` or `compare`, the directory of its results, and its origin as they keep it.

    Raises:
        ScenarioError: the scenario or an override is not valid.
        PlaceError: the directory, not asked for by name, holds the results of another scenario of this name.
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
        InputError: it has another suffix, is a directory, or is not in one that exists.
    """
    if path.suffix not in suffixes or path.is_dir():
        raise InputError(f"{option} {path}: expected a file whose name ends in {' or '.join(suffixes)}")
    if not path.parent.is_dir():
        raise InputError(f"{option} {path}: there is no directory {path.parent}")


def note_idle_seed(scenario: str, backend: str) -> None:
    """Tell the user that the seed does not matter."""
    print_note(f"the seed changes nothing: {scenario} has no spread and no disturbance on backend {backend}")


def changes_of(overrides: Iterable[str] | None, seed: int | None = None) -> dict[str, Any]:
    """What --set and --seed change: field path to value.

    Raises:
        ScenarioError: one is not PATH=VALUE.
    """
    from mjsheaf.scenario.load import parse_override

    changes = dict(parse_override(text) for text in overrides or ())
    return changes if seed is None else {**changes, "seed": seed}
