"""A vehicle's own loop, linearised: from the velocity that the law commands to the position that it controls.

The loop is the one that `World` steps: autopilot, attitude, thruster lag, drag, added mass and MuJoCo's integrator.
Each vehicle is brought to the equilibrium in which it holds station in a steady, uniform medium, and the map of one
physics step is differenced there. Its powers give the map of a control period over which the command is held: at an
equilibrium that is the chain rule, and it takes some hundred steps instead of some thousands.

Position does not enter: neither the medium nor the arena changes with it. So it is left out of the state, and what
moves it is kept apart. A heading that nothing holds (a boat at its hand point in still water) does not enter either,
and shows as an eigenvalue of 1 that no position sees.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mjsheaf.control import ControlArrays
from mjsheaf.dynamics import FlowField
from mjsheaf.dynamics.disturbance import pack
from mjsheaf.engine import mujoco
from mjsheaf.simulation.arena import compose
from mjsheaf.simulation.loop import close_loop, controlled_position, new_loop
from mjsheaf.system import MediumArrays
from mjsheaf.vehicles.vehicle import Vehicle

Array = NDArray[np.float64]

_PROBE = 1e-6  # m, rad, m/s, rad/s; and, times the mass, of a thruster's force in N: half of what is differenced
_LEAST_THRUST = 1e3 * _PROBE  # m/s^2: what differences about a thrust change of it is small above that
_ROUNDING = 1e-9  # entries of the difference quotients below it are rounding: 1e-16 m over the probe
_NEUTRAL = 1e-5  # 1/s: a singular value of the rates below it is a direction in which nothing holds or drives
_STILL = 1e-7  # m/s, m/s^2, ...: rates of an equilibrium
_NEWTON_STEPS = 20
_SETTLE_TIME = 20.0  # s, for which a vehicle is simulated before Newton's second attempt
_MOST_SETTLE_STEPS = 10_000


@dataclass(frozen=True)
class Station:
    """A vehicle that is to hold station.

    Attributes:
        vehicle: what it is.
        medium: steady velocity of the medium, world axes, shape (3,), m/s.
        heading: that it holds, or from which it starts to turn where it holds none, rad.
    """

    vehicle: Vehicle
    medium: Array
    heading: float


class LinearVehicle(NamedTuple):
    """x' = A x + B u, p' = p + C x + D u from one control period to the next, about an equilibrium.

    x (s,) is attitude (world axes, rad), height of a floating vehicle (m), joints of the vehicle's own, velocity (world
    axes, m/s), rates (body axes, rad/s) and those of the joints, and thruster activations over the vehicle's mass;
    u (n,) is the commanded velocity, held over the period, and p (n,) the controlled position, both in world axes.
    """

    A: Array
    B: Array
    C: Array
    D: Array


def linearise(
    stations: Sequence[Station], control: ControlArrays, timestep: float, steps: int
) -> list[LinearVehicle | str]:
    """Linearise each vehicle's loop about the equilibrium in which it holds station.

    Args:
        stations: the vehicles; all are linearised side by side in one arena.
        control: any: the law is not evaluated, but compiled code is handed it.
        timestep: of the physics, s.
        steps: physics steps in a control period; 1 where the law is evaluated at each.

    Returns:
        For each, the model; or, where there is none, why.

    Raises:
        InputError: a vehicle does not go into an arena.
    """
    bench = _Bench(stations, control, timestep)
    found = bench.settle()
    models = bench.differentiate()
    return [why if why else _over(model, steps) for why, model in zip(found, models, strict=True)]


def power(one: LinearVehicle, steps: int) -> Array:
    """The map of (x, p, u) over many steps under one command, shape (s + 2 n, s + 2 n)."""
    s, n = one.B.shape
    whole = np.eye(s + 2 * n)
    whole[:s, :s], whole[:s, s + n :] = one.A, one.B
    whole[s : s + n, :s], whole[s : s + n, s + n :] = one.C, one.D
    return np.linalg.matrix_power(whole, steps)


def _over(one: LinearVehicle, steps: int) -> LinearVehicle:
    """The map of many physics steps under one command."""
    (s, n), whole = one.B.shape, power(one, steps)
    return LinearVehicle(whole[:s, :s], whole[:s, s + n :], whole[s : s + n, :s], whole[s : s + n, s + n :])


class _Places(NamedTuple):
    """Where one vehicle's numbers are: slices of qvel and act, and how many coordinates it is controlled in."""

    dofs: slice
    acts: slice
    n: int

    @property
    def size(self) -> int:
        """Number of states: twice the degrees of freedom, without the position, and the activations."""
        return 2 * (self.dofs.stop - self.dofs.start) - self.n + self.acts.stop - self.acts.start


