"""`mjsheaf check`, `list`, `new`, `schema`, `export` and `view`."""

import json
import math
import os
import re
import shlex
import webbrowser
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import chain, count
from pathlib import Path
from typing import Annotated, Any

import typer

from mjsheaf import lazy
from mjsheaf.cli.options import (
    FOXGLOVE,
    Backend,
    BackendOption,
    Engine,
    EngineOption,
    LiveOption,
    McapOption,
    NotHeldError,
    Ros2Option,
    ScenarioArgument,
    SeedOption,
    SetOption,
    TitleOption,
    changes_of,
    formats_of,
    make_console,
    make_table,
    print_lines,
    progress_bars,
    require_file_name,
    saying_what_is_kept,
)
from mjsheaf.cli.run import require_place
from mjsheaf.errors import InputError, in_field, shortened

_ROOM = 40.0  # m around the origin that the vehicles of the new scenario need
_LEAST_DURATION = 1.0  # s


def check(
    scenario: ScenarioArgument,
    overrides: SetOption = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the results as JSON (see mjsheaf schema --check).")
    ] = False,
    full: Annotated[bool, typer.Option("--full", help="Print the whole report instead of one screen.")] = False,
    trial: Annotated[
        bool, typer.Option("--trial/--no-trial", help="Run the mission on bodies, and judge how it ends.")
    ] = True,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Plot the spectrum, the graph and the bounded difference to this file: .png, .svg or .pdf.",
        ),
    ] = None,
    formats: Annotated[
        str | None,
        typer.Option("--format", metavar="F1[,F2,...]", help="Additional formats of the plot: png, svg, pdf."),
    ] = None,
    title: TitleOption = True,
    rate: Annotated[float | None, typer.Option(help="lambda_V of Theorem 1, 1/s.", show_default="the best one")] = None,
    radius: Annotated[
        float, typer.Option(help="Desired bound on |e|, norm of the whole team, m; gains and laws are proposed for it.")
    ] = 1.0,
    rho: Annotated[
        str | None,
        typer.Option(
            metavar="C0[,C1,...]",
            help="Your own bound on the slope of the agents' dynamics, C0 + C1 |e| + ..., 1/s.",
            show_default="from the flow",
        ),
    ] = None,
) -> None:
    """Check whether a mission can work, and try it; if not, name the agents responsible and suggest a fix.

    Decides the paper's assumptions and predicts the tracking error, the largest stable gain and the delay margin. With
    --full it also prints every number of the record under its name in --json.

    At the end the mission is run on bodies, without files. OK means that the assumptions hold, and that it worked
    when tried.

    The exit code is 1 if an assumption fails or is undecided, if the loop of the law, of the vehicles or of the targets
    is unstable, if the law has a term that check cannot model, if the mission demands more than a vehicle can do, if
    the mission failed when it was tried, or, with --no-trial, if only a trial can decide. Errors are the RMS over
    agents, in metres.
    """
    figures = _figures_of(plot, formats, title)

    with progress_bars("loading", lines=None):
        loaded = lazy.scenario.load_scenario(scenario, changes_of(overrides))
        _ = loaded.whole.vehicles  # what cannot be read is refused in one line, without progress before it
    with progress_bars("checking", lines=None if as_json else "stderr"):  # the answer alone is on stdout
        examination = lazy.checking.examine_scenario(
            loaded, rate=rate, radius=radius, rho=None if rho is None else _rho_of(rho)
        )
    record = examination.record
    if not trial:
        record = lazy.examining.untried(record)
    else:
        above = [] if as_json or full else [*lazy.report.screen(record, pending=True), ""]
        with progress_bars("trying the mission", lines=None if as_json else "stderr", above=above) as bar:
            record = lazy.examining.try_out(record, loaded, partial(bar, "trying the mission"))
    if as_json:
        print(json.dumps(record.model_dump(mode="json"), indent=2, allow_nan=False))
    elif full:
        make_console(lazy.report.PAGE_WIDTH).print(lazy.report.report(record))
    else:
        print_lines(*lazy.report.screen(record, scenario))
    drawn = [] if plot is None else _draw(replace(examination, record=record), figures, plot)
    if not as_json:
        print_lines(*drawn)
    if not record.ok:
        raise NotHeldError(f"{scenario}: {'; '.join(lazy.record.reasons_of(record))}")


def _figures_of(plot: Path | None, formats: str | None, title: bool) -> "lazy.style.FigureOptions":
    """Return the formats of the plot, that of its name first, and its other options.

    Raises:
        InputError: The name or a format is not one of figures, or formats are given without a plot.
    """
    if plot is None and formats is not None:
        raise InputError(f"--format {formats}: no plot to write; expected --plot FILE too")
    if plot is None:
        return lazy.style.AS_USUAL
    require_file_name("--plot", plot, *(f".{form}" for form in lazy.files.FIGURE_FORMATS))
    named = plot.suffix[1:]
    others = [form for form in (formats or named).split(",") if form != named]
    return lazy.style.FigureOptions((named, *others), title)


