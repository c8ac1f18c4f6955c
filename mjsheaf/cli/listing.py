"""`mjsheaf list` and `mjsheaf schema`."""

import json

from rich.table import Table

from mjsheaf.cli.console import make_console
from mjsheaf.io.files import list_studies
from mjsheaf.io.yaml import read_yaml
from mjsheaf.scenario import Scenario, list_scenarios
from mjsheaf.scenario.load import read_scenario


def list_scenarios_command() -> None:
    """Print the scenarios with their sizes and summaries, and the studies below them."""
    table = Table(title="scenarios", title_justify="left", header_style="")
    for heading in ("name", "agents", "targets", "seconds", "what it shows"):
        table.add_column(heading, justify="right" if heading in ("agents", "targets", "seconds") else "left")
    for name in list_scenarios():
        s = Scenario.model_validate(read_scenario(name))  # no team is built, which takes longer than all the rest
        table.add_row(name, str(len(s.agents)), str(len(s.targets)), f"{s.time.end - s.time.start:g}", s.summary)
    studies = Table(title="studies, for mjsheaf sweep", title_justify="left", header_style="")
    for heading in ("name", "scenario", "what it asks"):
        studies.add_column(heading)
    for name, path in list_studies().items():
        study = read_yaml(path)
        studies.add_row(name, study["scenario"], study.get("summary", ""))
    make_console().print(table, "", studies)


def list_vehicles_command() -> None:
    """Print the vehicles with mass, thrust, time constant and speed."""
    from mjsheaf.vehicles.effects import capability_of
    from mjsheaf.vehicles.loading import list_vehicles, load_vehicle

    table = Table(title="vehicles", title_justify="left", header_style="", box=None, padding=(0, 1))
    for heading in ("name", "moves in", "mass\n(kg)", "thrusters", "thrust\n(N)", "tau\n(s)", "speed\n(m/s)"):
        table.add_column(heading, justify="left" if heading in ("name", "moves in") else "right", no_wrap=True)
    summaries = Table(box=None, show_header=False)
    for name in list_vehicles():
        vehicle = load_vehicle(name)
        tau, can = vehicle.reduced_model().tau, capability_of(vehicle)
        table.add_row(
            name,
            "plane" if vehicle.dimension == 2 else "space",
            f"{vehicle.mass:g}",
            str(len(vehicle.actuators)),
            _limit(can.forward_thrust),
            " ".join(f"{x:.3g}" for x in dict.fromkeys(tau.round(3))),
            _limit(can.forward_speed),
        )
        summaries.add_row(name, vehicle.description.summary)
    note = (
        "thrust and speed are forward, at constant height; tau is that of the commanded velocity along the "
        "body's axes (of a boat at its hand point: of surge and yaw)"
    )
    make_console().print(table, "", summaries, "", note, highlight=False)


def _limit(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}" if value < float("inf") else "no limit"


def schema_command(of_check: bool) -> None:
    """Print the JSON Schema of a scenario, or of the record of a check."""
    if of_check:
        from mjsheaf.checking.record import CheckRecord

        print(json.dumps(CheckRecord.model_json_schema(), indent=2))
    else:
        print(json.dumps(Scenario.model_json_schema(), indent=2))
