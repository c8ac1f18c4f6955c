"""The scenarios that ship, their schema, overrides, and what loading them means.

That each runs as its `expect:` block says, with bounds at most a tenth above what is found, is tested with the
commands. Oracle here: the published run, and what the README says.
"""

import pickle
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import xarray as xr

import mjsheaf
from mjsheaf.errors import NotUniqueError, ScenarioError
from mjsheaf.files import parse_yaml, read_yaml
from mjsheaf.scenario import Scenario, list_scenarios, load_scenario
from mjsheaf.scenario.load import parse_override
from mjsheaf.team.edges import ExplicitMaps
from tests.builders import Simulated, dump_scenario, shipped, validator_of

BACKENDS = ("ideal", "physics")
RUNNABLE = [name for name, scenario in shipped().items() if scenario.expect.refused is None]


@pytest.mark.parametrize("name", RUNNABLE)
def test_every_measure_that_a_team_has_is_bounded(name: str) -> None:
    """The files themselves test that bounds are met and tight, through our pytest plugin."""
    scenario = load_scenario(name)
    measures = {"mean_disagreement", "tracking_error"}
    measures |= {"formation_error"} if scenario.formations else set()
    measures |= {"centering_error"} if any(group.about for group in scenario.formations) else set()
    whole = {"smallest_separation"} if scenario.safety else set()
    for backend in BACKENDS:
        bounds = getattr(scenario.expect, backend)
        assert bounds is not None
        own = bounds.phases or []
        assert len(own) == len(scenario.phases) - 1  # the last one's are those of the run
        for part in (bounds, *own):
            own_measures = measures | (whole if part is bounds else set())
            assert part.model_dump(exclude_none=True, exclude={"phases"}).keys() == own_measures


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_free_team_is_refused_or_drifts_and_says_so(backend: str) -> None:
    scenario = load_scenario("air_tracks_surface")
    with pytest.raises(NotUniqueError, match="dimension 1: A1, A2, A3 are free along z together"):
        mjsheaf.simulate(scenario, backend)
    result = mjsheaf.simulate(scenario, backend, allow_drift=True)
    assert result.attrs["free_directions"] == "A1, A2, A3 are free along z together"
    # The law does not touch what is free: the mean height stays where it began.
    height = result["agent_position"].sel(axis="z").mean("agent").values
    np.testing.assert_allclose(height, height[0], atol=1e-6)
    assert float(result["tracking_error"][-1].max()) < 25.0


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("local_frames", {"controller.gain": 2.5, "summary": "1e3"}),  # text that looks like a number
        ("swarm", {"swarm.size": 6, "swarm.graph": "small_world"}),  # whose agents are written out
    ],
)
def test_resolved_scenario_runs_to_the_same_bits(
    name: str, changes: dict[str, object], backend: str, tmp_path: Path
) -> None:
    scenario = load_scenario(name, {**changes, "time.end": 0.5, "seed": 11})
    path = tmp_path / "scenario.yaml"
    path.write_text(dump_scenario(scenario))
    again = load_scenario(path)
    assert again == scenario
    assert again.swarm is None
    xr.testing.assert_identical(mjsheaf.simulate(scenario, backend), mjsheaf.simulate(again, backend))


def test_seed_draws_places_headings_and_disturbances() -> None:
    changes = {"spread.position": 3.0, "spread.heading": 90.0, "disturbance.agents": {"bound": 0.2}}
    a, b, c = (load_scenario("midpoint", {**changes, "seed": seed}).system for seed in (1, 2, 1))
    assert np.abs(a.initial - b.initial)[:1, :2].min() > 0
    assert np.array_equal(a.initial[1:], b.initial[1:])  # targets are not spread
    assert np.abs(a.bodies.heading - b.bodies.heading).min() > 0
    assert not np.array_equal(a.harmonics, b.harmonics)
    assert np.array_equal(a.initial, c.initial)
    assert np.array_equal(a.harmonics, c.harmonics)
    plain = load_scenario("midpoint").system
    assert np.abs(a.initial - plain.initial).max() <= 3.0


