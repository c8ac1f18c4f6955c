"""The law on range, bearing and directed edges: gradient, invariants, noise, laws in Python, and refusals."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mjsheaf
from mjsheaf.errors import InputError
from mjsheaf.law.edges import bound_slopes
from mjsheaf.law.law import disagreement, measure
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, list_members, make_fields, make_scenario, team_of
from tests.running import run_ideal
from tests.strategies import long

HALF = 3**0.5 / 2
PLACES = {"A": [0.0, 0.0], "B": [1.0, 0.0], "C": [0.5, HALF]}
START = {"A": [0.05, 0.0], "B": [1.0, 0.04], "C": [0.47, 0.9]}


def keeping(measures: str = "range", directed: bool = False, **fields: Any) -> Scenario:
    edges = [{"between": [*pair], "measures": measures, "directed": directed} for pair in ("AB", "BC", "CA")]
    shape = {"name": "f", "shape": "explicit", "members": [*PLACES], "displacements": [*PLACES.values()]}
    law = {"gain": 1.0, "control_period": 0.01}
    usual = {"time": {"end": 1.0}, "controller": law, "communication": edges, "formations": [shape]}
    return build_scenario(START, {}, [], **(usual | fields))


def mixed() -> Scenario:
    """A boat, a drone and a target, with every kind of edge and map."""
    return build_scenario(
        {"boat": {"position": [0, 1], "heading": 30}, "drone": [2, 0, 5]},
        {"T": [1, 3, 1]},
        [
            {"between": ["boat", "T"], "measures": "range", "offset": [2.0]},
            {"between": ["drone", "T"], "measures": "bearing", "map": "identity", "offset": [0, 0.6, -0.8]},
            {"between": ["drone", "T"], "offset": [0.1, 0.2, 0.3]},
            {"between": ["boat", "T"], "measures": "position", "map": "space"},
        ],
        scene={"height": 0.5},
        communication=[
            {"between": ["boat", "drone"], "measures": "range", "map": "space", "offset": [4.0], "weight": 2.0},
            {"between": ["drone", "boat"], "measures": "bearing", "map": "local_frame", "offset": [0.6, 0.8]},
            {"between": ["boat", "drone"], "measures": "range", "offset": [1.5], "directed": True},
        ],
    )


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10**6))
def test_the_law_is_the_gradient_of_the_sheaf(seed: int) -> None:
    """Compiled code and `NonlinearSheaf` agree on every kind of edge and map; the linearised team has it too."""
    system = mixed().system
    team = system.team
    x = np.random.default_rng(seed).normal(scale=2.0, size=(3, 3))
    x[0, 2] = 0.0
    found = disagreement(system.law, x)
    stacked = team.pack(x)
    assert np.allclose(team.pack(found)[:5], team.nonlinear_sheaf.gradient(stacked)[:5], atol=1e-13)
    linear = team.linearised(x)
    assert np.allclose(linear.nonlinear_sheaf.gradient(stacked)[:5], team.pack(found)[:5], atol=1e-12)


FAR = list_members({"A": [-1.0, 0.3], "B": [2.0, -0.5], "C": [0.3, 2.4]})


@pytest.mark.parametrize(("measures", "period"), [("range", 0.01), ("bearing", 0.01), long("bearing", 0.0)])
def test_invariants_hold_over_100_000_periods(measures: str, period: float) -> None:
    """Under a gain so small that the team moves all the time, nothing adds up: centroid, sum x_i x u_i, and growth.

    Where nothing is held, sum |x_i - c|^2 of bearings does not change.
    """
    law = {"gain": 0.01, "control_period": period}
    run = run_ideal(keeping(measures, agents=FAR, controller=law, time={"end": 1000.0}).system)
    x, u = run.positions[..., :2], run.log.command[..., :2]
    assert len(x) == 100_001
    assert np.abs(u[-1]).max() > 1e-10
    assert np.abs(x.mean(axis=1) - x[0].mean(axis=0)).max() < 1e-10
    if measures == "range":
        assert np.abs((x[..., 0] * u[..., 1] - x[..., 1] * u[..., 0]).sum(axis=1)).max() < 1e-10
    else:
        size = ((x - x.mean(axis=1, keepdims=True)) ** 2).sum(axis=(1, 2))
        grown = np.cumsum(1e-4 * (u[:-1] ** 2).sum(axis=(1, 2)))
        assert grown[-1] > 1e-5
        assert np.abs(size[1:] - size[0] - grown * (period > 0.0)).max() < (1e-10 if period else 1e-9)


def test_directed_edges_move_their_tails_alone() -> None:
    system = keeping("position", directed=True).system
    x = system.initial.copy()
    for tail, head in (("A", "B"), ("B", "C"), ("C", "A")):
        moved = x.copy()
        moved[system.team.index[tail]] += 0.3
        changed = (disagreement(system.law, moved) != disagreement(system.law, x)).any(axis=1)
        assert not changed[system.team.index[head]]
        assert changed[system.team.index[tail]]


@pytest.mark.long
def test_noise_is_that_of_the_range_and_of_the_bearing() -> None:
    """Of a range in m along it, of a bearing in degrees across it, to 5 % over 4000 samples."""
    for measures, noise in (("range", 0.02), ("bearing", 2.0)):
        scenario = keeping(
            measures,
            time={"end": 40.0},
            controller={"gain": 1e-12, "control_period": 0.01},
            links={"communication": {"noise": noise}, "record": True},
        )
        run = mjsheaf.simulate(scenario, backend="ideal")
        y = run["measurement"].values[:, :2]
        z = run.agent_position.values[0, 1, :2] - run.agent_position.values[0, 0, :2]
        length = np.linalg.norm(z)
        along = y @ z / length - length
        across = (y @ [-z[1], z[0]]) / length
        if measures == "range":
            assert np.std(along) == pytest.approx(noise, rel=0.05)
            assert np.abs(across).max() < 1e-9
        else:
            angle = np.arctan2(across, y @ z / length)
            assert np.rad2deg(np.std(angle)) == pytest.approx(noise, rel=0.05)
            assert np.abs(np.linalg.norm(y, axis=1) - length).max() < 1e-9


@pytest.mark.long
def test_laws_in_python_get_measurement_jacobian_and_residual() -> None:
    """By these and the maps the law can be written anew: both runs are alike."""

    def law(t: float, sample: Any) -> Any:
        eta = np.zeros((3, 3))
        for k, edge in enumerate(sample.edges):
            pull = sample.jacobians[k].T @ sample.residuals[k]
            eta[sample.team.index[edge.tail], :2] -= edge.F_tail.T @ pull
            eta[sample.team.index[edge.head], :2] += edge.F_head.T @ pull
        return -eta

    compiled = mjsheaf.simulate(keeping("range"), backend="ideal")
    python = mjsheaf.simulate(keeping("range"), backend="ideal", controller=law)
    assert np.allclose(compiled.agent_position.values, python.agent_position.values, atol=1e-12, equal_nan=True)


def one_edge(**fields: Any) -> dict[str, Any]:
    return {"communication": [{"between": ["A", "B"], "measures": "range"} | fields]}


RANGE_BEARING = {"kind": "range_bearing", "range_noise": 0.1}
NEWTON = {"controller": {"newton": {"rounds": 2}}}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (one_edge(offset=[-1.0]), "communication.0: offset"),
        (one_edge(measures="bearing", offset=[1.0, 1.0]), "unit vector"),
        ({"formations": []}, "no range, as both ends have one place"),
        (one_edge(sensor=RANGE_BEARING), "range_bearing measures positions"),
        ({"links": {"all": {"sensor": RANGE_BEARING}}}, "measures positions"),
        (one_edge(weight=[[1.0, 0.0], [0.0, 1.0]]), "positive number"),
        (NEWTON | {"links": {"rounds": {"loss": 0.1}}}, "controller.newton"),
        (NEWTON | {"links": {"all": {"range": 9.0}}}, "controller.newton"),
    ],
)
def test_bad_input_is_refused(fields: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        keeping("range", **fields)


PLACES_OF_TARGETS = {"T": [0.0, 0.0], "U": [6.0, 0.0], "W": [2.0, 5.0]}
PLACES_OF_TRACKERS = {"A": [1.0, 1.0], "B": [4.0, 1.0], "C": [2.0, 3.0]}


def tracking(measures: str, terms: Any, offset: Any = (0.1, -0.2), **fields: Any) -> Scenario:
    """Three agents that measure one another and three targets that move alike; all edges fit together."""
    places = PLACES_OF_TARGETS | PLACES_OF_TRACKERS
    motion = {"kind": "lissajous", "amplitude": [2, 1], "rate": [0.3, 0.2], "phase": [0, 1]}

    def edges(*pairs: str) -> list[Any]:
        found = []
        for tail, head in map(tuple, pairs):
            z = np.subtract(places[head], places[tail])
            length = float(np.linalg.norm(z))
            desired = [length] if measures == "range" else (z / length).tolist()
            found.append({"between": [tail, head], "measures": measures, "offset": desired})
        return found

    usual = make_fields(
        {id: np.add(x, offset).tolist() for id, x in PLACES_OF_TRACKERS.items()},
        {id: {"position": x, "motion": motion} for id, x in PLACES_OF_TARGETS.items()},
        edges("AT", "AU", "BU", "BW", "CW", "CT"),
        time={"end": 4.0},
        controller={"gain": 1.0, "control_period": 0.02, **terms},
        communication=edges("AB", "BC", "CA"),
    )
    return make_scenario(usual | fields)


@pytest.mark.long
@pytest.mark.parametrize("measures", ["range", "bearing"])
def test_feedforward_of_ranges_and_bearings_is_the_velocity_of_q_star(measures: str) -> None:
    """All targets move alike, and so does q*; with exact rounds feedforward is that velocity, a sample late."""
    run = mjsheaf.simulate(tracking(measures, {"feedforward": {"rounds": 60}}, offset=(0.0, 0.0)), backend="ideal")
    q = run.harmonic_extension.values[..., :2]
    target = run.target_position.values[:, :1, :2]
    assert np.abs((q - q[0]) - (target - target[0])).max() < 1e-9
    assert run.tracking_error.values[0].max() < 1e-12
    without = mjsheaf.simulate(tracking(measures, {}, offset=(0.0, 0.0)), backend="ideal")
    assert run.tracking_error.values.max() < 0.02
    assert without.tracking_error.values.max() > 0.2


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("measures", ["range", "bearing"])
def test_newton_of_ranges_and_bearings_goes_straight_to_q_star(measures: str, in_python: None) -> None:
    """With exact rounds and targets at rest every error falls by 1 - k1 h a period, near q* to first order."""
    still = list_members(PLACES_OF_TARGETS)
    scenario = tracking(measures, {"newton": {"rounds": 60}}, offset=(1e-4, -2e-4), targets=still, time={"end": 2.0})
    run = mjsheaf.simulate(scenario, backend="ideal")
    error = run.tracking_error.values
    assert error[-1] == pytest.approx(error[0] * 0.98**100, rel=2e-3)
    assert mjsheaf.check(scenario, trial=False)["law"]["spectral_radius"] == pytest.approx(0.98, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("measures", ["range", "bearing"])
@pytest.mark.parametrize("links", [{"loss": 0.3}, {"delay": 0.04}])
def test_rounds_over_imperfect_links_have_the_same_fixed_point(measures: str, links: Any) -> None:
    """They solve with H of the measured positions too: the error ends far below that without terms."""
    terms = {"newton": {"rounds": 6}, "feedforward": {"rounds": 8}}
    run = mjsheaf.simulate(tracking(measures, terms, time={"end": 20.0}, links={"rounds": links}), backend="ideal")
    without = mjsheaf.simulate(tracking(measures, {}, time={"end": 20.0}), backend="ideal")
    assert run.tracking_error.values[-1].max() < 0.1 * without.tracking_error.values[-1].max()


@pytest.mark.parametrize("measures", ["range", "bearing"])
def test_no_position_makes_h_larger_than_its_bound(measures: str) -> None:
    """Rounds diverge in eigenvectors above the bound; agents almost in one place have the steepest bearings."""
    from mjsheaf.law.terms import apply_laplacian

    system = tracking(measures, {"newton": {"rounds": 2}}).system
    rng = np.random.default_rng(5)
    for scale in (1e-6, 0.3, 5.0):
        x = np.zeros((6, 3))
        x[:, :2] = rng.normal(scale=scale, size=(6, 2))
        y = np.zeros(len(system.law.edges.b))
        measure(system.law.edges, x, y)
        H = np.zeros((6, 6))
        for column in range(6):
            one, out = np.zeros((6, 3)), np.zeros((6, 3))
            one[column // 2, column % 2] = 1.0
            apply_laplacian(system.law.edges, system.law.terms, y, one, out)
            H[:, column] = out[:3, :2].ravel()
        values = np.linalg.eigvalsh(H)
        assert np.allclose(H, H.T, atol=1e-12)
        assert values[-1] <= system.law.terms.eigenvalues[1] + 1e-9
        if measures == "range":  # without a cap H is that of the linearised team
            linear = system.team.linearised(x).dirichlet.H.toarray()
            assert np.allclose(H, linear, atol=1e-12)


def test_rounds_expect_bearings_at_half_the_distance_of_q_star_whatever_they_weigh() -> None:
    pairs = [["A", "B"], ["B", "C"], ["C", "A"]]
    edges = [
        {"between": pair, "measures": "bearing", "weight": w} for pair, w in zip(pairs, (0.5, 1.0, 3.0), strict=True)
    ]
    system = keeping("bearing", communication=edges).system
    slopes = bound_slopes(system.team, system.initial)
    q_star = system.team.at_rest(system.initial).reshape(3, 2)
    distances = np.linalg.norm(q_star - np.roll(q_star, -1, axis=0), axis=1)
    assert slopes is not None
    assert slopes.steepest == pytest.approx(2.0 / distances)


@pytest.mark.slow(each=True)
@pytest.mark.parametrize("terms", [{}, {"newton": {"rounds": 4}, "feedforward": {"rounds": 4}}], ids=["law", "rounds"])
@pytest.mark.parametrize("measures", ["range", "bearing"])
def test_agents_in_one_place_have_finite_commands(measures: str, terms: dict[str, Any], in_python: None) -> None:
    """An edge without a direction counts with M = 0; a third agent pulls the two apart or leaves them there."""
    assert not disagreement(keeping(measures).system.law, np.zeros((3, 3))).any()
    together = {id: [1.0, 1.0] for id in "AB"}
    law = {"gain": 1.0, "control_period": 0.02, **terms}
    for scenario in (
        tracking(measures, terms, agents=list_members(PLACES_OF_TRACKERS | together)),
        keeping(measures, agents=list_members(together | {"C": [2.0, 3.0]}), controller=law),
        keeping(measures, agents=list_members(together | {"C": [1.0, 1.0]}), controller=law),
    ):
        run = mjsheaf.simulate(scenario, backend="ideal")
        assert np.isfinite(run.velocity_command.values[..., :2]).all()
        assert np.isfinite(run.agent_position.values[..., :2]).all()


@pytest.mark.long
@pytest.mark.parametrize("term", ["newton", "feedforward"])
@pytest.mark.parametrize("measures", ["range", "bearing"])
def test_rounds_of_a_team_that_loses_an_agent_are_those_of_the_rest(measures: str, term: str) -> None:
    """Oracle: the team that never had the agent; and once it is back, the team that never lost it."""
    terms = {term: {"rounds": 4}}
    events = [{"time": 0.1, "lose": "C"}, {"time": 0.2, "join": "C"}]
    scenario = tracking(measures, terms, time={"end": 0.4}, events=events)
    whole = tracking(measures, terms)
    kept = {"agents": whole.agents[:2], "communication": whole.communication[:1], "sensing": whole.sensing[:4]}
    alone = whole.model_copy(update=kept)
    lost, back = (phase.system.law.terms for phase in scenario.phases[1:])
    assert lost.eigenvalues == pytest.approx(alone.system.law.terms.eigenvalues, rel=1e-9)
    np.testing.assert_array_equal(back.eigenvalues, whole.system.law.terms.eigenvalues)
    for backend in ("ideal", "physics"):
        run = mjsheaf.simulate(scenario, backend=backend, progress=False)
        assert np.isfinite(run.agent_position.values[..., :2]).all()
        assert np.isfinite(run.velocity_command.values[..., :2]).all()


@pytest.mark.slow
@pytest.mark.parametrize("measures", ["range", "bearing"])
def test_newton_of_a_formation_alone_ends_at_rest(measures: str) -> None:
    """Rounds begin anew at every sample, so that nothing remains in motions that are free; the centroid stays."""
    terms = {"gain": 1.0, "control_period": 0.02, "newton": {"rounds": 5}}
    scenario = keeping(measures, controller=terms, time={"end": 20.0})
    run = mjsheaf.simulate(scenario, backend="ideal")
    u = run.velocity_command.values[..., :2]
    x = run.agent_position.values[..., :2]
    assert np.abs(u[-1]).max() < 1e-7 * np.abs(u[0]).max()
    assert np.abs(x.mean(axis=1) - x[0].mean(axis=0)).max() < 1e-12
    assert mjsheaf.check(scenario, trial=False)["ok"]


def test_directed_teams_refuse_rounds_and_other_edges() -> None:
    """Rounds assume a symmetric H; target edges and anchors are never directed."""
    with pytest.raises(InputError, match="symmetric H"):
        keeping("position", directed=True, controller={"newton": {"rounds": 2}})
    targets = list_members({"T": [0, 0], "U": [1, 0]})
    for field in ({"directed": True}, {"measures": "range", "offset": [1.0]}):
        with pytest.raises(InputError, match="target_edges"):
            keeping(targets=targets, target_edges=[{"between": ["T", "U"], **field}], sensing=[["A", "T"], ["A", "U"]])
    with pytest.raises(InputError, match="anchors"):
        keeping(anchors=[{"agent": "A", "axes": ["x"], "value": [0.0], "directed": True}])


def test_swarms_take_kinds_of_edges() -> None:
    swarm = {"size": 12, "about": "T", "measures": "range", "directed": True}
    team = make_scenario({"swarm": swarm, "targets": [{"id": "T", "position": [0, 0]}]}).team
    assert {(e.measures, e.directed) for e in team.communication} == {("range", True)}
    assert {e.measures for e in team.sensing} == {"range"}


def test_q_star_of_a_point_reflection_is_the_shape() -> None:
    """Where the bearing law rests at its unstable equilibrium, q* is the shape, with its centroid and size."""
    places = np.array(list(PLACES.values()))
    agents = list_members(dict(zip(PLACES, (-2.0 * places).tolist(), strict=True)))
    system = keeping("bearing", agents=agents).system
    assert np.abs(disagreement(system.law, system.initial)).max() < 1e-12
    q = system.team.harmonic_extension(system.initial)[:, :2]
    assert np.allclose(q - q.mean(axis=0), 2.0 * (places - places.mean(axis=0)), atol=1e-12)
    assert np.allclose(q.mean(axis=0), -2.0 * places.mean(axis=0), atol=1e-12)


def test_q_star_continues_and_is_exact() -> None:
    """An agent that ranges two moving targets has its q* at both distances, on one side, at all times."""
    motion = {"kind": "lissajous", "amplitude": [2, 1], "rate": [0.7, 0.5], "phase": [0, 1]}
    seen = [{"between": ["A", t], "measures": "range", "offset": [1.5]} for t in "TU"]
    fields: dict[str, Any] = {
        "time": {"end": 6.0},
        "controller": {"gain": 3.0, "control_period": 0.02},
        "target_motion": motion,
    }
    scenario = make_scenario(team_of({"A": [1, -2]}, {"T": [0, 0], "U": [2, 0]}, sensing=seen, **fields))
    run = mjsheaf.simulate(scenario, backend="ideal")
    q, p = run.harmonic_extension.values[:, 0, :2], run.target_position.values[..., :2]
    assert np.abs(np.linalg.norm(q[:, None] - p, axis=2) - 1.5).max() < 1e-9
    assert np.linalg.norm(np.diff(q, axis=0), axis=1).max() < 0.1
    assert run.tracking_error.values[-1] < 1.0
