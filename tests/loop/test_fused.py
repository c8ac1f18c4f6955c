"""The fused engine against MuJoCo: steps from random states, runs, and what it refuses.

Oracle: MuJoCo's own step of the same vehicles under the same commands.
"""

import re
from collections import Counter
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from mjsheaf import World, load_scenario, simulate, simulate_many
from mjsheaf.arrays import Array
from mjsheaf.comparing.compare import compare
from mjsheaf.compile.jit import on_stack, user_jit
from mjsheaf.compile.tiers import _as_records, in_python
from mjsheaf.errors import InputError, MjsheafError
from mjsheaf.loop import block
from mjsheaf.loop.block import advance_lanes
from mjsheaf.loop.engine import Log, new_log
from mjsheaf.loop.fused import Fused, advance
from mjsheaf.loop.loop import NEVER
from mjsheaf.loop.mujoco_engine import apply_forces
from mjsheaf.loop.system import on_engine
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.load import list_scenarios
from mjsheaf.vehicles.loading import load_vehicle
from tests.builders import DATA, POWERED, RAFT, adding, altered, build_scenario, find, mixed_scenario, refused
from tests.strategies import long

EPSILON = 1e-12
CHANNEL = {"centre": [5.0, 2.0, 1.0], "direction": [1.0, 0.5, 0.1], "beta": 0.7, "width": 4.0, "length": 12.0}
VORTEX = {"centre": [1, 2, 0], "axis": [0, 0, 1], "gamma": 4}
FLOW = {"dimension": 3, "core": 1.0, "drift": [0.6, -0.4, 0.2], "vortices": [VORTEX], "channels": [CHANNEL]}
OFF: list[dict[str, bool]] = [{}, *({effect: False} for effect in ("inertia", "limits", "lag", "underactuation"))]


def of_vehicles(names: list[str], timestep: float, components: int = 6, **fields: Any) -> Scenario:
    """A vehicle of each kind, in flow and disturbances."""
    agents: dict[str, Any] = {
        f"A{k}": {"position": [3.0 * k, 1.0, 2.0][: load_vehicle(name).dimension], "vehicle": name, "heading": 40 * k}
        for k, name in enumerate(names)
    }
    return build_scenario(
        agents,
        {"T": [0.0, 0.0, 5.0]},
        [[id, "T"] for id in agents],
        anchors=[{"agent": id, "axes": ["z"], "value": [1.0]} for id, a in agents.items() if len(a["position"]) == 3],
        flow={"agents": FLOW},
        disturbance={"agents": {"bound": 0.5, "frequencies": [0.1, 5.0], "components": components}},
        controller={"gain": 1.0, "control_period": 10 * timestep},
        physics={"timestep": timestep, **fields},
    )


def unlike(folder: Path) -> list[str]:
    """Vehicles with all features of MuJoCo's free bodies and actuators that the included ones lack."""

    # Offset centre of mass, and two bodies rotated relative to each other, one of them partly buoyant.
    inertial = '<inertial pos="0 .1 0" mass="1.5" diaginertia=".03 .02 .04"/>'
    ballast = adding(("worldbody/body", f'<body pos=".3 .1 -.2" euler=".5 0 1" gravcomp=".3">{inertial}</body>'))

    def eccentric(root: ElementTree.Element) -> None:
        find(root, ".//inertial").attrib.update(pos=".1 -.05 .2", euler=".3 .2 -.4")
        ballast(root)

    def odd_actuators(root: ElementTree.Element) -> None:
        for k, one in enumerate(root.findall("./actuator/general")):
            one.set("gainprm", "2")
            one.set("ctrlrange", "0.1 12")
            for name, value in (
                (("dyntype", "filter"), ("actearly", "true")),
                (("dyntype", "none"), ("forcerange", "1 9")),
                (("dyntype", "filterexact"), ("actlimited", "true"), ("actrange", "1 5"), ("actearly", "true")),
            )[k % 3]:
                one.set(name, value)

    return [
        altered(folder / "a", "submersible", eccentric, added_mass=[30, 400, 500, 20, 60, 40]),
        altered(folder / "b", "submersible", eccentric),
        altered(folder / "c", "hexarotor", odd_actuators),
        altered(folder / "d", "aerial", drag={"linear": [1.0, 2.0, 3.0], "angular": [0.3, 0.2, 0.1]}),
        str(RAFT),
    ]


