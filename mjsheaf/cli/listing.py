"""`mjsheaf list` and `mjsheaf schema`."""

import json

from rich.console import Console
from rich.table import Table

from mjsheaf.scenario import Scenario, list_scenarios, load_scenario


def list_scenarios_command() -> None:
    """Print the scenarios with their sizes and summaries."""
    table = Table(title="scenarios", title_justify="left", header_style="")
    for heading in ("name", "agents", "targets", "seconds", "what it shows"):
        table.add_column(heading, justify="right" if heading in ("agents", "targets", "seconds") else "left")
    for name in list_scenarios():
        s = load_scenario(name)
        table.add_row(name, str(len(s.agents)), str(len(s.targets)), f"{s.time.end - s.time.start:g}", s.summary)
    Console().print(table)


def list_vehicles_command() -> None:
    """Print the vehicles with mass, thrusters and time constant."""
    from mjsheaf.backends.physics import list_vehicles, load_vehicle

    table = Table(title="vehicles", title_justify="left", header_style="")
    for heading in ("name", "moves in", "mass (kg)", "thrusters", "m / D (s)", "what it is"):
        table.add_column(heading, justify="left" if heading in ("name", "moves in", "what it is") else "right")
    for name in list_vehicles():
        vehicle = load_vehicle(name)
        tau = vehicle.reduced_model().tau
        table.add_row(
            name,
            "the plane" if vehicle.dimension == 2 else "space",
            f"{vehicle.mass:g}",
            str(len(vehicle.thrusters)),
            " ".join(f"{x:.3g}" for x in dict.fromkeys(tau)),
            vehicle.description.summary,
        )
    Console().print(table)


def schema_command(of_check: bool) -> None:
    """Print the JSON Schema of a scenario, or of the record of a check."""
    if of_check:
        from mjsheaf.checking.record import CheckRecord

        print(json.dumps(CheckRecord.model_json_schema(), indent=2))
    else:
        print(json.dumps(Scenario.model_json_schema(), indent=2))
