"""Notes of runs: each kind on a run that has it, and a healthy run that has none of them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjsheaf import World, load_scenario, simulate
from mjsheaf.checking.theorem.of_run import bound_of_run, held_bound_of_run
from mjsheaf.mujoco_import import mujoco
from mjsheaf.results import store
from mjsheaf.results.ending import ending_of_motion
from mjsheaf.runs.diagnostics import _about_the_surface, notes_of_run
from mjsheaf.scenario import Scenario
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from tests.builders import QUADROTOR_PAIR, known, make_fields
from tests.commands import answer_of

CALM = make_fields(
    {id: {"position": [x, 0, 5], "vehicle": "hexarotor"} for id, x in (("Q1", 0), ("Q2", 6))},
    {"T1": [3, 4, 6]},
    [{"between": [id, "T1"], "offset": [x, -4, -1]} for id, x in (("Q1", -3), ("Q2", 3))],
    time={"end": 8},
    controller={"gain": 1, "control_period": 0.02, "velocity_limit": 3},
    physics={"timestep": 0.005},
    scene={"surface": "ground"},
)
"""Two hexarotors that stand where they should, far from each other."""


def found_in(scenario: Scenario, backend: str = "physics") -> dict[str, Any]:
    """The notes of a run by kind."""
    phases, result = scenario.phases, simulate(scenario, backend=backend)
    theorem, ending = bound_of_run(phases, result), ending_of_motion(phases, result)
    notes = notes_of_run(phases, result, ending, [theorem, held_bound_of_run(phases, result, theorem)], None)
    assert len({note.kind for note in notes}) == len(notes)
    return {note.kind: note for note in notes}


def noted(changes: dict[str, Any], backend: str = "physics") -> dict[str, Any]:
    """The notes of a run of the calm team, changed."""
    return found_in(load_scenario(CALM, changes), backend)


@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_a_healthy_run_has_no_notes(backend: str) -> None:
    assert noted({}, backend) == {}


def test_a_medium_faster_than_the_vehicles_and_what_it_does_to_them() -> None:
    found = noted({"flow.agents.drift": [20, 0, 0], "flow.agents.dimension": 3})
    assert found["medium"].number == pytest.approx(20.0)
    assert "velocity limit" in found["medium"].text
    assert found["diverging"].agent is None
    assert found["diverging"].number > 20.0
    assert found["limited"].number > 0.8
    assert not {"medium", "diverging"} & set(noted({"flow.agents.drift": [1, 0, 0], "flow.agents.dimension": 3}))


def test_a_limit_is_that_of_the_moment() -> None:
    """Of an agent that joins later it is zero before; an event changes it."""
    windy = {"flow.agents.drift": [1, 0, 0], "flow.agents.dimension": 3, "controller.velocity_limit": 4}
    assert "medium" not in noted(windy | {"events": [{"time": 1, "join": "Q2"}]}, "ideal")
    slower = {"events": [{"time": 4, "set": {"controller.velocity_limit": 0.5}}]}
    found = noted(windy | slower, "ideal")["medium"]
    assert "its velocity limit allows 0.5 m/s" in found.text
    assert (found.number, found.time) == (1.0, 4.0)
    raised = {"controller.velocity_limit": 0.5, "events": [{"time": 0.02, "set": {"controller.velocity_limit": 4}}]}
    assert "medium" not in noted(windy | raised, "ideal")


def test_what_the_vehicle_itself_cannot_do() -> None:
    free = {"controller.velocity_limit": 100, "flow.agents.drift": [40, 0, 0], "flow.agents.dimension": 3}
    found = noted(free)
    assert "its vehicle reaches" in found["medium"].text
    assert found["saturated"].number > 0.5
    assert found["saturated"].agent in ("Q1", "Q2")


def test_vehicles_closer_than_their_size() -> None:
    size = load_vehicle("hexarotor").size
    near = {"sensing.0.offset": [0, -4, -1], "sensing.1.offset": [-0.95 * size, -4, -1]}
    places = {"agents.Q1.position": [3, 0, 5], "agents.Q2.position": [3 - 0.95 * size, 0, 5]}
    found = noted({**near, **places})["close"]
    assert "closer to each other than their size" in found.text
    assert found.number == pytest.approx(0.95 * size, rel=0.02)
    assert "close" not in noted({**near, **places, "physics.contacts": True})
    assert "close" not in noted({**near, **places}, "ideal")
    far = {"sensing.1.offset": [-1.2 * size, -4, -1], "agents.Q2.position": [3 - 1.2 * size, 0, 5]}
    assert "close" not in noted({**near, **places, **far})


@pytest.mark.parametrize(
    ("surface", "words"), [("water", "under water"), pytest.param("ground", "in the ground", marks=pytest.mark.slow)]
)
def test_an_aircraft_below_the_surface(surface: str, words: str) -> None:
    deep = {"scene.surface": surface, "agents.Q2.position": [6, 0, -2]}
    for backend in ("ideal", "physics"):
        found = noted(deep, backend)["submerged"]
        assert words in found.text
        assert (found.agent, found.time) == ("Q2", 0.0)
        assert found.number == pytest.approx(2.0, abs=0.05)
    assert "submerged" not in noted({**deep, "scene.surface": "none"})
    assert "submerged" not in noted({**deep, "scene.height": -3})


@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_places_after_a_blow_up_are_not_below_the_surface(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = load_scenario(CALM, {"agents.Q2.position": [6, 0, -2], "time.end": 0.4})
    result = simulate(deep, backend)
    name = "agent_height" if backend == "physics" else "agent_position"
    result[name][10:, 0] = np.nan
    result[name][15:] = np.nan
    monkeypatch.setattr(store, "length_of_piece", lambda _: 7)
    (note,) = _about_the_surface(deep.phases, result)
    assert (note.agent, note.time) == ("Q2", 0.0)
    assert note.number == pytest.approx(2.0, abs=0.05)
    assert "Q2 goes in the ground" in note.text
    assert "nan" not in note.text


def test_a_target_may_start_below_the_surface_and_not_go_there() -> None:
    """The paper's targets are submerged from the start."""
    below = {"scene.surface": "water", "targets.T1.position": [3, 4, -6], "controller.velocity_limit": 0.01}
    assert "submerged" not in noted(below, "ideal")
    dives = {"targets.T1.motion": {"kind": "waypoints", "points": [[3, 4, -6]], "speed": 4}}
    found = noted({"scene.surface": "water", "controller.velocity_limit": 0.01, **dives}, "ideal")["submerged"]
    assert found.agent == "T1"
    assert "target" in found.text


