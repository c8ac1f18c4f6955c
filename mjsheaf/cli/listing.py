"""`mjsheaf list`, `mjsheaf new` and `mjsheaf schema`."""

import json
import os
import re
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from mjsheaf.cli.options import require_file_name
from mjsheaf.cli.terminal import make_console, make_table, print_lines, progress_bars
from mjsheaf.errors import InputError, in_field, shortened

_ROOM = 40.0  # m around the origin that the vehicles of the new scenario need
_LEAST_DURATION = 1.0  # s


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
    elif files:
        raise InputError(f"{files[0]}: only vehicles have files to list; expected --vehicles {files[0]}")
    else:
        _list_scenarios()


def _list_scenarios() -> None:
    from mjsheaf.io.files import list_studies
    from mjsheaf.io.yaml import read_yaml
    from mjsheaf.scenario import Scenario, list_scenarios
    from mjsheaf.scenario.load import read_scenario

    numbers = ("agents", "targets", "seconds")
    table = make_table("name", *numbers, "what it shows", numbers=numbers, title="scenarios")
    for name in list_scenarios():
        s = Scenario.model_validate(read_scenario(name))  # no team is built, which takes longer than all the rest
        table.add_row(name, str(len(s.agents)), str(len(s.targets)), f"{s.time.end - s.time.start:g}", s.summary)
    studies = make_table("name", "scenario", "what it asks", title="studies, for mjsheaf sweep")
    for name, path in list_studies().items():
        study = read_yaml(path)
        studies.add_row(name, study["scenario"], study.get("summary", ""))
    make_console().print(table, "", studies)


def _list_vehicles(files: list[str]) -> None:
    from mjsheaf.checking.authority import authority_of
    from mjsheaf.checking.slips import slips_of_vehicle
    from mjsheaf.vehicles.effects import capability_of
    from mjsheaf.vehicles.loading import list_vehicles, load_vehicle

    numbers = ("mass\n(kg)", "size\n(m)", "thrust-\ners", "thrust\n(N)", "tau\n(s)", "forward\n(m/s)", "all-way\n(m/s)")
    headings = ("name", *numbers)
    table = make_table(*headings, numbers=numbers, fixed=headings, title="vehicles", box=None, padding=(0, 1))
    summaries, slips = make_table("name", "moves in", "pushes", "", box=None), []
    for source in [*list_vehicles(), *files]:
        vehicle = load_vehicle(source)
        tau, can = vehicle.reduced_model().tau, capability_of(vehicle)
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
            authority_of(vehicle).describe().replace(", ", "\n"),
            vehicle.description.summary,
        )
        slips += [f"note: {slip}" for slip in slips_of_vehicle(vehicle)]
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
    netcdf: Annotated[
        Path | None,
        typer.Option(
            "--from-netcdf",
            metavar="FILE",
            help="Put the scenario into the current or wind of a netCDF file: proposes origin, start and box.",
        ),
    ] = None,
) -> None:
    """Write NAME.yaml, a commented scenario to start from. It runs as it is.

    An existing file is not replaced.
    """
    from mjsheaf.io.files import naming, write_whole
    from mjsheaf.scenario.load import list_scenarios, name_from

    path = Path(name if name.endswith((".yaml", ".yml")) else f"{name}.yaml")
    if not re.fullmatch(r"\w[\w .+-]*", path.stem):
        raise InputError(f"{shortened(name)!r}: expected a name, such as mine")
    if path.exists() or path.is_symlink():
        raise InputError(f"{path}: exists already; expected another name")
    if name in list_scenarios():
        raise InputError(f"{name}: is the name of an included scenario; expected another name")
    require_file_name("NAME", path, ".yaml", ".yml")
    template = Path(__file__).parents[1] / "scenario" / "template.yaml"
    text = template.read_text(encoding="utf-8").replace("{file}", path.name).replace("{name}", name_from(path))
    if netcdf is not None:
        with progress_bars("reading the netCDF file"):
            text = _within_flow(text, netcdf, path)
    with naming(path):
        write_whole(path, text.encode("utf-8"))
    quoted = shlex.quote(str(path))
    print_lines(f"wrote {path}; next: mjsheaf check {quoted}, then mjsheaf run {quoted}")


def _within_flow(text: str, netcdf: Path, path: Path) -> str:
    """Return the text of a new scenario at `path` with the flow of a netCDF file in place of its current or wind.

    Raises:
        InputError: The file holds no flow, or one that is too small or too short for a scenario.
    """
    from mjsheaf.media.flow_files import propose

    with in_field("--from-netcdf"):
        found = propose(str(netcdf))
        if found.clear < _ROOM or found.duration < _LEAST_DURATION:
            raise InputError(
                f"{netcdf} has a flow within {found.clear:.3g} m of its best place, for {found.duration:.3g} s; "
                f"expected {_ROOM:g} m and {_LEAST_DURATION:g} s or more"
            )
        beside = os.path.relpath(netcdf.absolute(), path.absolute().parent)
        if beside.startswith(".."):
            raise InputError(f"{netcdf} lies outside the directory of {path}; expected a file there or below it")
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
    asked = {"vehicle": vehicle, "study": study, "compare": compare, "check": check}
    print(json.dumps(schema_of(next((what for what in asked if asked[what]), "")), indent=2))


def schema_of(what: str) -> dict[str, Any]:
    """Return the JSON Schema of a scenario file, or of a 'check', a 'compare', a 'study' or a 'vehicle'."""
    from importlib import import_module

    module, name = {
        "": ("scenario", "Scenario"),
        "check": ("checking", "CheckRecord"),
        "compare": ("comparing", "CompareRecord"),
        "study": ("studies.schema", "StudyFile"),
        "vehicle": ("vehicles.vehicle", "VehicleDescription"),
    }[what]
    found: dict[str, Any] = getattr(import_module(f"mjsheaf.{module}"), name).model_json_schema()
    return found
