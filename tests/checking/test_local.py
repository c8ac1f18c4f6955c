"""Answers of `check` on teams with range, bearing or directed edges, and of teams without targets."""

import itertools
from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.arrays import Array
from mjsheaf.checking import examine_scenario
from mjsheaf.checking.record import headline
from mjsheaf.checking.spectrum import held_eigenvalues
from mjsheaf.scenario import Scenario
from tests.builders import build_scenario, list_members, make_fields, require
from tests.checking.test_screen import assert_record_fits
from tests.oracles.frameworks import CUBE, FRAMEWORKS, RING, SIDES, SQUARE, TETRAHEDRON, TRIANGLE, complete
from tests.running import analyse, run_ideal
from tests.strategies import slow

HELD = {"gain": 1.0, "control_period": 0.01}
CONTINUOUS = {"gain": 1.0, "control_period": 0}


def cycle(n: int) -> tuple[Array, list[tuple[int, int]]]:
    """Return n places on the unit circle, and a ring of pairs in which each agent looks at the next."""
    angles = 2.0 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(angles), np.sin(angles)]), [(k, (k + 1) % n) for k in range(n)]


def keeping(places: Any, pairs: Any, measures: str = "position", directed: bool = False, **fields: Any) -> Scenario:
    """Agents at the places that they should keep; fields replace fields."""
    members = {f"A{k}": x for k, x in enumerate(places)}
    ids = [*members]
    edges = [{"between": [ids[i], ids[j]], "measures": measures, "directed": directed} for i, j in pairs]
    formation = {"name": "f", "shape": "explicit", "members": ids, "displacements": places}
    usual = {"time": {"end": 1.0}, "controller": HELD, "communication": edges, "formations": [formation]}
    return build_scenario(members, {}, [], **{**usual, **fields})


@pytest.mark.slow(first=True)
@pytest.mark.parametrize(
    ("places", "pairs", "measures", "rank", "needed", "rate"),
    [
        *FRAMEWORKS,
        (TRIANGLE, [(0, 1), (1, 2)], "position", 4, 4, 1.0),
        (TRIANGLE, [(0, 1)], "position", 2, 4, None),
    ],
)
def test_checkpoints_of_formations(
    places: Any, pairs: Any, measures: str, rank: int, needed: int, rate: float | None
) -> None:
    """Ranks exactly, rates to 1e-6; a team that is not rigid is not ok."""
    record = analyse(keeping(places, pairs, measures))
    require(record["rigidity"], {"rank": rank, "needed": needed, "rigid": rank == needed, "localizable": None})
    require(record, {"ok": rank == needed, "law.stable": True, "theorem.holds": None, "theorem.applies": False})
    assert record["theorem"]["reason"]
    if rate is not None:
        assert record["rigidity"]["rate"] == pytest.approx(rate, abs=1e-6)
        assert record["law"]["rate"] == pytest.approx(-np.log(1.0 - 0.01 * rate) / 0.01, abs=1e-5)


APART = [[0, 0], [2.5, 0.4], [0.3, 3.0]]


