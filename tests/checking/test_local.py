"""Answers of `check` on teams with range, bearing or directed edges, and of teams without targets."""

import itertools
import json
from typing import Any

import numpy as np
import pytest

from mjsheaf import simulate
from mjsheaf.checking import check
from mjsheaf.scenario import Scenario
from tests.builders import make_scenario
from tests.running import run_ideal

HALF = 3**0.5 / 2
TRIANGLE = [[0, 0], [1, 0], [0.5, HALF]]
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
TETRAHEDRON = [[0, 0, 0], [1, 0, 0], [0.5, HALF, 0], [0.5, HALF / 3, (2 / 3) ** 0.5]]
CUBE = [list(x) for x in itertools.product((0, 1), repeat=3)]
RING = [(0, 1), (1, 2), (2, 3), (3, 0)]
SIDES = [(i, j) for i, j in itertools.combinations(range(8), 2) if np.abs(np.subtract(CUBE[i], CUBE[j])).sum() == 1]


def complete(n: int) -> list[tuple[int, int]]:
    """Return all pairs of n agents."""
    return list(itertools.combinations(range(n), 2))


def keeping(places: Any, pairs: Any, measures: str = "position", directed: bool = False, **fields: Any) -> Scenario:
    """Agents at the places that they should keep; fields replace fields."""
    ids = [f"A{k}" for k in range(len(places))]
    edges = [{"between": [ids[i], ids[j]], "measures": measures, "directed": directed} for i, j in pairs]
    return make_scenario(
        {
            "time": {"end": 1.0},
            "controller": {"gain": 1.0, "control_period": 0.01},
            "agents": [{"id": id, "position": x} for id, x in zip(ids, places, strict=True)],
            "communication": edges,
            "formations": [{"name": "f", "shape": "explicit", "members": ids, "displacements": places}],
            **fields,
        }
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("places", "pairs", "measures", "rank", "needed", "rate"),
    [
        (TRIANGLE, complete(3), "range", 3, 3, 1.5),
        (TRIANGLE, complete(3), "bearing", 3, 3, 1.5),
        (SQUARE, [*RING, (0, 2)], "range", 5, 5, 0.585786),
        (SQUARE, [*RING, (0, 2)], "bearing", 5, 5, 0.482362),
        (SQUARE, complete(4), "range", 5, 5, 2.0),
        (SQUARE, complete(4), "bearing", 5, 5, 1.414214),
        (TETRAHEDRON, complete(4), "range", 6, 6, 1.0),
        (TETRAHEDRON, complete(4), "bearing", 8, 8, 2.0),
        (SQUARE, RING, "range", 4, 5, None),
        (SQUARE, RING, "bearing", 4, 5, None),
        (CUBE, [*SIDES, (0, 7)], "range", 13, 18, None),
        (CUBE, [*SIDES, (0, 7)], "bearing", 20, 20, 0.206490),
        (TRIANGLE, [(0, 1), (1, 2)], "position", 4, 4, 1.0),
        (TRIANGLE, [(0, 1)], "position", 2, 4, None),
    ],
)
def test_checkpoints_of_formations(
    places: Any, pairs: Any, measures: str, rank: int, needed: int, rate: float | None
) -> None:
    """Ranks exactly, rates to 1e-6; a team that is not rigid is not ok."""
    record = check(keeping(places, pairs, measures), trial=False)
    rigidity = record["rigidity"]
    assert (rigidity["rank"], rigidity["needed"], rigidity["rigid"]) == (rank, needed, rank == needed)
    assert rigidity["localizable"] is None
    assert record["ok"] is (rank == needed)
    assert record["law"]["stable"]
    assert record["theorem"]["holds"] is None
    assert record["theorem"]["applies"] is False
    assert record["theorem"]["reason"]
    if rate is not None:
        assert rigidity["rate"] == pytest.approx(rate, abs=1e-6)
        assert record["law"]["rate"] == pytest.approx(-np.log(1.0 - 0.01 * rate) / 0.01, abs=1e-5)


