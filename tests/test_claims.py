"""Numbers that docs/claims.md prints are what the program says now, and the tests that it names exist.

Oracle: the page's own tables. A number is held to half a unit of its last digit. Speeds are not held: they are those
of a machine that is named there.
"""

import re
import shlex
from typing import Any

import numpy as np
import pytest
import xarray as xr
import yaml

from mjsheaf import check, load_scenario, simulate
from mjsheaf.results.metrics import summarize
from mjsheaf.scenario.load import parse_override
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from tests.builders import QUADROTOR_PAIR, REPOSITORY, Simulated

DOCS = REPOSITORY / "docs"
CLAIMS, PAPER = ((DOCS / page).read_text() for page in ("claims.md", "paper.md"))
PAPERS = ("paper", "paper_text")


def rows(heading: str, page: str = CLAIMS) -> list[list[str]]:
    """The cells of the table below a heading, without its two first lines."""
    section = page.split(f"## {heading}\n")[1].split("\n## ")[0]
    found = [line for line in section.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in found[2:]]


def agrees(shown: str, value: float) -> bool:
    """Return True if a printed number is this value to its digits; zeros at its end count up to two digits."""
    whole, _, decimals = shown.partition(".")
    zeros = min(len(whole) - len(whole.rstrip("0")), max(len(whole) - 2, 0))  # that say nothing
    last = -len(decimals) if decimals else zeros
    return abs(float(shown) - value) <= 0.5000001 * 10.0**last