@pytest.mark.parametrize(
    ("places", "start", "measures"),
    [
        (TRIANGLE, APART, "bearing"),
        slow(TETRAHEDRON, [[0, 0.5, 0], [2, 0, 0.7], [0.3, 2.2, -0.4], [1, 0, 1.5]], "bearing"),
        slow(TRIANGLE, APART, "range"),
    ],
)
def test_the_rate_of_a_team_far_from_its_shape_is_that_with_which_its_run_ends(
    places: Any, start: Any, measures: str
) -> None:
    """q* has the size that the bearing law keeps, and so the rate of the shape that the team reaches, to 1 %."""
    agents, law = list_members({f"A{k}": x for k, x in enumerate(start)}), {"gain": 1.0, "control_period": 0.05}
    scenario = keeping(places, complete(len(places)), measures, agents=agents, controller=law, time={"end": 40.0})
    run = simulate(scenario, backend="ideal")
    eta = run.disagreement.values.max(axis=1)
    first = int(np.argmax(eta < 1e-5 * eta[0]))
    last = int(np.argmax(eta < 1e-7 * eta[0]))
    assert 0 < first < last
    measured = np.log(eta[first] / eta[last]) / (0.05 * (last - first))
    assert analyse(scenario)["law"]["rate"] == pytest.approx(measured, rel=0.01)
    q, x = (v.values[..., : len(places[0])] for v in (run.harmonic_extension, run.agent_position))
    assert np.abs(q[0].mean(axis=0) - x[0].mean(axis=0)).max() < 1e-6
    if measures == "bearing":
        size = [np.linalg.norm(y - y.mean(axis=0)) for y in (q[0], x[0], x[-1])]
        assert size[0] == pytest.approx(size[1], rel=2e-4)
        assert size[0] == pytest.approx(size[2], rel=0.01)