@pytest.mark.parametrize(
    ("places", "start", "measures"),
    [
        (TRIANGLE, [[0, 0], [2.5, 0.4], [0.3, 3.0]], "bearing"),
        pytest.param(
            TETRAHEDRON,
            [[0, 0.5, 0], [2, 0, 0.7], [0.3, 2.2, -0.4], [1, 0, 1.5]],
            "bearing",
            marks=pytest.mark.slow,
        ),
        pytest.param(TRIANGLE, [[0, 0], [2.5, 0.4], [0.3, 3.0]], "range", marks=pytest.mark.slow),
    ],
)
def test_the_rate_of_a_team_far_from_its_shape_is_that_with_which_its_run_ends(
    places: Any, start: Any, measures: str
) -> None:
    """q* has the size that the bearing law keeps, and so the rate of the shape that the team reaches, to 1 %."""
    agents = [{"id": f"A{k}", "position": x} for k, x in enumerate(start)]
    law = {"gain": 1.0, "control_period": 0.02}
    scenario = keeping(places, complete(len(places)), measures, agents=agents, controller=law, time={"end": 40.0})
    run = simulate(scenario, backend="ideal")
    eta = run.disagreement.values.max(axis=1)
    first = int(np.argmax(eta < 1e-5 * eta[0]))
    last = int(np.argmax(eta < 1e-7 * eta[0]))
    assert 0 < first < last
    measured = np.log(eta[first] / eta[last]) / (0.02 * (last - first))
    assert check(scenario, trial=False)["law"]["rate"] == pytest.approx(measured, rel=0.01)
    q, x = (v.values[..., : len(places[0])] for v in (run.harmonic_extension, run.agent_position))
    assert np.abs(q[0].mean(axis=0) - x[0].mean(axis=0)).max() < 1e-6
    if measures == "bearing":
        size = [np.linalg.norm(y - y.mean(axis=0)) for y in (q[0], x[0], x[-1])]
        assert size[0] == pytest.approx(size[1], rel=2e-4)
        assert size[0] == pytest.approx(size[2], rel=0.01)


@pytest.mark.slow
def test_one_bearing_leaves_the_distance_as_it_is() -> None:
    """A target at rest fixes the direction to an agent far from it, and not the distance, which the law keeps."""
    scenario = make_scenario(
        {
            "time": {"end": 10.0},
            "controller": {"gain": 1.0, "control_period": 0.01},
            "agents": [{"id": "A", "position": [1.2, 0.9]}],
            "targets": [{"id": "T", "position": [0, 0]}],
            "sensing": [{"between": ["A", "T"], "measures": "bearing", "offset": [0, -1]}],
        }
    )
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
    targets = [[r, 0.0], [r * np.cos(theta), r * np.sin(theta)]]
    sensing = [
        {
            "between": ["A", f"T{k}"],
            "measures": measures,
            "offset": [r] if measures == "range" else (np.array(x) / r).tolist(),
        }
        for k, x in enumerate(targets)
    ]
    record = check(
        make_scenario(
            {
                "controller": {"gain": 1.0, "control_period": 0.01},
                "agents": [{"id": "A", "position": [0, 0]}],
                "targets": [{"id": f"T{k}", "position": x} for k, x in enumerate(targets)],
                "sensing": sensing,
            }
        ),
        trial=False,
    )
    wanted = (1.0 - abs(np.cos(theta))) / (r if measures == "bearing" else 1.0)
    rigidity = record["rigidity"]
    assert rigidity["localizable"] is (angle != 180.0)
    assert record["ok"] is (angle != 180.0)
    if angle != 180.0:
        assert rigidity["rate"] == pytest.approx(wanted, abs=1e-6)
    else:
        assert (
            record["relative_cohomology"]["basis"][0]["description"]
            == f"A is free along {'y' if measures == 'range' else 'x'}"
        )


@pytest.mark.parametrize(("n", "margin"), [(3, 0.604600), (4, 0.555360)])
def test_directed_cycles(n: int, margin: float) -> None:
    """The rate is 1 - cos(2 pi / n), and the continuous delay margin that of the literature; held ones come near."""
    angles = 2.0 * np.pi * np.arange(n) / n
    places = np.column_stack([np.cos(angles), np.sin(angles)]).tolist()
    cycle = [(k, (k + 1) % n) for k in range(n)]
    law = {"gain": 1.0, "control_period": 0}
    continuous = check(keeping(places, cycle, directed=True, controller=law), trial=False)
    assert continuous["ok"]
    assert continuous["rigidity"]["rate"] == pytest.approx(1.0 - np.cos(2.0 * np.pi / n), abs=1e-9)
    assert continuous["links"]["delay_margin"] == pytest.approx(margin, abs=1e-6)
    held = check(keeping(places, cycle, directed=True), trial=False)
    assert held["ok"]
    assert "not symmetric" in held["theorem"]["reason"]
    assert held["theorem"]["holds"] is None
    values = 1.0 - np.exp(2j * np.pi * np.arange(1, n) / n)
    assert held["law"]["spectral_radius"] == pytest.approx(np.abs(1.0 - 0.01 * values).max(), abs=1e-9)
    assert held["law"]["largest_gain"] == pytest.approx((2.0 * values.real / np.abs(values) ** 2).min() / 0.01)
    assert held["links"]["delay_margin"] == pytest.approx(margin, abs=0.02)