def test_a_copy_with_changes_is_built_anew_and_an_equal_one_is_equal() -> None:
    scenario = load_scenario("midpoint", {"spread.position": 1.0})
    other = scenario.model_copy(update={"seed": 7})
    assert other.system is not scenario.system
    assert (other.system.initial != scenario.system.initial).any()
    assert other != scenario
    again = Scenario.model_validate(scenario.model_dump(mode="json"))
    assert again == scenario
    assert (again.system.initial == scenario.system.initial).all()
    assert pickle.loads(kept := pickle.dumps(scenario)) == scenario
    assert len(kept) < 20_000  # without its system


def test_a_seed_that_changes_nothing_is_known() -> None:
    assert [load_scenario("paper").uses_seed(b) for b in BACKENDS] == [False, False]
    assert [load_scenario("paper", {"spread.heading": 10}).uses_seed(b) for b in BACKENDS] == [False, True]
    assert [load_scenario("surface_tracks_air").uses_seed(b) for b in BACKENDS] == [True, True]


def test_overrides_reach_any_field() -> None:
    changes = {"controller.gain": 30.0, "agents.A3.heading": -5.0, "agents.0.position.1": 11.5, "video.fps": 24}
    changes |= {"formations.square_T4.side": 40.0, "flow.agents.vortices.1.gamma": 0.25}
    raw = load_scenario("paper", changes).model_dump()
    agents, vortex = raw["agents"], raw["flow"]["agents"]["vortices"][1]
    found = [raw["controller"]["gain"], agents[2]["heading"], agents[0]["position"][1], raw["video"]["fps"]]
    assert [*found, raw["formations"][3]["side"], vortex["gamma"]] == list(changes.values())


def test_overrides_reach_into_an_edge_that_is_a_bare_pair() -> None:
    changed = load_scenario("midpoint", {"sensing.0.weight": 2, "sensing.1.between.0": "A1"})
    assert [edge.weight for edge in changed.sensing] == [2, None]
    plain = load_scenario("midpoint")
    assert [edge.between for edge in changed.sensing] == [edge.between for edge in plain.sensing]
    pair = ["A1", "T2"]
    assert load_scenario("midpoint", {"sensing.0": pair, "sensing.0.weight": 3}).sensing[0].between == pair


def test_overrides_may_be_values_of_numpy_and_tuples() -> None:
    changes = {
        "controller.gain": np.float32(0.5),
        "seed": np.int64(3),
        "physics.contacts": np.True_,
        "agents.A1.position": np.array([1.0, 2.0]),
        "sensing": (("A1", "T1"), ("A1", "T2")),
        "sensing.0": {"between": ("A1", "T1"), "map": {"tail": np.eye(2), "head": np.eye(2)}},
        "targets.T1.position": np.array([np.int64(1), np.float64(2.5)], dtype=object),
    }
    scenario = load_scenario("midpoint", changes)
    assert (scenario.controller.gain, scenario.seed, scenario.physics.contacts) == (0.5, 3, True)
    assert scenario.agents[0].position == [1.0, 2.0]
    assert scenario.targets[0].position == [1, 2.5]
    assert scenario.sensing[0].map == ExplicitMaps(tail=[[1.0, 0.0], [0.0, 1.0]], head=[[1.0, 0.0], [0.0, 1.0]])


@pytest.mark.parametrize("name", list_scenarios())
def test_schema_accepts_what_ships(name: str, tmp_path: Path) -> None:
    validator = validator_of(Scenario)
    validator.validate(read_yaml(list_scenarios()[name]))
    resolved = tmp_path / "scenario.yaml"
    resolved.write_text(dump_scenario(load_scenario(name)))
    validator.validate(read_yaml(resolved))