@pytest.mark.long
def test_one_bearing_leaves_the_distance_as_it_is() -> None:
    """A target at rest fixes the direction to an agent far from it, and not the distance, which the law keeps."""
    edge = {"between": ["A", "T"], "measures": "bearing", "offset": [0, -1]}
    scenario = build_scenario({"A": [1.2, 0.9]}, {"T": [0, 0]}, [edge], time={"end": 10.0}, controller=HELD)
    team, x = scenario.team, scenario.system.initial
    assert team.harmonic_extension(x)[0] == pytest.approx([0.0, 1.5, 0.0], abs=3e-4)
    end = simulate(scenario, backend="ideal", allow_drift=True).agent_position.values[-1, 0]
    assert end[:2] == pytest.approx([0.0, 1.5], abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("measures", ["range", "bearing"])
@pytest.mark.parametrize("angle", [30.0, 90.0, 150.0, 180.0])
def test_one_agent_and_two_targets(measures: str, angle: float) -> None:
    """The rate is 1 - |cos theta|, of bearings over the distance; collinear targets do not locate the agent."""
    theta = np.deg2rad(angle)
    r = 2.0
    targets = np.array([[r, 0.0], [r * np.cos(theta), r * np.sin(theta)]])
    offsets = [[r], [r]] if measures == "range" else (targets / r).tolist()
    sensing = [{"between": ["A", f"T{k}"], "measures": measures, "offset": b} for k, b in enumerate(offsets)]
    places = {f"T{k}": x for k, x in enumerate(targets.tolist())}
    record = analyse(make_fields({"A": [0, 0]}, places, sensing, controller=HELD))
    wanted = (1.0 - abs(np.cos(theta))) / (r if measures == "bearing" else 1.0)
    located = angle != 180.0
    require(record, {"ok": located, "rigidity.localizable": located})
    if located:
        assert record["rigidity"]["rate"] == pytest.approx(wanted, abs=1e-6)
    else:
        free = record["relative_cohomology"]["basis"][0]["description"]
        assert free == f"A is free along {'y' if measures == 'range' else 'x'}"


@pytest.mark.parametrize(("n", "margin"), [(3, 0.604600), (4, 0.555360)])
def test_directed_cycles(n: int, margin: float) -> None:
    """The rate is 1 - cos(2 pi / n), and the continuous delay margin that of the literature; held ones come near.

    Runs converge 3 % below that margin, and diverge 3 % above it.
    """
    (places, ring), period = cycle(n), 0.005
    continuous = analyse(keeping(places.tolist(), ring, directed=True, controller=CONTINUOUS))
    assert continuous["ok"]
    assert continuous["rigidity"]["rate"] == pytest.approx(1.0 - np.cos(2.0 * np.pi / n), abs=1e-9)
    assert continuous["links"]["delay_margin"] == pytest.approx(margin, abs=1e-6)
    held = analyse(keeping(places.tolist(), ring, directed=True))
    assert "not symmetric" in held["theorem"]["reason"]
    values = 1.0 - np.exp(2j * np.pi * np.arange(1, n) / n)
    require(
        held,
        {
            "ok": True,
            "theorem.holds": None,
            "law.spectral_radius": pytest.approx(np.abs(1.0 - 0.01 * values).max(), abs=1e-9),
            "law.largest_gain": pytest.approx((2.0 * values.real / np.abs(values) ** 2).min() / 0.01),
            "links.delay_margin": pytest.approx(margin, abs=0.02),
        },
    )
    start = places + np.random.default_rng(n).normal(scale=0.1, size=places.shape)
    agents = list_members({f"A{k}": x for k, x in enumerate(start.tolist())})
    law = {"gain": 1.0, "control_period": period}
    for periods, converges in ((np.floor(0.97 * margin / period), True), (np.ceil(1.03 * margin / period), False)):
        links = {"communication": {"delay": float(periods * period)}}
        fields: dict[str, Any] = {"agents": agents, "controller": law, "links": links, "time": {"end": 60.0}}
        delayed = keeping(places.tolist(), ring, directed=True, **fields)
        eta = np.linalg.norm(run_ideal(delayed.system).log.residual[:, :n], axis=(1, 2))
        middle, end = eta[4000:8000].max(), eta[8000:].max()
        assert end < 0.8 * middle if converges else end > 1.2 * middle


@pytest.mark.parametrize(("agents", "needed"), [(1, 0), (2, 1), (3, 3)])
def test_a_few_agents_in_the_plane_need_no_more_ranks_than_they_have_shapes(agents: int, needed: int) -> None:
    """An agent alone has no turn of its own."""
    places = {f"A{k}": [k, 0.5 * k * k] for k in range(agents)}
    links = [{"between": [*pair], "measures": "range", "offset": [1.0]} for pair in itertools.pairwise(places)]
    sensing = [{"between": ["A0", "T"], "measures": "range", "offset": [2.0]}]
    record = analyse(make_fields(places, {"T": [5, 0]}, sensing, communication=links))
    assert record["rigidity"]["needed"] == needed


LINE = {"A": [0, 0], "B": [1, 0], "C": [2, 0]}


def following(**fields: Any) -> Scenario:
    """A leader that senses a target, and two that follow one after the other; fields replace fields."""
    weights = {"BA": 2.0, "CB": 1.0, "CA": 3.0}
    links = [{"between": [*pair], "directed": True, "weight": weight} for pair, weight in weights.items()]
    sensing = [{"between": ["A", "T"], "weight": 5.0}]
    usual = {"controller": HELD, "communication": links}
    return build_scenario(LINE, {"T": [0, 1]}, sensing, **{**usual, **fields})


def test_unlike_delays_of_a_directed_team_are_undecided() -> None:
    """The limit of equal delays is sufficient only where H is symmetric."""
    links = analyse(following(links={"communication": {"delay": 0.01}}))["links"]
    assert links["delay_margin"] > 0.01
    assert links["stable"] is None
    assert "alike" in links["delay"]["reason"]


def test_a_directed_acyclic_team_has_its_out_degrees_as_eigenvalues() -> None:
    """A measures 5, B 2, C 4; where the leader looks at those behind, nothing holds them."""
    values = held_eigenvalues(following().team)
    assert np.allclose(np.sort(values.real), [2, 2, 4, 4, 5, 5])
    assert np.abs(values.imag).max() < 1e-12
    record = analyse(following())
    assert record["ok"]
    require(record, {"rigidity.rate": pytest.approx(2.0), "rigidity.localizable": True})
    looking_back = [{"between": ["A", "B"], "directed": True}, {"between": ["A", "C"], "directed": True}]
    lost = analyse(following(communication=looking_back))
    assert not lost["ok"]
    require(lost, {"law.stable": False, "rigidity.localizable": False})


def test_the_steady_error_of_a_directed_team_is_that_of_its_run() -> None:
    """H is that of tails alone; what is known of a symmetric H alone is not said."""
    motion = {"kind": "lissajous", "amplitude": [3, 2], "rate": [0.3, 0.5], "phase": [0, 1]}
    law = {"gain": 1.0, "control_period": 0.02}
    targets = [{"id": "T", "position": [0, 1], "motion": motion}]
    scenario = following(targets=targets, controller=law, time={"end": 20.0})
    record = analyse(scenario)
    error = simulate(scenario, backend="ideal").tracking_error.values
    assert record["steady"]["ideal"] == pytest.approx(np.sqrt((error[500:] ** 2).mean()), rel=1e-3)
    assert record["margins"]["hold"] is None
    with_integral = following(targets=targets, controller={**law, "integral": {"gain": 0.2}}, time={"end": 20.0})
    integral = analyse(with_integral)
    assert integral["steady"]["reason"] == "H is not symmetric, and the law has terms"


def test_directed_teams_with_many_rows_are_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjsheaf.checking.spectrum.DENSE_STATES", 5)
    record = analyse(following())
    why = "H has 6 rows; all its eigenvalues are found up to 5"
    assert (record["margins"]["bodies"]["stable"], record["margins"]["bodies"]["reason"]) == (None, why)
    assert (record["steady"]["ideal"], record["steady"]["reason"]) == (None, why)


@pytest.mark.parametrize("terms", [{}, *map(slow, ({"integral": {"gain": 0.2}}, {"drift": {"filter": 0.1}}))])
def test_the_loops_of_directed_teams_are_those_of_their_eigenvalues(terms: Any) -> None:
    """With real eigenvalues they are those of an undirected team with the same ones, on bodies too."""
    control = {**HELD, **terms}
    apart = [{"between": [*pair], "weight": 1e-9} for pair in ("AB", "BC")]
    sensing = [{"between": [id, "T"], "weight": weight} for id, weight in (("A", 5.0), ("B", 2.0), ("C", 4.0))]
    same = make_fields(LINE, {"T": [0, 1]}, sensing, controller=control, communication=apart)
    found, expected = analyse(following(controller=control)), analyse(same)
    assert found["law"]["stable"]
    assert found["law"]["spectral_radius"] == pytest.approx(expected["law"]["spectral_radius"], abs=1e-7)
    bodies, of_same = (record["margins"]["bodies"] for record in (found, expected))
    if terms:
        assert bodies["stable"] is None
        return
    assert bodies["stable"]
    assert bodies["spectral_radius"] == pytest.approx(of_same["spectral_radius"], rel=1e-6)
    assert bodies["largest_gain"] == pytest.approx(of_same["largest_gain"], rel=2e-3)


def test_the_answer_begins_with_whether_a_team_is_rigid() -> None:
    for scenario in (keeping(TRIANGLE, complete(3), "range"), following(), keeping(SQUARE, RING, "bearing")):
        record = examine_scenario(scenario).record
        assert_record_fits(record, "mine")
        assert "rigid" in headline(record)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("places", "pairs", "measures", "count"),
    [
        (SQUARE, RING, "range", 1),
        (SQUARE, RING, "bearing", 1),
        (SQUARE, [(0, 1), (1, 2), (2, 3)], "range", 2),
        (SQUARE, [(0, 1)], "range", 4),
        (CUBE, SIDES, "range", 6),
        (TETRAHEDRON, [(0, 1), (1, 2), (2, 3)], "range", 3),
        (TETRAHEDRON, [(0, 1), (1, 2), (2, 3)], "bearing", 1),
        (TRIANGLE, [(0, 1)], "position", 1),
    ],
)
def test_the_edges_that_check_suggests_make_a_formation_rigid(
    places: Any, pairs: Any, measures: str, count: int
) -> None:
    """Their number is the smallest, the formation with them is rigid, and its rate is the one predicted."""
    bracing = analyse(keeping(places, pairs, measures))["rigidity"]["bracing"]
    assert len(bracing["edges"]) == count
    assert bracing["exact"]
    assert all(edge["measures"] == measures for edge in bracing["edges"])
    added = [tuple(int(id[1:]) for id in edge["between"]) for edge in bracing["edges"]]
    braced = analyse(keeping(places, [*pairs, *added], measures))
    assert braced["ok"]
    require(braced, {"rigidity.bracing": None, "rigidity.rate": pytest.approx(bracing["rate"], rel=1e-09)})


