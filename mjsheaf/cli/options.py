"""Arguments and options that several commands share, and what commands raise.

Only typer is imported at the top of this package's commands; each imports what it needs when it runs, so that help
comes at once.
"""

from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from mjsheaf.errors import MjsheafError


class Backend(StrEnum):
    """What moves the vehicles."""

    PHYSICS = "physics"
    IDEAL = "ideal"


ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A name from `mjsheaf list`, or the path of a YAML file.")
]
BackendOption = Annotated[Backend, typer.Option(help="MuJoCo bodies, or the paper's first-order kinematics.")]
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
QualityOption = Annotated[
    Literal["good", "draft"] | None,
    typer.Option(
        help="Of the video. A draft takes a fraction of the time: the scene is coarse, with hard edges, and there are "
        "at most 15 frames a second; the writing is as sharp.",
        show_default="as the scenario says: good",
    ),
]


class NotHeldError(MjsheafError):
    """What was asked does not hold: an assumption, an expectation or a bound."""

    exit_code = 1


def changes_of(overrides: Iterable[str] | None, seed: int | None = None) -> dict[str, Any]:
    """What --set and --seed change: field path to value.

    Raises:
        ScenarioError: one is not PATH=VALUE.
    """
    from mjsheaf.scenario.load import parse_override

    changes = dict(parse_override(text) for text in overrides or ())
    return changes if seed is None else {**changes, "seed": seed}