def test_an_agent_that_is_lost_is_not_said_to_be_at_its_limits() -> None:
    found = noted({"events": [{"time": 1, "lose": "Q2"}]})
    assert not {"limited", "saturated"} & set(found)
    assert "submerged" not in found  # it rests on the surface


@pytest.mark.parametrize(("gain", "circles"), [(1.5, False), (2.0, True)])
def test_a_team_that_circles(gain: float, circles: bool) -> None:
    changes = {"controller": {"gain": gain, "control_period": 0.02}, "physics": {"timestep": 0.005}}
    assert ("changing" in found_in(load_scenario({**QUADROTOR_PAIR, **changes}))) is circles


@pytest.mark.parametrize("name", list_vehicles())
def test_the_size_of_a_vehicle_is_that_of_its_vertices(name: str) -> None:
    vehicle = load_vehicle(name)
    model = mujoco.MjModel.from_xml_path(str(vehicle.path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    corners = []
    for g in range(model.ngeom):
        if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE:
            continue
        mesh = model.geom_dataid[g]
        if mesh >= 0:
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            own = model.mesh_vert[first : first + count]
        else:
            signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
            own = model.geom_aabb[g, :3] + signs * model.geom_aabb[g, 3:]
        corners.append(data.geom_xpos[g] + own @ data.geom_xmat[g].reshape(3, 3).T)
    points = np.concatenate(corners)
    longest = np.ptp(points, axis=0).max()
    assert longest - 1e-9 <= vehicle.size <= 1.5 * longest


def test_the_paper_s_bodies_go_through_each_other_and_a_world_says_nothing() -> None:
    scenario = load_scenario("paper", {"time.end": 1.0})
    close, world = found_in(scenario)["close"], World(scenario)
    world.step(round((known(close.time) - world.time) / world.model.opt.timestep))
    placed = world.data.qpos[world.arena.qpos[:, None] + np.arange(3)]
    apart = np.linalg.norm(placed - placed[scenario.system.team.index[known(close.agent)]], axis=1)
    assert np.sort(apart)[1] == pytest.approx(close.number, abs=1e-9)


@pytest.mark.usefixtures("without_plots")
def test_run_prints_what_the_summary_has_by_importance(tmp_path: Path) -> None:
    """A limit matters more than a team that still approaches, and that more than an aircraft below the surface."""
    path, out = tmp_path / "calm.yaml", tmp_path / "out"
    path.write_text(json.dumps(CALM))
    changes = ["--set", "scene.height=5.5", "--set", "agents.Q1.position=[0, 60, 5]", "--no-video"]
    answer = answer_of("run", path, "--backend", "ideal", *changes, "--out", out)
    assert (answer.code, answer.err) == (0, "")
    notes = json.loads((out / "summary.json").read_text())["notes"]
    words = " ".join(answer.out.split())
    places = [words.index(f"note: {note['text']}") for note in notes]
    assert places == sorted(places)
    assert [(note["kind"], note["agent"]) for note in notes] == [
        ("limited", "Q1"),
        ("approaching", None),
        ("submerged", "Q1"),
    ]
    assert notes[0]["number"] == pytest.approx(1.0)
    assert notes[1]["time"] == 8.0  # the run ends before the team arrives