def test_a_flex_is_described_with_a_frame_at_rest() -> None:
    """The ring of four folds along two parallel sides."""
    bracing = analyse(keeping(SQUARE, RING, "range"))["rigidity"]["bracing"]
    assert bracing["flexes"] == ["A2, A3 are free along x together, relative to A0"]


def test_nothing_braces_ranges_on_a_line() -> None:
    """Ranges measure nothing across a line, to first order."""
    bracing = analyse(keeping([[0, 0], [1, 0], [2, 0]], complete(3), "range"))["rigidity"]["bracing"]
    assert bracing["edges"] == []
    assert not bracing["exact"]
    assert len(bracing["flexes"]) == 1


@pytest.mark.parametrize("measures", ["position", "range", "bearing"])
def test_noise_of_links_of_a_free_team_is_that_of_its_shape(measures: str) -> None:
    """The answers leave out motions that no edge measures: the RMS is that of a random walk of the law in H's range."""
    scenario = keeping(TRIANGLE, complete(3), measures, links={"all": {"noise": 0.5}})
    values = np.linalg.eigvalsh(scenario.system.local.team.dirichlet.H.toarray())
    values = values[values > 1e-9]
    sigma, h = np.deg2rad(0.5) if measures == "bearing" else 0.5, HELD["control_period"]
    # Edges of weight K and noise s^2 / K add the covariance s^2 H h^2 to e in a period.
    expected = np.sqrt(np.sum(sigma**2 * values * h**2 / (1.0 - (1.0 - h * values) ** 2)))
    require(analyse(scenario), {"links.stable": True, "links.noise_rms": pytest.approx(expected, rel=1e-9)})


