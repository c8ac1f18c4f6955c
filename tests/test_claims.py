"""Numbers that docs/claims.md prints are what the program says now.

Oracle: the page's own tables. A number is held to half a unit of its last digit. Speeds are not held: they are those
of a machine that is named there.
"""

import re

import pytest

from mjsheaf import check, load_scenario
from mjsheaf.vehicles.effects import capability_of
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from tests.builders import REPOSITORY

CLAIMS = (REPOSITORY / "docs" / "claims.md").read_text()


def rows(heading: str) -> list[list[str]]:
    """The cells of the table below a heading, without its two first lines."""
    section = CLAIMS.split(f"## {heading}\n")[1].split("\n## ")[0]
    found = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in found[2:]]


def agrees(shown: str, value: float) -> bool:
    """Whether a number as printed is this value, rounded to its digits."""
    whole, _, decimals = shown.partition(".")
    last = -len(decimals) if decimals else len(whole) - len(whole.rstrip("0"))  # place of the last digit that says
    return abs(float(shown) - value) <= 0.5000001 * 10.0**last


def test_vehicles() -> None:
    named = set()
    for names, *shown, _ in rows("Vehicles"):
        for name in re.findall(r"`(\w+)`", names):
            vehicle = load_vehicle(name)
            can, tau = capability_of(vehicle), vehicle.reduced_model().tau
            for text, value in zip(shown, (vehicle.mass, can.forward_thrust, can.forward_speed, tau[0]), strict=True):
                if text == "no limit":
                    assert value == float("inf"), name
                elif text:
                    assert agrees(text, float(value)), (name, text, value)
            named.add(name)
    assert named == set(list_vehicles())


@pytest.mark.slow
def test_links() -> None:
    """The column of `check`; that of runs is made by benchmarks/links.py."""
    table = {row[0]: re.findall(r"[\d.]+", row[1]) for row in rows("Links")}
    late, newton, noise, command, rates = table.values()

    def links(**fields: float) -> dict:  # type: ignore[type-arg]
        return check(load_scenario("paper", {name.replace("__", "."): value for name, value in fields.items()}))[
            "links"
        ]

    for gain, text in zip((10, 3), late, strict=True):
        assert agrees(text, links(controller__gain=gain, links__all__delay=0.01)["delay_margin"])
    assert agrees(newton[0], links(controller__newton__rounds=2, links__all__delay=0.01)["delay_margin"])
    answer = links(links__all__noise=0.3)
    assert agrees(noise[0], answer["noise_rms"])
    assert agrees(command[0], answer["noise"]["command"])
    for loss, text in zip((0.2, 0.5), rates[:2], strict=True):
        assert agrees(text, links(links__all__loss=loss)["loss"]["rate"])