def late_error(result: xr.Dataset) -> float:
    """Tracking error, RMS over agents and the last half of a run, m."""
    late = result.tracking_error.values[len(result.time) // 2 :]
    return float(np.sqrt((late**2).mean()))


def run_of(command: str, simulated: Simulated) -> xr.Dataset:
    """Return the result of `mjsheaf run NAME [--backend B] [--set PATH=VALUE]...`."""
    program, verb, name, *options = shlex.split(command)
    assert (program, verb) == ("mjsheaf", "run")
    given = list(zip(options[::2], options[1::2], strict=True))
    changes = dict(parse_override(value) for option, value in given if option == "--set")
    backend = next((value for option, value in given if option == "--backend"), "physics")
    assert {option for option, _ in given} <= {"--set", "--backend"}
    return simulate(load_scenario(name, changes), backend) if changes else simulated(name, backend)


def test_named_tests_exist() -> None:
    named = set()
    for page in (REPOSITORY / "README.md", *(p for p in DOCS.rglob("*.md") if "generated" not in p.parts)):
        for file, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", page.read_text()):
            assert re.search(rf"^def {name or 'test_'}", (REPOSITORY / file).read_text(), re.MULTILINE), (page, name)
            named.add((file, name))
    assert len(named) > 15


COMMANDS = [
    (heading, shown, command.strip("`"))
    for heading, column in (("The theory and the published run", 1), ("Runs in pages and lessons", 0))
    for row in rows(heading)
    for shown, command in [(row[column], row[-1])]
]


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(("heading", "shown", "command"), COMMANDS, ids=[command for *_, command in COMMANDS])
def test_runs(heading: str, shown: str, command: str, simulated: Simulated) -> None:
    result = run_of(command, simulated)
    if shown == "unstable":
        assert result.attrs["status"] == "unstable"
    elif heading.startswith("Runs"):
        assert agrees(shown, late_error(result)), late_error(result)
    else:
        assert agrees(shown, float(result.disagreement[-1].mean())), float(result.disagreement[-1].mean())


def test_distances_are_those_that_the_test_of_convergence_holds() -> None:
    for tau, _, distance, _ in rows("The theory and the published run")[1:]:
        assert agrees(distance, 31.8 * float(tau)) or float(distance) == pytest.approx(31.8 * float(tau), rel=0.01)


@pytest.mark.long
def test_the_text_of_the_paper_and_the_published_run(simulated: Simulated) -> None:
    """Both tables of that page; each difference is made alone in the published run."""
    published, text = (yaml.safe_load((REPOSITORY / f"scenarios/{name}.yaml").read_text()) for name in PAPERS)
    runs = [simulated(name, "ideal") for name in PAPERS]
    finals = [summarize(load_scenario(name).team, run) for name, run in zip(PAPERS, runs, strict=True)]
    disagreement, tracking, centering = rows("Results", PAPER)
    for k, final in enumerate(finals):
        assert agrees(disagreement[k + 1], final["mean_disagreement"])
        assert agrees(tracking[k + 1], late_error(runs[k]))
        assert agrees(centering[k + 1], final["centering_error"])
    assert 7.2 < finals[0]["centering_error"] < 7.4  # "up to 7.3 m from their targets"
    flow, width = published["flow"], text["flow"]["targets"]["channels"][0]["width"]
    wide = {kind: [{**field["channels"][0], "width": width}, field["channels"][1]] for kind, field in flow.items()}
    changes: list[dict[str, Any]] = [
        {"target_formation": text["target_formation"]},
        {"flow": {**flow, "agents": flow["targets"]}},
        {"flow": {kind: {**field, "drift": [0.0] * field["dimension"]} for kind, field in flow.items()}},
        {"flow": {kind: {**field, "channels": wide[kind]} for kind, field in flow.items()}},
        {"targets": text["targets"]},
    ]
    for row, change in zip(rows("Differences", PAPER), changes, strict=True):
        run = simulate(load_scenario({**published, **change}), "ideal")
        moved = np.nan_to_num((run.agent_position - runs[0].agent_position).values[len(run.time) // 2 :])
        assert agrees(row[4], np.linalg.norm(moved, axis=2).max()), row
        assert agrees(row[5], late_error(run)), row


@pytest.mark.long
@pytest.mark.parametrize("row", rows("The law beyond the paper"), ids=lambda row: row[0])
def test_terms(row: list[str]) -> None:
    name, without, with_terms, _, sent = row
    scenario = load_scenario(name.strip("`"))
    result = simulate(scenario)
    assert agrees(with_terms, late_error(result)), late_error(result)
    duration, agents = float(result.time[-1] - result.time[0]), result.sizes["agent"]
    assert agrees(sent, result.attrs["numbers_sent"] / duration / agents)
    off = {f"controller.{term}": None for term in ("feedforward", "newton", "drift")}
    assert agrees(without, late_error(simulate(load_scenario(name.strip("`"), off))))


def test_two_quadrotors() -> None:
    record = check(load_scenario({**QUADROTOR_PAIR, "controller": {"gain": 1.0}}), trial=False)
    line = next(line for line in CLAIMS.splitlines() if line.startswith("| two quadrotors"))
    bodies, hold = re.findall(r"[\d.]+(?= 1/s)|[\d.]+(?= \|)", line)
    assert agrees(bodies, record["margins"]["bodies"]["largest_gain"])
    assert agrees(hold, record["law"]["largest_gain"])


@pytest.mark.slow
def test_one_otter() -> None:
    fields: dict[str, Any] = {
        "time": {"end": 30},
        "controller": {"gain": 0.3},
        "agents": [{"id": "O1", "position": [-2, 0], "vehicle": "otter"}],
        "sensing": [["O1", "T1"]],
    }
    ahead = {"kind": "waypoints", "points": [[200, 0]], "speed": 2}
    line = next(line for line in CLAIMS.splitlines() if line.startswith("| one `otter`"))
    said = re.findall(r"[\d.]+(?= 1/s)", line)
    page = " ".join((DOCS / "howto/check.md").read_text().split())
    assert re.findall(r"[\d.]+(?= 1/s)", page[page.index("one `otter`") :]) == said
    for motion, shown in zip(({"kind": "static"}, ahead), said, strict=True):
        target = {"id": "T1", "position": [0, 0], "motion": motion}
        record = check(load_scenario(fields | {"targets": [target]}), trial=False)
        assert agrees(shown, record["margins"]["bodies"]["largest_gain"])


@pytest.mark.slow
def test_scenarios_of_pages() -> None:
    """Claims of pages about the scenarios that they show."""

    def shown(page: str) -> dict[str, Any]:
        text = re.search(r"^```yaml\n(.*?)^```$", (DOCS / page).read_text(), re.MULTILINE | re.DOTALL)
        assert text
        fields: dict[str, Any] = yaml.safe_load(text[1])
        return check(load_scenario(fields), trial=False)

    triangle, escort = shown("start.md"), shown("howto/scenario.md")
    (line,) = [line for line in CLAIMS.splitlines() if line.startswith("| the triangle of *Start*")]
    bound, proposed = re.findall(r"[\d.]+(?= m[,;])", line)
    assert f"from {bound} m to {proposed} m" in (DOCS / "start.md").read_text()
    assert agrees(bound, triangle["law"]["radius"] / np.sqrt(3))  # RMS over the three agents
    terms = {"gain", "feedforward", "newton"}
    (with_a_round,) = [p for p in triangle["proposals"] if {*p["controller"]} == terms]
    assert all(with_a_round["controller"][term]["rounds"] == 1 for term in ("feedforward", "newton"))
    assert agrees(proposed, with_a_round["bound"] / np.sqrt(3))
    assert agrees("1.9", escort["margins"]["bodies"]["largest_gain"])
    assert "Here it is 1.9 1/s" in (DOCS / "howto/scenario.md").read_text()


def test_vehicles() -> None:
    named = set()
    for names, *shown, _ in rows("Vehicles"):
        for name in re.findall(r"`(\w+)`", names):
            vehicle = load_vehicle(name)
            can, tau = vehicle.capability, vehicle.reduced_model().tau
            for text, value in zip(shown, (vehicle.mass, can.forward_thrust, can.forward_speed, tau[0]), strict=True):
                if text == "no limit":
                    assert value == float("inf"), name
                elif text:
                    assert agrees(text, float(value)), (name, text, value)
            named.add(name)
    assert named == set(list_vehicles())


@pytest.mark.long
def test_links() -> None:
    """The column of `check`; that of runs is made by benchmarks/links.py."""
    table = {row[0]: re.findall(r"[\d.]+", row[1]) for row in rows("Links")}
    late, newton, noise, command, rates = table.values()

    def links(**fields: float) -> dict[str, Any]:
        changes = {name.replace("__", "."): value for name, value in fields.items()}
        answers: dict[str, Any] = check(load_scenario("paper", changes), trial=False)["links"]
        return answers

    for gain, text in zip((10, 3), late, strict=True):
        assert agrees(text, links(controller__gain=gain, links__all__delay=0.01)["delay_margin"])
    assert agrees(newton[0], links(controller__newton__rounds=2, links__all__delay=0.01)["delay_margin"])
    answer = links(links__all__noise=0.3)
    assert agrees(noise[0], answer["noise_rms"])
    assert agrees(command[0], answer["noise"]["command"])
    for loss, text in zip((0.2, 0.5), rates[:2], strict=True):
        assert agrees(text, links(links__all__loss=loss)["loss"]["rate"])