def _rho_of(text: str) -> "lazy.theorem.Rho":
    """Return the bound given by --rho.

    Raises:
        InputError: The text is not a polynomial with coefficients of at least 0.
    """
    try:
        return lazy.theorem.as_rho([float(c) for c in text.split(",")])
    except (ValueError, InputError):
        raise InputError(f"--rho {text}: expected coefficients >= 0, separated by commas, such as 0.1,0.02") from None


def _draw(examination: "lazy.checking.Examination", figures: "lazy.style.FigureOptions", plot: Path) -> list[Path]:
    """Draw an examination into files, and return them."""
    figure = lazy.check_figure.draw_check(examination, figures)
    paths = list(figures.paths(plot))
    for path in paths:
        with lazy.files.naming(f"--plot {path}"), lazy.files.whole_file(path) as part:
            lazy.plots.write_figure(figure, part, path.suffix[1:])
    return paths


def list_(
    files: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FILE]...", help="Description files of your own vehicles, for --vehicles."),
    ] = None,
    vehicles: Annotated[
        bool, typer.Option("--vehicles", help="List vehicles instead: the included ones, then those of FILE.")
    ] = False,
) -> None:
    """List the included scenarios and studies, or the included vehicles and your own."""
    if vehicles:
        _list_vehicles(files or [])
        return
    if files:
        raise InputError(f"{files[0]}: only vehicles have files to list; expected --vehicles {files[0]}")
    numbers = ("agents", "targets", "seconds")
    table = make_table("name", *numbers, "what it shows", numbers=numbers, title="scenarios")
    for name in lazy.scenario.list_scenarios():
        # No team is built, which takes longer than all the rest.
        s = lazy.scenario.Scenario.model_validate(lazy.scenario.read_scenario(name))
        table.add_row(name, str(len(s.agents)), str(len(s.targets)), f"{s.time.end - s.time.start:g}", s.summary)
    studies = make_table("name", "scenario", "what it asks", title="studies, for mjsheaf sweep")
    for name, path in lazy.files.list_studies().items():
        study = lazy.files.read_yaml(path)
        studies.add_row(name, study["scenario"], study.get("summary", ""))
    make_console().print(table, "", studies)


def _list_vehicles(files: list[str]) -> None:
    numbers = ("mass\n(kg)", "size\n(m)", "thrust-\ners", "thrust\n(N)", "tau\n(s)", "forward\n(m/s)", "all-way\n(m/s)")
    headings = ("name", *numbers)
    table = make_table(*headings, numbers=numbers, fixed=headings, title="vehicles", box=None, padding=(0, 1))
    summaries, slips = make_table("name", "moves in", "pushes", "", box=None), []
    for source in [*lazy.loading.list_vehicles(), *files]:
        vehicle = lazy.loading.load_vehicle(source)
        tau, can = vehicle.reduced_model().tau, vehicle.capability
        table.add_row(
            vehicle.name,
            f"{vehicle.mass:g}",
            f"{vehicle.size:.3g}",
            str(len(vehicle.actuators)),
            _limit(can.forward_thrust),
            " ".join(f"{x:.3g}" for x in dict.fromkeys(tau.round(3))),
            _limit(can.forward_speed),
            _limit(can.least_speed),
        )
        summaries.add_row(
            vehicle.name,
            "plane" if vehicle.dimension == 2 else "space",
            lazy.effects.authority_of(vehicle).describe().replace(", ", "\n"),
            vehicle.description.summary,
        )
        slips += [f"note: {slip}" for slip in lazy.slips.slips_of_vehicle(vehicle)]
    note = (
        "size is the longest side; thrust is forward, at constant height; forward is the steady speed of full thrust "
        "forward, all-way that in the horizontal direction in which the vehicle is slowest (of a boat that turns "
        "first, forward); tau is that of the commanded velocity along the body's axes (of a boat at "
        "its hand point: of surge and yaw); pushes says in which directions thrusters make a force or moment "
        "without any other"
    )
    console = make_console()
    console.print(table, "", summaries, "", note)
    for slip in slips:
        console.print(slip)


def _limit(value: float) -> str:
    return f"{float(f'{value:.3g}') + 0.0:g}" if value < float("inf") else "no limit"