def off_by(scenario: Scenario, count: int, seed: int) -> float:
    """The largest difference of a step of both engines from random states, over what its rounding allows."""
    rng = np.random.default_rng(seed)
    world, fused = World(scenario, visible=False), Fused(scenario.phases)
    (params, ours), (of_world, theirs), vehicles = fused._loop, world._loop, world.arena.vehicles
    V, h, worst = len(vehicles), of_world.timestep, 0.0
    low, high = np.nan_to_num(np.concatenate([vehicle.limits for vehicle in vehicles]), posinf=30, neginf=-30).T
    mass = np.array([vehicle.mass for vehicle in vehicles])
    least = np.array([np.linalg.eigvalsh(v.turning_inertia - np.diag(v.added_mass[3:]))[0] for v in vehicles])
    lever = np.array([np.linalg.norm(v.centre_of_mass) for v in vehicles])
    for k in range(count):
        step = 10 * k + 1  # at which the law is not evaluated
        q, w = ours.qpos.reshape(V, 7), ours.qvel.reshape(V, 6)
        q[:, :3], q[:, 3:] = rng.uniform(-9, 9, (V, 3)), Rotation.random(V, random_state=rng).as_quat()
        if k % 2:  # nearly level too, as vehicles mostly are
            q[:, 3:] = Rotation.from_rotvec(rng.normal(0, 0.1, (V, 3))).as_quat()[:, [3, 0, 1, 2]]
        w[:, :3], w[:, 3:] = rng.normal(0, 4, (V, 3)), rng.normal(0, 2, (V, 3))
        ours.act[:] = rng.uniform(low, high)[params.fleet.channels["late"] > 0]
        ours.memory.command[:] = rng.normal(0, 3, (V, 3)) * (rng.random() < 0.8)
        params.helm[:] = of_world.helm[:] = rng.random(V) < 0.1
        theirs.qpos[:], theirs.qvel[:], theirs.act[:] = ours.qpos, ours.qvel, ours.act
        theirs.memory.command[:] = ours.memory.command
        before = w.copy()
        apply_forces(world._loop, world._arrays, of_world.start + step * h)
        mujoco.mj_step(world.model, world.data)
        ours.steps[0] = step
        advance(*fused.compiled, 1, fused._unrecorded, fused._bad)
        assert (fused._bad == NEVER).all()
        np.testing.assert_array_equal(ours.ctrl, theirs.ctrl)
        pushes = np.abs(world.data.actuator_force[:, None] * world.model.actuator_gear)
        pushed = np.add.reduceat(pushes, world.arena.thruster[:-1]) + np.abs(world.data.qfrc_applied.reshape(V, 6))
        damping = np.abs(world.model.dof_damping.reshape(V, 6) * before)
        passive = (
            np.abs(world.data.qfrc_bias.reshape(V, 6)) + 2.0 * damping + np.abs(world.data.qfrc_passive.reshape(V, 6))
        )
        force, moment = (pushed + passive)[:, :3].sum(axis=1), (pushed + passive)[:, 3:].sum(axis=1)
        scale = np.zeros((V, 2))  # of velocity and rates
        scale[:, 1] = np.maximum(np.abs(before[:, 3:]).max(axis=1), h * (moment + lever * force) / least)
        scale[:, 0] = np.maximum(np.abs(before[:, :3]).max(axis=1), h * force / mass + lever * scale[:, 1])
        faster = np.abs(ours.qvel - theirs.qvel).reshape(V, 2, 3).max(axis=2) / scale
        moved = np.abs(ours.qpos - theirs.qpos).reshape(V, 7)
        place = moved[:, :3].max(axis=1) / np.maximum(np.abs(q[:, :3]).max(axis=1), h * scale[:, 0])
        turned = moved[:, 3:].max(axis=1) / np.maximum(1.0, h * scale[:, 1])
        late = np.abs(ours.act - theirs.act) / np.maximum(1.0, np.abs(theirs.act))
        worst = np.max([worst, faster.max(), place.max(), turned.max(), *late])  # of NaN it is NaN
    return float(worst)