@pytest.mark.parametrize("n", [3, 4, 5])
def test_delays_of_a_directed_cycle_near_its_margin(n: int) -> None:
    """Runs converge 3 % below the margin of `check`, and diverge 3 % above it."""
    angles = 2.0 * np.pi * np.arange(n) / n
    places = np.column_stack([np.cos(angles), np.sin(angles)])
    cycle = [(k, (k + 1) % n) for k in range(n)]
    period = 0.005
    continuous = {"gain": 1.0, "control_period": 0}
    record = check(keeping(places.tolist(), cycle, directed=True, controller=continuous), trial=False)
    margin = record["links"]["delay_margin"]
    value = 1.0 - np.exp(2j * np.pi / n)
    assert margin == pytest.approx((np.pi / 2.0 - abs(np.angle(value))) / abs(value), rel=1e-9)
    start = places + np.random.default_rng(n).normal(scale=0.1, size=places.shape)
    agents = [{"id": f"A{k}", "position": x} for k, x in enumerate(start.tolist())]
    for periods, converges in ((np.floor(0.97 * margin / period), True), (np.ceil(1.03 * margin / period), False)):
        delayed = keeping(
            places.tolist(),
            cycle,
            directed=True,
            agents=agents,
            controller={"gain": 1.0, "control_period": period},
            links={"communication": {"delay": float(periods * period)}},
            time={"end": 60.0},
        )
        eta = np.linalg.norm(run_ideal(delayed.system).log.residual[:, :n], axis=(1, 2))
        middle, end = eta[4000:8000].max(), eta[8000:].max()
        assert end < 0.8 * middle if converges else end > 1.2 * middle


@pytest.mark.parametrize(("agents", "needed"), [(1, 0), (2, 1), (3, 3)])
def test_a_few_agents_in_the_plane_need_no_more_ranks_than_they_have_shapes(agents: int, needed: int) -> None:
    """An agent alone has no turn of its own."""
    ids = [f"A{k}" for k in range(agents)]
    team = {
        "agents": [{"id": one, "position": [k, 0.5 * k * k]} for k, one in enumerate(ids)],
        "targets": [{"id": "T", "position": [5, 0]}],
        "communication": [
            {"between": [a, b], "measures": "range", "offset": [1.0]} for a, b in itertools.pairwise(ids)
        ],
        "sensing": [{"between": ["A0", "T"], "measures": "range", "offset": [2.0]}],
    }
    assert check(make_scenario(team), trial=False)["rigidity"]["needed"] == needed


def following(directed: bool = True, **fields: Any) -> Scenario:
    """A leader that senses a target, and two that follow one after the other; fields replace fields."""
    return make_scenario(
        {
            "controller": {"gain": 1.0, "control_period": 0.01},
            "agents": [{"id": id, "position": [x, 0]} for id, x in (("A", 0), ("B", 1), ("C", 2))],
            "targets": [{"id": "T", "position": [0, 1]}],
            "communication": [
                {"between": ["B", "A"], "directed": directed, "weight": 2.0},
                {"between": ["C", "B"], "directed": directed},
                {"between": ["C", "A"], "directed": directed, "weight": 3.0},
            ],
            "sensing": [{"between": ["A", "T"], "weight": 5.0}],
            **fields,
        }
    )


def test_unlike_delays_of_a_directed_team_are_undecided() -> None:
    """The limit of equal delays is sufficient only where H is symmetric."""
    links = check(following(links={"communication": {"delay": 0.01}}), trial=False)["links"]
    assert links["delay_margin"] > 0.01
    assert links["stable"] is None
    assert "alike" in links["delay"]["reason"]