def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the scenario, or path of the file to write.")],
    vehicle: Annotated[
        Path | None,
        typer.Option(
            "--vehicle",
            metavar="FILE",
            help="Write the description of the vehicle in an MJCF file instead; TODO marks what the file does not say.",
        ),
    ] = None,
    netcdf: Annotated[
        Path | None,
        typer.Option(
            "--from-netcdf",
            metavar="FILE",
            help="Put the scenario into the current or wind of a netCDF file: proposes origin, start and box.",
        ),
    ] = None,
) -> None:
    """Write NAME.yaml, a commented scenario to start from, which runs as it is; or a vehicle's description.

    An existing file is not replaced.
    """
    path = Path(name if name.endswith((".yaml", ".yml")) else f"{name}.yaml")
    if not re.fullmatch(r"\w[\w .+-]*", path.stem):
        raise InputError(f"{shortened(name)!r}: expected a name, such as mine")
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: exists already; expected another name")
    if name in (lazy.scenario.list_scenarios() if vehicle is None else lazy.loading.list_vehicles()):
        kind = "scenario" if vehicle is None else "vehicle"
        raise InputError(f"{name}: is the name of an included {kind}; expected another name")
    require_file_name("NAME", path, ".yaml", ".yml")
    quoted = shlex.quote(str(path))
    following = f"mjsheaf check {quoted}, then mjsheaf run {quoted}"
    template = Path(__file__).parents[1] / "scenario" / "template.yaml"
    text = template.read_text(encoding="utf-8").replace("{file}", path.name)
    text = text.replace("{name}", lazy.load.name_from(path))
    if vehicle is not None and netcdf is not None:
        raise InputError("--vehicle writes a vehicle and --from-netcdf a scenario; expected one of them")
    if vehicle is not None:
        with in_field("--vehicle"):
            text = lazy.loading.propose_description(vehicle, _beside(vehicle, path))
        following = f"replace each TODO, then mjsheaf list --vehicles {quoted}"
    elif netcdf is not None:
        with progress_bars("reading the netCDF file"):
            text = _within_flow(text, netcdf, path)
    with lazy.files.naming(path):
        lazy.files.write_whole(path, text.encode("utf-8"))
    print_lines(f"wrote {path}; next: {following}")


def _beside(file: Path, path: Path) -> str:
    """Return the path of a file relative to the directory of the file that names it.

    Raises:
        InputError: It lies outside that directory.
    """
    beside = os.path.relpath(file.absolute(), path.absolute().parent)
    if beside.startswith(".."):
        raise InputError(f"{file} lies outside the directory of {path}; expected a file there or below it")
    return beside


def _within_flow(text: str, netcdf: Path, path: Path) -> str:
    """Return the text of a new scenario at `path` with the flow of a netCDF file in place of its current or wind.

    Raises:
        InputError: The file holds no flow, or one that is too small or too short for a scenario.
    """
    with in_field("--from-netcdf"):
        found = lazy.flow_files.propose(str(netcdf))
        if found.clear < _ROOM or found.duration < _LEAST_DURATION:
            raise InputError(
                f"{netcdf} has a flow within {found.clear:.3g} m of its best place, for {found.duration:.3g} s; "
                f"expected {_ROOM:g} m and {_LEAST_DURATION:g} s or more"
            )
        beside = _beside(netcdf, path)
    lines = [
        f"  {found.medium}:",
        f"    # {found.grid.box}; without gaps within {found.clear:.4g} m",
        "    kind: gridded",
        f"    path: {json.dumps(beside)}",
        f"    origin: [{found.origin[0]}, {found.origin[1]}]    # latitude and longitude of x = y = 0",
    ]
    if found.start is not None:
        lines.append(f'    start: "{found.start}"    # at t = 0; the file ends {found.duration:g} s later')
    end = min(60.0, found.duration)
    text = text.replace("time: {end: 60} ", f"time: {{end: {end:g}}} ")
    return re.sub(rf"^  {found.medium}: \{{dimension.*$", lambda _: "\n".join(lines), text, flags=re.MULTILINE)


def schema(
    check: Annotated[bool, typer.Option("--check", help="Schema of the output of `check --json`.")] = False,
    compare: Annotated[bool, typer.Option("--compare", help="Schema of compare.json.")] = False,
    study: Annotated[bool, typer.Option("--study", help="Schema of a study file, for sweep.")] = False,
    vehicle: Annotated[bool, typer.Option("--vehicle", help="Schema of a vehicle's description file.")] = False,
) -> None:
    """Print the JSON Schema of a scenario file, or of another file if an option selects it."""
    given = {"check": check, "compare": compare, "study": study, "vehicle": vehicle}
    asked = [what for what in given if given[what]] or [""]
    if len(asked) > 1:
        raise InputError(f"--{asked[1]}: is given with --{asked[0]}; expected one of the two")
    print(json.dumps(schema_of(asked[0]), indent=2))