# -- one step ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("off", "timestep", "count"),
    [
        pytest.param({}, 0.002, 30, marks=pytest.mark.slow(first=True)),
        *(long(off, timestep, 300) for off in OFF for timestep in (0.0005, 0.01)),
    ],
)
def test_a_step_of_every_vehicle_is_that_of_mujoco(
    off: dict[str, bool], timestep: float, count: int, tmp_path: Path
) -> None:
    """Alone and in lanes, with and without what can be switched off; also in steps where the joint takes the drag."""
    names = [*of_lanes(tmp_path / "lanes"), *POWERED, *unlike(tmp_path)]
    assert off_by(of_vehicles(names, timestep, effects=off), count, 1) < EPSILON


def of_lanes(folder: Path) -> list[str]:
    """Vehicles of which lanes take several at a time, and others between them."""
    odd, skiff = unlike(folder)[2], str(DATA / "skiff.yaml")
    first = [*["hexarotor"] * 8, "otter", *["quadrotor"] * 5, *["x500"] * 4, "wamv", *[odd] * 4, *["hexarotor"] * 2]
    return [*first, *["hull"] * 5, *["wamv"] * 4, *["otter"] * 3, *["submersible"] * 4, *[skiff] * 4]


@pytest.mark.parametrize("components", [6, 12])
def test_a_vehicle_in_lanes_moves_as_it_does_alone(components: int, tmp_path: Path) -> None:
    """Neighbours change no bit, even at rest, at limits, in turns beyond any series, and if one is bad.

    One vehicle at a time is not moved in lanes; nor are disturbances of so many components.
    """
    rng = np.random.default_rng(4)
    scenario = of_vehicles(of_lanes(tmp_path), 0.01, components)
    together, alone = Fused(scenario.phases), Fused(scenario.phases)
    V = len(together._vehicles)
    loop, rigid = alone.compiled
    one_by_one = loop.params.fleet._replace(blocks=np.arange(V + 1))
    loop = loop._replace(params=loop.params._replace(fleet=one_by_one))
    ours, theirs = together._loop.state, loop.state
    compared = 0
    for k in range(40):
        q, w = ours.qpos.reshape(V, 7), ours.qvel.reshape(V, 6)
        q[:, :3], q[:, 3:] = rng.uniform(-9, 9, (V, 3)), Rotation.random(V, random_state=rng).as_quat()
        q[:, 3:] *= 1.0 + 1e-9 * k
        w[:] = rng.normal(0, 4, (V, 6)) * (rng.random((V, 1)) < 0.9)
        w[rng.integers(V), 3:] *= 10.0
        ours.act[:] = rng.uniform(0, 5, len(ours.act))
        ours.memory.command[:] = rng.normal(0, 3, (V, 3)) * rng.choice([0.0, 0.1, 10.0])
        worse = k % 4 == 3
        if worse:
            ours.memory.command[rng.integers(8), 0] = rng.choice([np.nan, np.inf, 1e300])
            w[10, 0] = 1e11
        for name in ("qpos", "qvel", "ctrl", "act"):
            getattr(theirs, name)[:] = getattr(ours, name)
        theirs.memory.command[:] = ours.memory.command
        together._bad[:] = alone._bad[:] = NEVER
        ours.steps[0] = theirs.steps[0] = 10 * k + 1  # the law is not evaluated in the next 5
        advance(*together.compiled, 5, together._unrecorded, together._bad)
        advance(loop, rigid, 5, alone._unrecorded, alone._bad)
        found = together._bad != NEVER
        good = not found.any()
        assert worse <= found.any()
        assert good == (alone._bad == NEVER).all()
        compared += good
        np.testing.assert_array_equal(together._bad[found], alone._bad[found])
        if good:  # where one is bad, its neighbours stop with it
            for name in ("qpos", "qvel", "ctrl", "act"):
                np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    assert compared > 20


