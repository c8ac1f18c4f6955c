"""`mjsheaf view`: a run in the browser while it proceeds, or the page of a finished one."""

import math
import webbrowser
from contextlib import ExitStack
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mjsheaf.cli.options import (
    Backend,
    BackendOption,
    Engine,
    EngineOption,
    SeedOption,
    SetOption,
    changes_of,
)
from mjsheaf.cli.terminal import print_lines, progress_bars, saying_what_is_kept
from mjsheaf.errors import InputError, in_field

if TYPE_CHECKING:
    from mjsheaf.scenario import Scenario


def view(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|DIR", help="A scenario as for `mjsheaf run`, or the directory of a finished run."
        ),
    ],
    backend: BackendOption = Backend.PHYSICS,
    overrides: SetOption = None,
    seed: SeedOption = None,
    engine: EngineOption = Engine.MUJOCO,
    speed: Annotated[
        float, typer.Option(help="Initial speed in simulated seconds per second; 0 for as fast as possible.")
    ] = 1.0,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="New directory for the recorded scenario.", show_default="runs/NAME-live"),
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0 takes a free one.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
) -> None:
    """Run a scenario in the browser: pause, set speed, gain and flow, lose agents, cut links. Or open a finished run.

    The page is served on 127.0.0.1 only, to one client, at an address with a random token. Closing it ends the
    command. What you do is recorded as the `events:` of a scenario that reproduces the session bit for bit.
    """
    if Path(source).is_dir():
        _open_finished(Path(source), browser)
        return
    with ExitStack() as loading:
        loading.enter_context(progress_bars("preparing the run"))
        from mjsheaf.live.live import SPEEDS
        from mjsheaf.live.live import view as view_live
        from mjsheaf.scenario.load import load_scenario

        if speed != 0.0 and speed not in SPEEDS:
            raise InputError(f"--speed {speed:g}: expected 0 or one of {', '.join(f'{s:g}' for s in SPEEDS)}")
        if out is not None and out.exists():
            raise InputError(f"--out {out}: exists; expected the name of a new directory")
        loaded = load_scenario(source, changes_of(overrides, seed))
        kept = ["nothing was written"]

        def announce(url: str) -> None:
            loading.close()
            print_lines(f"open in a browser: {url}", "the run starts when the page opens and ends when it is closed")
            if browser:
                webbrowser.open(url)

        def record(scenario: "Scenario") -> None:
            directory = _write(scenario, out or _new_directory(f"{loaded.name}-{backend}-live"))
            other = "" if engine is Engine.MUJOCO else f" --engine {engine}"
            again = f"mjsheaf run {directory / 'scenario.yaml'} --backend {backend}{other}"
            number = len(scenario.events) - len(loaded.events)
            kept[0] = f"{number} event{'' if number == 1 else 's'} recorded; the session again: {again}"

        pace = speed or math.inf
        with in_field(source), saying_what_is_kept(lambda: kept[0]):
            view_live(loaded, str(backend), engine=str(engine), port=port, speed=pace, opened=announce, recorded=record)
    print_lines(kept[0])


def _new_directory(name: str) -> Path:
    """Return a directory in runs/ that does not exist."""
    names = chain([name], (f"{name}-{number}" for number in count(2)))
    return next(path for path in (Path("runs") / own for own in names) if not path.exists())


def _write(scenario: "Scenario", directory: Path) -> Path:
    """Write a scenario with what it refers to into a new directory, and return that."""
    from mjsheaf.io.files import naming, whole_directory
    from mjsheaf.runs.publish import write_scenario

    with naming(directory):
        directory.parent.mkdir(parents=True, exist_ok=True)
        with whole_directory(directory) as fresh:
            write_scenario(scenario, fresh)
    return directory


def _open_finished(directory: Path, browser: bool) -> None:
    """Open the page of a finished run; write it first if it is missing."""
    from mjsheaf.page import write_page_again
    from mjsheaf.results.store import open_run

    path = directory / "report.html"
    with open_run(directory):
        pass
    if not path.is_file():
        path = write_page_again(directory)
    print_lines(f"open in a browser: {path}")
    if browser:
        webbrowser.open(path.resolve().as_uri())