@pytest.mark.parametrize("terms", [{}, {"integral": {"gain": 0.05}}])
def test_losses_of_a_free_team_are_those_of_its_shape(terms: Any) -> None:
    """A loss that never happens leaves the square of the spectral radius, with and without terms."""
    control = {**HELD, **terms}
    exact = analyse(keeping(TRIANGLE, complete(3), "range", controller=control))["law"]["spectral_radius"] ** 2
    for loss in (1e-12, 0.3):
        links = {"all": {"loss": loss, "noise": 0.5}}
        found = analyse(keeping(TRIANGLE, complete(3), "range", controller=control, links=links))["links"]
        assert found["stable"]
        assert found["mean_square_rate"] < 1.0
        assert found["mean_square_rate"] == pytest.approx(exact, rel=1e-9) or loss > 0.1


def test_newton_of_a_team_without_targets_solves_in_the_range_of_h() -> None:
    """One round is exact where all eigenvalues of H but the zeros are equal: e falls by 1 - k1 h a period."""
    control = {"gain": 1.0, "control_period": 0.1, "newton": {"rounds": 1}}
    scenario = keeping(TRIANGLE, complete(3), "position", controller=control, time={"end": 2.0})
    assert analyse(scenario)["law"]["spectral_radius"] == pytest.approx(0.9, abs=1e-9)
    agents = list_members({"A0": [0, 0], "A1": [3, 1], "A2": [1, 4]})
    moved = keeping(TRIANGLE, complete(3), "position", controller=control, time={"end": 2.0}, agents=agents)
    result = simulate(moved, backend="ideal")
    eta = result.disagreement.values
    assert eta[-1] == pytest.approx(eta[0] * 0.9 ** (len(eta) - 1), rel=1e-9)
    centroid = result.agent_position.values[..., :2].mean(axis=1)
    assert centroid == pytest.approx(np.broadcast_to(centroid[0], centroid.shape), abs=1e-12)
