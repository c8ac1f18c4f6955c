"""Check's loops against the loop that is read off a run by differences (`tests.oracles.linearised_run`).

The oracle knows nothing of H, of terms, links and vehicles. Teams are small, agents sense targets at rest, and every
team has settled.
"""

import itertools
from collections.abc import Mapping
from typing import Any

import pytest

from mjsheaf.scenario import Scenario, load_scenario
from tests.builders import build_scenario
from tests.oracles.linearised_run import spectral_radii
from tests.running import analyse
from tests.strategies import slow

TERMS: dict[str, dict[str, Any]] = {
    "newton": {"newton": {"rounds": 2}},
    "integral": {"integral": {"gain": 0.3}},
    "drift": {"drift": {"filter": 0.2}},
    "feedforward": {"feedforward": {"rounds": 2, "filter": 0.2, "extrapolate": True}},
}
COMBINATIONS = [(), *itertools.combinations(TERMS, 1), *itertools.combinations(TERMS, 2), tuple(TERMS)]
SETTLING = 40.0  # s
GAIN = 0.8  # 1/s
ALIKE = {"all": {"delay": 0.2}}
UNLIKE = {"sensing": {"delay": 0.3}, "communication": {"delay": 0.1}}


def team(
    terms: tuple[str, ...] = (), gain: float = GAIN, vehicle: str = "hull", links: Mapping[str, Any] | None = None
) -> Scenario:
    """Return two agents in still water; each senses a target at rest, and both compare their positions."""
    law = {"gain": gain, "control_period": 0.1} | {name: value for term in terms for name, value in TERMS[term].items()}
    at_rest = {"motion": {"kind": "static"}}
    link = {"between": ["A1", "A2"], "weight": [[0.5, 0.1], [0.1, 0.7]], "offset": [-4.0, 1.0]}
    return build_scenario(
        {"A1": {"position": [-6.0, 2.0], "heading": 20.0}, "A2": {"position": [7.0, -3.0], "heading": 160.0}},
        {"T1": {"position": [-10.0, 5.0], **at_rest}, "T2": {"position": [12.0, -6.0], **at_rest}},
        [["A1", "T1"], ["A2", "T2"]],
        time={"end": 1000.0},
        controller=law,
        communication=[link],
        vehicles={"agents": vehicle, "targets": vehicle},
        physics={"timestep": 0.01},
        links=links or {},
    )


@pytest.mark.parametrize(("backend", "radius"), [("ideal", 0.88), ("physics", 0.83176151)])
def test_midpoint(backend: str, radius: float) -> None:
    """The published scenario has the two factors that were found by hand and by check."""
    assert spectral_radii(load_scenario("midpoint"), backend, 20.0) == [pytest.approx(radius, abs=1e-8)]


def compare_with_runs(
    loop: Mapping[str, Any], backend: str, gain: float, settling: float = SETTLING, **kind: Any
) -> None:
    """Hold a loop of check, of a team at a gain, 1/s, against runs: its factor, and where the team becomes unstable."""
    largest = loop["largest_gain"]
    gains = [gain, *([] if largest is None else [0.99 * largest, 1.01 * largest])]
    own, *ends = spectral_radii(team(gain=gain, **kind), backend, settling, *(team(gain=k, **kind) for k in gains))
    assert own == pytest.approx(loop["spectral_radius"], abs=1e-6)
    if ends:
        assert ends[0] < 1.0 < ends[1]


@pytest.mark.parametrize("terms", [*map(slow, COMBINATIONS[:-1]), COMBINATIONS[-1]])
def test_ideal(terms: tuple[str, ...]) -> None:
    law = analyse(team(terms))["law"]
    compare_with_runs(law, "ideal", GAIN, terms=terms)


@pytest.mark.parametrize("terms", [COMBINATIONS[0], *map(slow, COMBINATIONS[1:])])
@pytest.mark.parametrize("links", [ALIKE, UNLIKE])
def test_delay(terms: tuple[str, ...], links: Mapping[str, Any]) -> None:
    """The loop with delays of all edges alike, or of each kind by itself, is that of runs."""
    delay = analyse(team(terms, links=links))["links"]["delay"]
    compare_with_runs(delay, "ideal", GAIN, terms=terms, links=links)


@pytest.mark.slow
@pytest.mark.parametrize("terms", COMBINATIONS[::-1])
@pytest.mark.parametrize("links", [ALIKE, {}])
def test_bodies(terms: tuple[str, ...], links: Mapping[str, Any]) -> None:
    loop = analyse(team(terms, links=links))["margins"]["bodies"]
    compare_with_runs(loop, "physics", GAIN, terms=terms, links=links)


@pytest.mark.slow
@pytest.mark.parametrize("terms", [(), ("drift",), ("feedforward",)])
def test_boats(terms: tuple[str, ...]) -> None:
    """The loop of boats whose thrusters lag is that of runs on bodies."""
    loop = analyse(team(terms, gain=0.05, vehicle="wamv"))["margins"]["bodies"]
    compare_with_runs(loop, "physics", 0.05, 10.0 * SETTLING, terms=terms, vehicle="wamv")