def test_a_directed_acyclic_team_has_its_out_degrees_as_eigenvalues() -> None:
    """A measures 5, B 2, C 4; where the leader looks at those behind, nothing holds them."""
    from mjsheaf.checking.spectrum import eigenvalues_of

    values = eigenvalues_of(following().team)
    assert np.allclose(np.sort(values.real), [2, 2, 4, 4, 5, 5])
    assert np.abs(values.imag).max() < 1e-12
    record = check(following(), trial=False)
    assert record["ok"]
    assert record["rigidity"]["rate"] == pytest.approx(2.0)
    assert record["rigidity"]["localizable"] is True
    looking_back = [{"between": ["A", "B"], "directed": True}, {"between": ["A", "C"], "directed": True}]
    lost = check(following(communication=looking_back), trial=False)
    assert not lost["ok"]
    assert lost["law"]["stable"] is False
    assert lost["rigidity"]["localizable"] is False


def test_the_steady_error_of_a_directed_team_is_that_of_its_run() -> None:
    """H is that of tails alone; what is known of a symmetric H alone is not said."""
    motion = {"kind": "lissajous", "amplitude": [3, 2], "rate": [0.3, 0.5], "phase": [0, 1]}
    law = {"gain": 1.0, "control_period": 0.02}
    targets = [{"id": "T", "position": [0, 1], "motion": motion}]
    scenario = following(targets=targets, controller=law, time={"end": 20.0})
    record = check(scenario, trial=False)
    error = simulate(scenario, backend="ideal").tracking_error.values
    assert record["steady"]["ideal"] == pytest.approx(np.sqrt((error[500:] ** 2).mean()), rel=1e-3)
    assert record["margins"]["hold"] is None
    with_integral = following(targets=targets, controller={**law, "integral": {"gain": 0.2}}, time={"end": 20.0})
    integral = check(with_integral, trial=False)
    assert integral["steady"]["reason"] == "H is not symmetric, and the law has terms"


def test_directed_teams_with_many_rows_are_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mjsheaf.checking.spectrum.DENSE_STATES", 5)
    record = check(following(), trial=False)
    why = "H has 6 rows; all its eigenvalues are found up to 5"
    assert (record["margins"]["bodies"]["stable"], record["margins"]["bodies"]["reason"]) == (None, why)
    assert (record["steady"]["ideal"], record["steady"]["reason"]) == (None, why)


@pytest.mark.slow
@pytest.mark.parametrize("terms", [{"integral": {"gain": 0.2}}, {"drift": {"filter": 0.1}}])
def test_terms_of_directed_teams_are_read_off_the_law(terms: Any) -> None:
    """With real eigenvalues the loop is that of an undirected team with the same ones."""
    found = check(following(controller={"gain": 1.0, "control_period": 0.01, **terms}), trial=False)
    assert found["law"]["stable"]
    same = make_scenario(
        {
            "controller": {"gain": 1.0, "control_period": 0.01, **terms},
            "agents": [{"id": id, "position": [x, 0]} for id, x in (("A", 0), ("B", 1), ("C", 2))],
            "targets": [{"id": "T", "position": [0, 1]}],
            "communication": [{"between": ["A", "B"], "weight": 1e-9}, {"between": ["B", "C"], "weight": 1e-9}],
            "sensing": [{"between": [id, "T"], "weight": w} for id, w in (("A", 5.0), ("B", 2.0), ("C", 4.0))],
        }
    )
    law = check(same, trial=False)["law"]
    assert found["law"]["spectral_radius"] == pytest.approx(law["spectral_radius"], abs=1e-7)


def test_records_are_json_and_have_verdicts() -> None:
    """Every record of such a team can be written, and its report too."""
    from rich.console import Console

    from mjsheaf.checking import examine_scenario
    from mjsheaf.checking.record import headline
    from mjsheaf.checking.report import report

    for scenario in (keeping(TRIANGLE, complete(3), "range"), following(), keeping(SQUARE, RING, "bearing")):
        record = examine_scenario(scenario).record
        json.dumps(record.model_dump(mode="json"), allow_nan=False)
        with Console(width=160).capture() as _:
            Console(width=160).print(report(record))
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
    bracing = check(keeping(places, pairs, measures), trial=False)["rigidity"]["bracing"]
    assert len(bracing["edges"]) == count
    assert bracing["exact"]
    assert all(edge["measures"] == measures for edge in bracing["edges"])
    added = [tuple(int(id[1:]) for id in edge["between"]) for edge in bracing["edges"]]
    braced = check(keeping(places, [*pairs, *added], measures), trial=False)
    assert braced["ok"]
    assert braced["rigidity"]["bracing"] is None
    assert braced["rigidity"]["rate"] == pytest.approx(bracing["rate"], rel=1e-9)