@pytest.mark.long
def test_lanes_beyond_the_last_boat_have_no_undefined_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Undefined numbers there would take the whole block through the efforts beyond limits."""
    waves = {"kind": "jonswap", "significant_height": 1.0, "peak_period": 4.0, "components": 5}
    scenario = build_scenario(
        {f"A{k}": {"position": [9.0 * k, 1.0], "vehicle": "wamv"} for k in range(3)},
        {},
        [],
        anchors=[{"agent": f"A{k}", "axes": ["x", "y"], "value": [9.0 * k, 1.0]} for k in range(3)],
        flow={"water": {"dimension": 2, "drift": [0.3, 0.1], "waves": waves}},
        controller={"gain": 1.0, "control_period": 0.02},
    )
    blocks = []

    def keep(dtype: np.dtype[np.void]) -> Any:
        blocks.append(on_stack(dtype))
        return blocks[-1]

    monkeypatch.setattr(block, "on_stack", keep)
    fused = Fused(scenario.phases)
    nothing = Log(*(np.empty((0,) * values.ndim) for values in fused._unrecorded.log[:-1]))
    arguments = _as_records((fused._loop, fused._rigid, 0, 3, 0, 1, nothing, -1, fused._bad))
    assert in_python(block.advance_lanes)(*arguments)
    compared = 0
    for each in blocks:
        for rows in vars(each).values():
            for one, other in zip(rows[..., 0].ravel(), rows[..., 3].ravel(), strict=True):
                assert one == other
                compared += one is not None
    assert compared > 60


# -- runs --------------------------------------------------------------------------------------------------------------


LOOPS_AND_LINKS = {
    "controller": {"gain": 1.0, "control_period": 0.02, "feedforward": {"rounds": 2}, "drift": {"filter": 1.0}},
    "links": {"all": {"noise": 0.02, "delay": 0.02, "loss": 0.2}},
    "events": [{"time": 0.5, "lose": "back"}],
}


def apart(one: xr.Dataset, other: xr.Dataset) -> float:
    """The largest difference of two runs' positions, m."""
    assert one.attrs["status"] == other.attrs["status"] == "finished"
    names = [name for name in ("agent_position", "target_position") if one[name].size]
    return max(float(np.nanmax(np.abs(one[name] - other[name]))) for name in names)


def both(scenario: Scenario, **how: Any) -> tuple[xr.Dataset, xr.Dataset]:
    return simulate(scenario, **how), simulate(scenario, engine="fused", **how)


