"""Margins against simulation and against matrices.

Oracle: where a simulation begins to diverge; roots of the second-order system by a generalised eigenproblem.
"""

import numpy as np
import pytest
from scipy.linalg import eigvals

import mjsheaf
from mjsheaf.checking.loop.margins import body_margin, hold_margin
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.scenario import scenario_from_mapping
from tests.commands import call


def growth(gain: float) -> float:
    """Size of the fastest mode of a held law after 400 periods, from about 1."""
    scenario = mjsheaf.load_scenario(
        "local_frames",
        {"controller.gain": gain, "controller.control_period": 0.05, "time.end": 20, "disturbance": {}, "flow": {}},
    )
    result = mjsheaf.simulate(scenario, "ideal")
    if result.attrs["status"] == "unstable":
        return np.inf
    H = scenario.system.team.dirichlet.H.toarray()
    _, vectors = np.linalg.eigh(H)
    error = result["harmonic_extension"].values - result["agent_position"].values
    last = np.nan_to_num(error[-1]).reshape(-1)[scenario.system.team.slots[: len(H)]]
    return float(abs(vectors[:, -1] @ last))


def test_hold_limit_is_where_simulation_begins_to_diverge() -> None:
    changes = {"controller.control_period": 0.05, "disturbance": {}, "flow": {}}
    system = mjsheaf.load_scenario("local_frames", changes).system
    margin = hold_margin(system, spectrum_of(system.team))
    assert margin is not None
    assert margin.largest_gain is not None
    assert margin.ringing_gain == pytest.approx(margin.largest_gain / 2)
    assert growth(0.99 * margin.largest_gain) < 1.0
    assert growth(1.01 * margin.largest_gain) > 100.0


def test_continuous_law_has_no_hold_margin() -> None:
    system = mjsheaf.load_scenario("certified").system
    assert hold_margin(system, spectrum_of(system.team)) is None


@pytest.mark.parametrize("spread", [0.0, 0.4])
def test_damping_of_inertia_alone(spread: float) -> None:
    system = mjsheaf.load_scenario("local_frames", {"controller.control_period": 0.1}).system
    H, k = system.team.dirichlet.H.toarray(), system.gain
    tau = 0.3 * (1.0 + spread * np.linspace(-1, 1, len(system.team.agents)))
    margin = body_margin(system, spectrum_of(system.team), tau)
    each = np.concatenate([np.full(a.dimension, t) for a, t in zip(system.team.agents, tau, strict=True)])
    if spread == 0.0:
        values = np.linalg.eigvalsh(H)
        assert margin.damping_slowest == pytest.approx(1 / (2 * np.sqrt(k * values[0] * 0.3)))
        assert margin.damping_fastest == pytest.approx(1 / (2 * np.sqrt(k * values[-1] * 0.3)))
    else:
        slowest, fastest = dampings(H, each, k)
        assert slowest != pytest.approx(fastest, rel=0.1)
        assert margin.damping_slowest == pytest.approx(slowest, rel=1e-6)
        assert margin.damping_fastest == pytest.approx(fastest, rel=1e-6)


def dampings(H: np.ndarray, tau: np.ndarray, k: float) -> tuple[float, float]:
    """Of the slowest and the fastest root of det(tau s^2 + s + k H), by a generalised eigenproblem; H regular."""
    n = len(H)
    zero, one = np.zeros((n, n)), np.eye(n)
    roots = eigvals(np.block([[zero, one], [-k * H, -one]]), np.block([[one, zero], [zero, np.diag(tau)]]))
    roots = roots[np.argsort(np.abs(roots))]
    return float(-roots[0].real / abs(roots[0])), float(-roots[-1].real / abs(roots[-1]))


FREE = {
    "name": "free",
    "agents": [{"id": f"A{i}", "position": [float(i), 0.0]} for i in range(5)],
    "targets": [{"id": "T", "position": [0.0, 0.0]}],
    "communication": [["A0", "A1"], ["A2", "A3"]],
    "sensing": [["A0", "T"]],
    "controller": {"gain": 2.0, "control_period": 0.1},
}


@pytest.mark.parametrize(
    "taus", [(1.0, 1.5, 40.0, 40.0, 90.0), (1.0, 1.5, 40.0, 50.0, 1e-3), (1.0, 1.0, 1.0, 1.0, 1.0)]
)
def test_what_is_free_does_not_enter(taus: tuple[float, ...]) -> None:
    """A2 and A3 oscillate against each other but coast together, A4 coasts; the held modes alone show the same."""
    system = scenario_from_mapping(FREE).system
    margin = body_margin(system, spectrum_of(system.team), np.array(taus))
    k = 2.0
    H = np.array([[2.0, -1.0], [-1.0, 1.0]])
    pair_H, pair_tau = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array(taus[2:4])
    roots = []
    for part, tau in ((H, np.array(taus[:2])), (pair_H, pair_tau)):
        n = len(part)
        plant = np.block([[np.zeros((n, n)), np.eye(n)], [np.zeros((n, n)), -np.diag(1 / tau)]])
        push = np.vstack([np.zeros((n, n)), np.diag(1 / tau)])
        gain = np.hstack([-k * part, np.zeros((n, n))])
        roots += np.linalg.eigvals(plant + push @ gain).tolist()
    # Of the pair, one root is 0 and one is the decay of their common velocity.
    if taus[2] == taus[3]:
        roots = [s for s in roots if abs(s + 1 / taus[2]) > 1e-9]
    moving = sorted((s for s in roots if abs(s) > 1e-7), key=abs)
    assert margin.damping_slowest == pytest.approx(-moving[0].real / abs(moving[0]), rel=1e-6)
    assert margin.damping_fastest == pytest.approx(-moving[-1].real / abs(moving[-1]), rel=1e-6)


def test_a_held_team_without_edges_has_no_limit() -> None:
    system = scenario_from_mapping({**FREE, "communication": [], "sensing": []}).system
    spectrum = spectrum_of(system.team)
    margin = hold_margin(system, spectrum)
    assert margin is not None
    assert (margin.product, margin.largest_gain, margin.ringing_gain) == (0.0, None, None)
    for tau in (np.full(5, 0.1), np.linspace(0.1, 0.2, 5)):
        bodies = body_margin(system, spectrum, tau)
        assert (bodies.damping_slowest, bodies.damping_fastest) == (None, None)


@pytest.mark.long
def test_the_speeds_of_a_vehicle_have_names(capsys: pytest.CaptureFixture[str]) -> None:
    """5.95, 5.28 and 3.85 m/s were three numbers for "a WAM-V": two vehicles, forward and in every direction."""
    assert call("list", "--vehicles") == 0
    rows: dict[str, list[str]] = {}
    for line in capsys.readouterr().out.splitlines():
        if words := line.split():
            rows.setdefault(words[0], words)  # the table comes first
    assert rows["wamv"][-2:] == ["6.34", "5.95"]
    assert rows["wamv_azimuth"][-2:] == ["5.28", "3.85"]
    scenario = mjsheaf.load_scenario("steady_current", {"vehicles.agents": "wamv_azimuth", "time.end": 2})
    for speed in mjsheaf.check(scenario, trial=False)["margins"]["speed"]:
        assert speed["able"] == pytest.approx(3.853, abs=1e-3)
        assert speed["able_forward"] == pytest.approx(5.278, abs=1e-3)
    assert call(
        "check",
        "steady_current",
        "--no-trial",
        "--full",
        "--set",
        "vehicles.agents=wamv_azimuth",
        "--set",
        "time.end=2",
    ) in (0, 1)
    printed = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "all-way speed is 3.853" in printed