def test_a_flex_is_described_with_a_frame_at_rest() -> None:
    """The ring of four folds along two parallel sides."""
    bracing = check(keeping(SQUARE, RING, "range"), trial=False)["rigidity"]["bracing"]
    assert bracing["flexes"] == ["A2, A3 are free along x together, relative to A0"]


def test_nothing_braces_ranges_on_a_line() -> None:
    """Ranges measure nothing across a line, to first order."""
    bracing = check(keeping([[0, 0], [1, 0], [2, 0]], complete(3), "range"), trial=False)["rigidity"]["bracing"]
    assert bracing["edges"] == []
    assert not bracing["exact"]
    assert len(bracing["flexes"]) == 1


@pytest.mark.parametrize("measures", ["position", "range", "bearing"])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_noise_of_links_of_a_free_team_is_that_of_its_shape(measures: str, loss: float) -> None:
    """The answers leave out motions that no edge measures: the RMS is that of a random walk of the law in H's range."""
    links = {"noise": 0.5, "loss": loss, "delay": 0.0}
    record = check(keeping(TRIANGLE, complete(3), measures, links={"all": links}), trial=False)
    system = keeping(TRIANGLE, complete(3), measures).system.local
    H = system.team.dirichlet.H.toarray()
    sigma = np.deg2rad(0.5) if measures == "bearing" else 0.5
    assert record["links"]["stable"]
    assert record["links"]["mean_square_rate"] < 1.0
    if loss == 0.0:
        h = 0.01
        values = np.linalg.eigvalsh(H)
        values = values[values > 1e-9]
        # Edges of weight K and noise s^2 / K add the covariance s^2 H h^2 to e in a period.
        expected = np.sqrt(np.sum(sigma**2 * values * h**2 / (1.0 - (1.0 - h * values) ** 2)))
        assert record["links"]["noise_rms"] == pytest.approx(expected, rel=1e-9)
    else:
        assert record["links"]["loss"]["stable"]
        assert record["links"]["noise_rms"] > 0.0


@pytest.mark.parametrize("terms", [{}, {"integral": {"gain": 0.05}}])
def test_losses_of_a_free_team_are_those_of_its_shape(terms: Any) -> None:
    """A loss that never happens leaves the square of the spectral radius, with and without terms."""
    control = {"gain": 1.0, "control_period": 0.01, **terms}
    rare = keeping(TRIANGLE, complete(3), "range", controller=control, links={"all": {"loss": 1e-12}})
    exact = check(keeping(TRIANGLE, complete(3), "range", controller=control), trial=False)
    found = check(rare, trial=False)["links"]
    assert found["stable"]
    assert found["mean_square_rate"] == pytest.approx(exact["law"]["spectral_radius"] ** 2, rel=1e-9)


def test_newton_of_a_team_without_targets_solves_in_the_range_of_h() -> None:
    """One round is exact where all eigenvalues of H but the zeros are equal: e falls by 1 - k1 h a period."""
    control = {"gain": 1.0, "control_period": 0.1, "newton": {"rounds": 1}}
    scenario = keeping(TRIANGLE, complete(3), "position", controller=control, time={"end": 2.0})
    assert check(scenario, trial=False)["law"]["spectral_radius"] == pytest.approx(0.9, abs=1e-9)
    agents = [{"id": f"A{k}", "position": x} for k, x in enumerate([[0, 0], [3, 1], [1, 4]])]
    moved = keeping(TRIANGLE, complete(3), "position", controller=control, time={"end": 2.0}, agents=agents)
    result = simulate(moved, backend="ideal")
    eta = result.disagreement.values
    assert eta[-1] == pytest.approx(eta[0] * 0.9 ** (len(eta) - 1), rel=1e-9)
    centroid = result.agent_position.values[..., :2].mean(axis=1)
    assert centroid == pytest.approx(np.broadcast_to(centroid[0], centroid.shape), abs=1e-12)