def schema_of(what: str) -> dict[str, Any]:
    """Return the JSON Schema of a scenario file, or of a 'check', a 'compare', a 'study' or a 'vehicle'."""
    module, name = {
        "": ("scenario", "Scenario"),
        "check": ("checking", "CheckRecord"),
        "compare": ("comparing", "CompareRecord"),
        "study": ("studies.plan", "StudyFile"),
        "vehicle": ("vehicles.vehicle", "VehicleDescription"),
    }[what]
    return dict(getattr(import_module(f"mjsheaf.{module}"), name).model_json_schema())


def export(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a finished run.")],
    mcap: McapOption = False,
    ros2: Ros2Option = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="File to write with --mcap, directory to write with --ros2.",
            show_default="DIR/run.mcap, DIR/run_ros2",
        ),
    ] = None,
) -> None:
    """Export a finished run as a log that other tools read, without simulating.

    The log has the pose of every vehicle, the scene with edges coloured by residual, desired positions and flow, errors
    and commands, events as messages, and the scenario. `run --mcap` writes the same file during a run.
    """
    formats = formats_of(mcap=mcap, ros2=ros2)
    if not formats:
        raise InputError("export: expected --mcap, --ros2 or both")
    if out is not None and len(formats) > 1:
        raise InputError(f"--out {out}: names one place; expected only one of --mcap and --ros2 with it")
    with progress_bars("exporting the run"):
        if out is not None:
            if not out.parent.is_dir():
                raise InputError(f"--out {out}: there is no directory {out.parent}")
            require_place(out, directory / lazy.export.FORMATS[formats[0]], *((".mcap",) if mcap else ()))
        paths = [lazy.export.export_run(directory, name, out) for name in formats]
    print_lines(*paths)


def _open_page(directory: Path, browser: bool) -> None:
    """Say where the page of a finished run is, and open it."""
    path = directory / "report.html"
    with lazy.store.open_run(directory):
        pass
    if not path.is_file():
        lazy.publish.replay(directory).save(path)
    print_lines(f"open in a browser: {path}")
    if browser:
        webbrowser.open(path.resolve().as_uri())


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
    live: LiveOption = False,
) -> None:
    """Run a scenario in the browser: pause, set speed, gain and flow, lose agents, cut links. Or open a finished run.

    The page is served on 127.0.0.1 only, to one client, at an address with a random token. Closing it ends the
    command. What you do is recorded as the `events:` of a scenario that reproduces the session bit for bit.
    """
    finished = Path(source)
    if finished.is_dir() and ((finished / "result.nc").exists() or source not in lazy.load.list_scenarios()):
        _open_page(finished, browser)
        return
    with ExitStack() as loading:
        loading.enter_context(progress_bars("preparing the run"))
        speeds = lazy.live.SPEEDS
        if speed != 0.0 and speed not in speeds:
            raise InputError(f"--speed {speed:g}: expected 0 or one of {', '.join(f'{s:g}' for s in speeds)}")
        if out is not None and out.exists():
            raise InputError(f"--out {out}: exists; expected the name of a new directory")
        kinds = lazy.export.require_installed(["live"] if live else [])
        loaded = lazy.scenario.load_scenario(source, changes_of(overrides, seed))
        kept = ["nothing was written"]

        def announce(url: str) -> None:
            loading.close()
            print_lines(f"open in a browser: {url}", "the run starts when the page opens and ends when it is closed")
            print_lines(*([FOXGLOVE] if live else []))
            if browser:
                webbrowser.open(url)

        def record(scenario: "lazy.scenario.Scenario") -> None:
            name = f"{loaded.name}-{backend}-live"
            places = (Path("runs") / own for own in chain([name], (f"{name}-{number}" for number in count(2))))
            directory = out or next(path for path in places if not path.exists())
            with lazy.files.naming(directory):
                directory.parent.mkdir(parents=True, exist_ok=True)
                with lazy.files.whole_directory(directory) as fresh:
                    lazy.publish.write_scenario(scenario, fresh)
            other = "" if engine is Engine.MUJOCO else f" --engine {engine}"
            again = f"mjsheaf run {directory / 'scenario.yaml'} --backend {backend}{other}"
            number = len(scenario.events) - len(loaded.events)
            kept[0] = f"{number} event{'' if number == 1 else 's'} recorded; the session again: {again}"

        pace = speed or math.inf
        with in_field(source), saying_what_is_kept(lambda: kept[0]):
            sinks = [kind(Path(os.devnull), loaded, loaded.phases, Path(os.devnull), math.inf) for kind in kinds]
            lazy.live.view(
                loaded, str(backend), engine=str(engine), port=port, speed=pace, sinks=sinks, opened=announce,
                recorded=record,
            )  # fmt: skip
    print_lines(kept[0])