class _Bench:
    """Vehicles side by side in one arena, whose states are set and stepped.

    A state is kept as MuJoCo's own qpos, qvel and act of all vehicles, and the commands (V, 3). Differences of states
    are lists with one vector a vehicle: the states x of `LinearVehicle`, then the position or the command.
    """

    def __init__(self, stations: Sequence[Station], control: ControlArrays, timestep: float) -> None:
        vehicles = [station.vehicle for station in stations]
        V = len(vehicles)
        arena = compose(vehicles, [f"V{v}" for v in range(V)], timestep=timestep, visible=False)
        self.model, self.data, self.timestep = arena.model, mujoco.MjData(arena.model), timestep
        flows = [FlowField(dimension=3, drift=station.medium.tolist()) for station in stations]
        medium = MediumArrays(
            V,
            np.array([vehicle.dimension == 2 for vehicle in vehicles]),
            np.vstack([flow.table for flow in flows]),
            np.column_stack([np.arange(V), np.arange(1, V + 1)]).astype(np.int64),
            pack(np.zeros((V, 0, 5))),
        )
        heading = np.array([station.heading for station in stations])
        self.loop = new_loop(arena, self.data, control, medium, heading, 0.0)
        self.arena, self.vehicles = arena, vehicles
        ends = [*arena.dof[1:], self.model.nv]
        lagging = np.concatenate([[0], np.cumsum(self.model.actuator_actadr >= 0)])
        self.places = [
            _Places(
                slice(int(arena.dof[v]), int(ends[v])),
                slice(int(lagging[arena.thruster[v]]), int(lagging[arena.thruster[v + 1]])),
                vehicle.dimension,
            )
            for v, vehicle in enumerate(vehicles)
        ]
        mujoco.mj_resetData(self.model, self.data)
        self.qpos, self.qvel, self.act = self.data.qpos.copy(), self.data.qvel.copy(), self.data.act.copy()
        for v, angle in enumerate(heading):
            at = arena.qpos[v]
            self.qpos[at : at + 7] = [0.0, 0.0, 0.0, np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        trim = np.concatenate([vehicle.trim for vehicle in vehicles])
        self.act[:] = trim[self.model.actuator_actadr >= 0]
        self.command = -np.array([station.medium for station in stations]).reshape(V, 3)
        self.command[[vehicle.dimension == 2 for vehicle in vehicles], 2] = 0.0

    def settle(self) -> list[str]:
        """Bring every vehicle to its equilibrium; say for each why there is none, or nothing."""
        start = self.qpos, self.qvel, self.act, self.command
        unsettled = self._newton()
        if unsettled.any():
            self.qpos, self.qvel, self.act, self.command = start
            self._simulate()
            unsettled = self._newton()
        self._step([np.zeros(p.size + p.n) for p in self.places])
        reasons = []
        for v, vehicle in enumerate(self.vehicles):
            ctrl = vehicle.by_actuator(self.data.ctrl[self.arena.thruster[v] : self.arena.thruster[v + 1]])
            least = _LEAST_THRUST * vehicle.mass
            rough = (a.why_rough(u, least) for a, u in zip(vehicle.actuators, ctrl, strict=True))
            reasons.append("it finds no equilibrium" if unsettled[v] else next(filter(None, rough), ""))
        return reasons

    def differentiate(self) -> list[LinearVehicle]:
        """The map of one physics step about the present state, by central differences."""
        sizes = [p.size + p.n for p in self.places]
        columns: list[list[Array]] = [[] for _ in sizes]
        for k in range(max(sizes)):
            ends = []
            for sign in (1.0, -1.0):
                probe = [np.zeros(size) for size in sizes]
                for x in probe:
                    if k < len(x):
                        x[k] = sign * _PROBE
                ends.append(self._step(probe))
            for v, (ahead, behind) in enumerate(zip(*ends, strict=True)):
                if k < sizes[v]:
                    columns[v].append((ahead - behind) / (2.0 * _PROBE))
        return [_model(np.column_stack(found), p.size) for found, p in zip(columns, self.places, strict=True)]

    def _newton(self) -> NDArray[np.bool_]:
        """Solve x' = x, p' = p for states and commands; return which vehicles have not come to rest, shape (V,)."""
        for _ in range(_NEWTON_STEPS):
            rates = [r / self.timestep for r in self._step([np.zeros(p.size + p.n) for p in self.places])]
            moving = np.array([not np.abs(r).max() < _STILL for r in rates])
            going = moving & np.array([bool(np.isfinite(r).all()) for r in rates])
            if not going.any():
                return moving
            corrections = []
            for rate, model, busy in zip(rates, self.differentiate(), going, strict=True):
                if not busy:
                    corrections.append(np.zeros(len(rate)))
                    continue
                slope = np.block([[model.A - np.eye(len(model.A)), model.B], [model.C, model.D]]) / self.timestep
                U, sigma, V = np.linalg.svd(slope)
                held = sigma > _NEUTRAL
                corrections.append(-V[held].T @ ((U[:, held].T @ rate) / sigma[held]))
            self._shift(corrections)
        return moving

    def _simulate(self) -> None:
        """Let all vehicles fly or sail under their commands, then put them back to where they began."""
        self._place(self.qpos, self.qvel, self.act, self.command)
        for _ in range(min(round(_SETTLE_TIME / self.timestep), _MOST_SETTLE_STEPS)):
            close_loop(self.loop, 0.0, False)
            mujoco.mj_step(self.model, self.data)
        self.qpos, self.qvel, self.act = self.data.qpos.copy(), self.data.qvel.copy(), self.data.act.copy()
        self._centre()

    def _centre(self) -> None:
        for v, p in enumerate(self.places):
            at = self.arena.qpos[v]
            self.qpos[at : at + p.n] = 0.0

    def _rotations(self) -> Array:
        """Attitudes, body to world, shape (V, 3, 3)."""
        R = np.empty((len(self.places), 9))
        for v, at in enumerate(self.arena.qpos):
            mujoco.mju_quat2Mat(R[v], self.qpos[at + 3 : at + 7])
        return R.reshape(-1, 3, 3)

    def _moved(self, differences: list[Array]) -> tuple[Array, Array, Array, Array]:
        """qpos, qvel, act and commands at the present state and given differences (states, then command)."""
        dq, dv, da, du = np.zeros(self.model.nv), self.qvel.copy(), self.act.copy(), self.command.copy()
        for v, (p, x, R) in enumerate(zip(self.places, differences, self._rotations(), strict=True)):
            first, joints = p.dofs.start, p.dofs.stop - p.dofs.start
            turn, rest, n = x[:3], x[3:], p.n
            hand = np.cross(turn, R[:, 0]) * self.vehicles[v].hand  # by which turning would move the hand point
            dq[first : first + n] = -hand[:n]
            dq[first + n : first + 3] = rest[: 3 - n]
            dq[first + 3 : first + 6] = R.T @ turn
            rest = rest[3 - n :]
            dq[first + 6 : p.dofs.stop] = rest[: joints - 6]
            rest = rest[joints - 6 :]
            dv[p.dofs] += rest[:joints]
            da[p.acts] += rest[joints : len(rest) - n] * self.vehicles[v].mass
            du[v, :n] += rest[len(rest) - n :]
        qpos = self.qpos.copy()
        mujoco.mj_integratePos(self.model, qpos, dq, 1.0)
        return qpos, dv, da, du

    def _shift(self, differences: list[Array]) -> None:
        self.qpos, self.qvel, self.act, self.command = self._moved(differences)
        self._centre()

    def _place(self, qpos: Array, qvel: Array, act: Array, command: Array) -> None:
        self.data.qpos, self.data.qvel, self.data.act = qpos, qvel, act
        self.data.time = 0.0
        self.loop.state.memory.command[:] = command

    def _controlled(self, qpos: Array) -> Array:
        x, fleet = np.empty((len(self.places), 3)), self.loop.fleet
        for v in range(len(x)):
            body = fleet.bodies[v]
            controlled_position(fleet.kinds[body["kind"]], body, qpos, x[v])
        return x

    def _step(self, differences: list[Array]) -> list[Array]:
        """Where a physics step leads from given differences (states, then command): differences (states, position)."""
        qpos, *others = self._moved(differences)
        begin = self._controlled(qpos)
        self._place(qpos, *others)
        close_loop(self.loop, 0.0, False)
        mujoco.mj_step(self.model, self.data)
        dq = np.empty(self.model.nv)
        mujoco.mj_differentiatePos(self.model, dq, 1.0, self.qpos, self.data.qpos)
        dv, da = self.data.qvel - self.qvel, self.data.act - self.act
        moved = self._controlled(self.data.qpos) - begin
        return [
            np.concatenate(
                [
                    R @ dq[p.dofs][3:6],
                    dq[p.dofs][p.n : 3],
                    dq[p.dofs][6:],
                    dv[p.dofs],
                    da[p.acts] / vehicle.mass,
                    moved[v, : p.n],
                ]
            )
            for v, (p, R, vehicle) in enumerate(zip(self.places, self._rotations(), self.vehicles, strict=True))
        ]


def _model(quotients: Array, s: int) -> LinearVehicle:
    """Split difference quotients of (x', p' - p) by (x, u), without what is rounding."""
    change = quotients.copy()
    change[:s, :s] -= np.eye(s)
    change[np.abs(change) < _ROUNDING] = 0.0
    return LinearVehicle(change[:s, :s] + np.eye(s), change[:s, s:], change[s:, :s], change[s:, s:])