def test_schema_asks_for_no_name_and_for_what_an_edge_needs() -> None:
    validator = validator_of(Scenario)
    least = {"agents": [{"id": "A", "position": [0, 0]}], "targets": [{"id": "T", "position": [3, 4]}]}
    validator.validate({**least, "sensing": [["A", "T"], {"between": ["A", "T"]}]})
    for wrong in (["A"], ["A", "T", "A"], {"weight": 2}, 3):
        with pytest.raises(jsonschema.ValidationError):
            validator.validate({**least, "sensing": [wrong]})


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("010", 10), ("-08", -8), ("0o10", 8), ("0x1F", 31), ("1:30", "1:30"), ("1_000", "1_000"), ("0b1", "0b1"),
        ("1e3", 1000.0), ("1.", 1.0), (".5", 0.5), ("-1.5e-3", -0.0015), ("1:30.5", "1:30.5"),
        ("yes", "yes"), ("No", "No"), ("on", "on"), ("OFF", "OFF"), ("true", True), ("FALSE", False), ("y", "y"),
        ("~", None), ("null", None), ("", None), ("2026-01-02", "2026-01-02"), ("<<", "<<"), ("=", "="),
    ],
)  # fmt: skip
def test_plain_values_are_those_of_yaml_1_2(text: str, value: object) -> None:
    read = parse_yaml(text, "text")
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize(
    ("file", "name"), [("2 odd.yaml", "scenario_2_odd"), ("été.yaml", "scenario__t_"), ("a.b c.yaml", "a_b_c")]
)
def test_name_is_derived_from_any_file(file: str, name: str, tmp_path: Path) -> None:
    text = list_scenarios()["midpoint"].read_text().replace("name: midpoint\n", "")
    (tmp_path / file).write_text(text)
    assert load_scenario(tmp_path / file).name == name
    assert load_scenario(parse_yaml(text, "text")).name == "scenario"


def test_a_run_cut_short_by_an_override_has_no_later_events() -> None:
    name = "harbour_lost_hexarotor"
    assert [len(load_scenario(name, {"time.end": end}).events) for end in (45, 46, 90)] == [2, 2, 3]
    assert len(load_scenario(name, {"time.end": 10}).phases) == 1
    for overrides in ({"time.end": 10, "events.0.time": 45}, {"events.1.time": 100}, {"time": {"end": 10}}):
        with pytest.raises(ScenarioError, match=r"events\.\d\.time: .* lies outside the run"):
            load_scenario(name, overrides)


def test_override_values_are_yaml() -> None:
    for text, value in (("1e-3", 1e-3), ("[1, 2]", [1, 2]), ("a=b", "a=b")):
        assert parse_override(f"controller.gain={text}") == ("controller.gain", value)


def test_time_end_keeps_whole_periods() -> None:
    for end, samples in ((49.99, 4999), (5, 500), (2.0049, 200), (0.02, 2)):
        assert len(load_scenario("paper", {"time.end": end}).system.grid.samples) == samples
    times = load_scenario("paper").system.grid.samples
    np.testing.assert_allclose(times, 0.01 * np.arange(1, 5000), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("backend", BACKENDS)
def test_dataset_holds_what_the_contract_names(backend: str, simulated: Simulated) -> None:
    ds = simulated("local_frames", backend)
    assert ds["agent_position"].dims == ("time", "agent", "axis")
    assert ds["target_position"].dims == ("time", "target", "axis")
    assert ds["disagreement"].dims == ds["tracking_error"].dims == ("time", "agent")
    assert list(ds["axis"].values) == ["x", "y", "z"]
    planar = ds["agent_position"].sel(axis="z").isnull().all("time").values
    assert planar.tolist() == [True] * 3 + [False] * 3
    assert len(ds["time"]) == 2001
    for name, variable in ds.data_vars.items():
        assert {"units", "long_name"} <= set(variable.attrs), name
    if backend == "physics":
        assert {"agent_orientation", "target_command", "agent_saturation"} <= set(ds.data_vars)
        norm = np.linalg.norm(ds["agent_orientation"].values, axis=2)
        np.testing.assert_allclose(norm, 1.0, atol=1e-9)