@pytest.mark.slow(each=True)
def test_a_run_is_that_of_mujoco() -> None:
    """Unlike vehicles under terms, over links, with an event: all that is recorded, to rounding."""
    mujoco_s, ours = both(mixed_scenario(**LOOPS_AND_LINKS))
    assert apart(mujoco_s, ours) < 1e-11
    assert ours.attrs.pop("engine") == "fused"
    assert "engine" not in mujoco_s.attrs
    assert ours.attrs == mujoco_s.attrs
    assert ours.data_vars.keys() == mujoco_s.data_vars.keys()
    for name, values in mujoco_s.data_vars.items():
        if values.dtype.kind == "f":
            scale = 1e-9 * max(1.0, float(np.nanmax(np.abs(values), initial=0.0)))
            np.testing.assert_allclose(ours[name], values, rtol=0.0, atol=scale, err_msg=str(name))
        else:
            np.testing.assert_array_equal(ours[name], values, err_msg=str(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", list_scenarios())
def test_every_scenario_runs_as_on_mujoco(name: str) -> None:
    """Over its whole length, contacts off."""
    scenario = load_scenario(name, {"physics.contacts": False})
    if scenario.expect.refused is None:
        # The filter replaces commands at once where vehicles meet, and a symmetric team amplifies what rounding leaves.
        assert apart(*both(scenario)) < (1e-8 if scenario.safety is None else 1e-6 if name == "narrow_gate" else 1e-5)
        return
    with refused(MjsheafError) as caught:
        simulate(scenario, engine="fused")
    assert scenario.expect.refused in str(caught.value)


def test_a_law_in_python_and_one_that_is_continuous_run_as_on_mujoco() -> None:
    def law(t: float, seen: Any) -> Array:
        return np.asarray(-seen.disagreement + [np.sin(t), 0.0, 0.0])

    assert apart(*both(mixed_scenario(), controller=law)) < 1e-11
    continuous = mixed_scenario(controller={"gain": 1.0, "control_period": 0, "record_period": 0.02}, time={"end": 0.2})
    assert apart(*both(continuous)) < 1e-11


@pytest.mark.long
def test_a_comparison_has_one_more_variant_on_mujoco() -> None:
    record = compare(load_scenario("midpoint", {"time.end": 10.0}), engine="fused").record
    on_mujoco, ours = (record.rung(key).errors["team"].late for key in ("all-mujoco", "all"))
    assert on_mujoco.tracking_error == pytest.approx(ours.tracking_error, rel=1e-9)


# -- what it refuses ---------------------------------------------------------------------------------------------------


def test_what_it_cannot_do_is_refused_by_its_field() -> None:
    touching = mixed_scenario(physics={"contacts": True})
    with refused(InputError, "physics.contacts", "fused", "false"):
        simulate(touching, engine="fused")
    with refused(InputError, "physics.contacts"):
        Fused(on_engine(touching.phases, "fused"))
    with refused(InputError, "'fused'", "ideal", "physics"):
        simulate(mixed_scenario(), "ideal", engine="fused")
    with refused(InputError, "'fusde'", "mujoco", "fused"):
        simulate(mixed_scenario(), engine="fusde")
    (error,) = simulate_many([touching], engine="fused")
    assert isinstance(error, InputError)


# -- vector code -------------------------------------------------------------------------------------------------------


ARITHMETIC = re.compile(r"^\s+v?(?:add|sub|mul|div|sqrt|max|min|fn?m(?:add|sub)\d+)([ps]d)\s+(.*)$")
LABEL = re.compile(r"^([^\s.#][^:]*):$")  # of a function
CPU = Path("/proc/cpuinfo")


def alone(loop: Any, motion: Any, last: int, log: Any, bad: Any) -> Any:
    """Take a step with the vehicles before `last`."""
    return advance_lanes(loop, motion, 0, last, 0, 1, log, -1, bad)


@pytest.mark.long
@pytest.mark.skipif(not CPU.exists() or "avx2" not in CPU.read_text(), reason="needs a processor with AVX2")
def test_most_operations_are_four_to_an_instruction() -> None:
    scenario = load_scenario("swarm", {"swarm.size": 17, "time.end": 0.1})
    loop, motion = Fused(on_engine(scenario.phases, "fused")).compiled
    compiled = user_jit(alone)
    assert compiled(loop, motion, 16, new_log(0, scenario.system.law, actuators=0), np.full(18, NEVER))
    (text,) = compiled.inspect_asm().values()
    functions: dict[str, Counter[int]] = {}
    name = ""
    for line in text.splitlines():
        if label := LABEL.match(line):
            name = label[1]
        elif found := ARITHMETIC.match(line):
            wide = 1 if found[1] == "sd" else 8 if "%zmm" in found[2] else 4 if "%ymm" in found[2] else 2
            functions.setdefault(name, Counter())[wide] += wide
    # What rarely happens is compiled apart, for a vehicle at a time: it is in functions of its own, or in the step's.
    operations = max(functions.values(), key=Counter.total)
    assert operations[4] + operations[8] > 3500
    assert operations[4] + operations[8] >= 0.8 * operations.total(), operations
