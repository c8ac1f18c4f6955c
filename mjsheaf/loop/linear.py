"""A vehicle's own loop, linearised: from the velocity that the law commands to the position that it controls.

The loop is the one that `World` steps: autopilot, attitude, thruster lag, drag, added mass and MuJoCo's integrator.
Each vehicle is brought to the equilibrium in which it holds its place in a steady, uniform medium, and the map of one
physics step is differenced there. Its powers give the map of a control period over which the command is held: at an
equilibrium that is the chain rule, and it takes some hundred steps instead of some thousands.

The position is not part of the state, because neither the medium nor the arena depends on it; its change over a period
is an output. A heading that nothing holds (a boat steered at its hand point in still water) gives an eigenvalue of 1
that does not affect any position.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mjsheaf.arrays import Array, BoolArray, lay_out, quaternions_of
from mjsheaf.compile.jit import held
from mjsheaf.compile.remember import remember_last
from mjsheaf.law.law import ControlArrays, no_station
from mjsheaf.loop.bodies import pack_fleet
from mjsheaf.loop.loop import AUTOPILOT, Params, controlled_positions, new_loop
from mjsheaf.loop.mujoco_engine import evaluate_forces, mujoco_arrays
from mjsheaf.media.flow import FlowField
from mjsheaf.media.medium import WindArrays, pack_medium
from mjsheaf.mujoco_import import mujoco, quiet
from mjsheaf.vehicles.arena import compose
from mjsheaf.vehicles.vehicle import Vehicle

_PROBE = 1e-6  # m, rad, m/s, rad/s; and, times the mass, of a thruster's force in N: half of what is differenced
_ROUNDING = 1e-9  # entries of the difference quotients below it are rounding: 1e-16 m over the probe


@dataclass(frozen=True)
class HeldPoint:
    """A vehicle that is to hold its place.

    Attributes:
        vehicle: The vehicle.
        medium: Steady velocity of the medium, world axes, shape (3,), m/s.
        heading: Heading that it holds, or its initial heading if it holds none, rad.
        wind: Steady velocity of the air above a hull, world axes, shape (3,), m/s.
        command: Commanded velocity through the medium near which it holds its place, world axes, shape (3,), m/s; None
            if that is minus the velocity of the medium.
    """

    vehicle: Vehicle
    medium: Array
    heading: float
    wind: Array = field(default_factory=lambda: np.zeros(3))
    command: Array | None = None


class LinearVehicle(NamedTuple):
    """x' = A x + B u, p' = p + C x + D u from one control period to the next, about an equilibrium.

    x (s,) is attitude (world axes, rad), height of a floating vehicle (m), velocity (world axes, m/s), rates (body
    axes, rad/s), and thruster activations over the vehicle's mass; u (n,) is the commanded velocity, held over the
    period, and p (n,) the controlled position, both in world axes.
    """

    A: Array
    B: Array
    C: Array
    D: Array


@remember_last(lambda points, control, timestep, steps: (list(points), timestep, steps))  # not the law
@quiet()
def linearise(
    points: Sequence[HeldPoint], control: ControlArrays, timestep: float, steps: int
) -> list[LinearVehicle | str]:
    """Linearise each vehicle's loop about the equilibrium in which it keeps its place.

    Args:
        points: Vehicles and the points that they hold; all are linearised together in one arena.
        control: Any control; compiled code needs it as an argument, but the law is not evaluated.
        timestep: Physics step, s.
        steps: Number of physics steps in a control period; 1 if the law is evaluated at each.

    Returns:
        The model of each vehicle, or the reason why there is none.

    Raises:
        InputError: A vehicle does not fit into an arena.
    """
    bench = _Bench(points, control, timestep)
    found = bench.settle()
    models = bench.differentiate()
    return [why if why else _over(model, steps) for why, model in zip(found, models, strict=True)]


def step_responses(
    model: LinearVehicle, period: float, *, steady: float = 1e-4, least: int = 64, most: int = 10_000
) -> Array:
    """Compute the mean velocity in each period after steps of the commands, shape (K, n, n), until it is steady.

    Column i is the response to a step of command i. K is from `least` to about `most`. Responses that vary by less than
    the fraction `steady` of the commanded velocity are steady.
    """
    x = np.zeros_like(model.B)
    responses: list[Array] = []
    moving = np.inf
    while moving > steady and len(responses) < most:
        for _ in range(max(least, len(responses))):
            responses.append((model.C @ x + model.D) / period)
            x = model.A @ x + model.B
        moving = float(np.abs(np.array(responses[len(responses) // 2 :]) - responses[-1]).max())
    return np.array(responses)


def stopping_time(model: LinearVehicle, period: float, *, instants: int = 64) -> float:
    """Compute the largest distance to a stop over the bound on commanded speeds, in s, for any sequence of commands.

    Let S_k be the mean velocity in the k-th period h after a step of the command, and u_j the command in period j. The
    position that moves as commanded, h sum u_j, is ahead of the controlled position by h sum_k (1 - S_k) u_(j - k):
    steps show it, and the loop is linear. So |u| <= v bounds that by h v sum_k |1 - S_k|, which in one axis
    u_(j - k) = v sign(1 - S_k) reaches. It is the distance to a stop, too, if u = 0 from now on. Until then the vehicle
    moves by h sum_k (S_(k + i) - S_k) u_(j - k) in i periods, which is at most h v sum_k |S_(k + i) - S_k|. Where S
    does not overshoot, all of these are at most v times the integral of 1 - S, which is v tau at first order.

    The largest of these sums over v is returned, with the last S_k in place of 1: a steady difference is no lag, and
    the law corrects it.

    Args:
        model: Linear vehicle.
        period: Time h over which it holds a command, s.
        instants: Number of instants i after the command to stop at which the way is computed, about.
    """
    S = step_responses(model, period)
    K = len(S)
    S = np.concatenate([S, K * [S[-1]]])
    ahead = np.linalg.norm(S - S[-1], 2, axis=(1, 2)).sum()
    stride = max(1, K // instants)
    ways = [np.linalg.norm(S[i:] - S[:-i], 2, axis=(1, 2)).sum() for i in range(stride, K, stride)]
    return float(period * max(ahead, *ways))


def stopping_times(
    vehicles: Sequence[Vehicle], control: ControlArrays, timestep: float, steps: int, *, overshoot: float = 1.005
) -> list[float]:
    """Compute the stopping time of each vehicle, s: tau unless its linear loop overshoots.

    A time of less than `overshoot` times tau is how MuJoCo integrates.
    """
    times = [float(vehicle.reduced_model().tau.max()) for vehicle in vehicles]
    driven = [v for v, vehicle in enumerate(vehicles) if vehicle.actuators]
    points = [HeldPoint(vehicles[v], np.zeros(3), 0.0) for v in driven]
    models = linearise(points, control, timestep, steps) if driven else []
    for v, model in zip(driven, models, strict=True):
        time = 0.0 if isinstance(model, str) else stopping_time(model, steps * timestep)
        if time > overshoot * times[v]:
            times[v] = time
    return times


def power(one: LinearVehicle, steps: int) -> Array:
    """Return the map of (x, p, u) over `steps` steps under a constant command, shape (s + 2 n, s + 2 n)."""
    s, n = one.B.shape
    zero, eye = np.zeros((n, s)), np.eye(n)
    whole = np.block([[one.A, zero.T, one.B], [one.C, eye, one.D], [zero, 0.0 * eye, eye]])
    return np.linalg.matrix_power(whole, steps)


def _over(one: LinearVehicle, steps: int) -> LinearVehicle:
    """Return the model over `steps` physics steps under a constant command."""
    (s, n), whole = one.B.shape, power(one, steps)
    return LinearVehicle(whole[:s, :s], whole[:s, s + n :], whole[s : s + n, :s], whole[s : s + n, s + n :])


class _Bench:
    """Vehicles side by side in one arena, whose states are set and stepped.

    A state is MuJoCo's qpos (V, 7), qvel (V, 6) and act of all vehicles, and the commands (V, 3). Differences of states
    are rows (V, 12 + a), padded to the most activations: attitude, place, velocity and rates, activations over mass.
    Coordinates of the place that are not controlled (a height) are states; in the others a difference before a step is
    one of the command, and one after a step is how far the controlled position has moved.
    """

    def __init__(self, points: Sequence[HeldPoint], control: ControlArrays, timestep: float) -> None:
        vehicles = [point.vehicle for point in points]
        V = len(vehicles)
        arena = compose(vehicles, [f"V{v}" for v in range(V)], timestep=timestep, visible=False)
        self.model, self.data, self.timestep = arena.model, mujoco.MjData(arena.model), timestep
        n = np.array([vehicle.dimension for vehicle in vehicles])
        flows = [FlowField(dimension=3, drift=point.medium.tolist()) for point in points]
        medium = pack_medium(V, n == 2, flows, np.arange(V), 0.0)
        if any(point.wind.any() for point in points):
            above = [FlowField(dimension=3, drift=point.wind.tolist()) for point in points]
            air = pack_medium(V, n == 0, above, np.arange(V), 0.0)
            medium = medium._replace(parts=(WindArrays(np.ones(V, dtype=np.int64), air),))
        heading = np.array([point.heading for point in points])
        fleet, arrays = pack_fleet(vehicles, heading, timestep), mujoco_arrays(self.model, self.data)
        helm, gain = np.full(V, AUTOPILOT, dtype=np.int8), self.model.actuator_gainprm
        params = Params(control, medium, fleet, no_station(V), helm, gain, timestep)
        bodies = self.data.qpos, self.data.qvel, self.data.ctrl, self.data.act
        self.loop = lay_out(lambda room: new_loop(params, lambda _: bodies, room))[1]
        self.compiled = held(self.loop), held(arrays)
        self.arena, self.vehicles = arena, vehicles
        self.controlled = np.arange(3) < n[:, None]
        lagging = np.diff(np.append(0, np.cumsum(self.model.actuator_actadr >= 0))[arena.thruster])
        self.activated = np.arange(lagging.max()) < lagging[:, None]
        # Of each vehicle's row: its states, and its command or position.
        self.entries = [
            (np.r_[0:3, 3 + n : 12 + a], np.r_[3 : 3 + n]) for n, a in zip(n.tolist(), lagging.tolist(), strict=True)
        ]
        self.hand = np.array([vehicle.steering.hand for vehicle in vehicles])
        self.mass = np.array([vehicle.mass for vehicle in vehicles])
        self.still = np.zeros((V, 12 + lagging.max()))
        self.qpos = np.hstack([np.zeros((V, 3)), quaternions_of(heading)])
        trim = np.concatenate([vehicle.trim for vehicle in vehicles])  # of level vehicles
        self.qvel, self.act = np.zeros((V, 6)), trim[self.model.actuator_actadr >= 0]
        commands = [-point.medium if point.command is None else point.command for point in points]
        self.command = np.array(commands).reshape(V, 3) * self.controlled

    def settle(self, *, least_thrust: float = 1e3 * _PROBE) -> list[str]:
        """Bring every vehicle to its equilibrium; return for each the reason why there is none, or an empty string.

        A thrust is far enough from 0 for differences of states if it exceeds `least_thrust`, m/s^2, times the mass.
        """
        start = self.qpos, self.qvel, self.act, self.command
        unsettled = self._newton()
        if unsettled.any():
            self.qpos, self.qvel, self.act, self.command = start
            self._simulate()
            unsettled = self._newton()
        self._step(self.still)
        reasons = []
        for v, vehicle in enumerate(self.vehicles):
            ctrl = vehicle.by_actuator(self.data.ctrl[self.arena.thruster[v] : self.arena.thruster[v + 1]])
            least = least_thrust * vehicle.mass
            rough = (a.why_rough(u, least) for a, u in zip(vehicle.actuators, ctrl, strict=True))
            reasons.append("it finds no equilibrium" if unsettled[v] else next(filter(None, rough), ""))
        return reasons

    def differentiate(self) -> list[LinearVehicle]:
        """Return the map of one physics step about the present state by central differences; rounding is set to 0."""
        V, size = self.still.shape
        change = np.empty((V, size, size))
        with np.errstate(all="ignore"):  # a step that diverges is not finite, which the caller refuses
            for k in range(size):
                probe = self.still.copy()
                probe[:, k] = _PROBE
                change[:, :, k] = (self._step(probe) - self._step(-probe)) / (2.0 * _PROBE)
        models = []
        for x, (s, u) in zip(change, self.entries, strict=True):
            x[s, s] -= 1.0
            x[np.abs(x) < _ROUNDING] = 0.0
            x[s, s] += 1.0
            models.append(LinearVehicle(*(x[np.ix_(to, of)] for to in (s, u) for of in (s, u))))
        return models

    def _newton(self, *, steps: int = 20, still: float = 1e-7, neutral: float = 1e-5) -> BoolArray:
        """Solve x' = x, p' = p for states and commands; return which vehicles have not come to rest, shape (V,).

        Rates below `still`, m/s, m/s^2, ..., are those of an equilibrium. Singular values of the rates below `neutral`,
        1/s, belong to directions in which nothing holds or drives.
        """
        for _ in range(steps):
            rates = self._step(self.still) / self.timestep
            moving = ~(np.abs(rates).max(axis=1) < still)
            going = moving & np.isfinite(rates).all(axis=1)
            if not going.any():
                return moving
            models, corrections = self.differentiate(), self.still.copy()
            for v in np.flatnonzero(going):
                one, entries = models[v], np.concatenate(self.entries[v])
                slope = np.block([[one.A - np.eye(len(one.A)), one.B], [one.C, one.D]]) / self.timestep
                left, sigma, right = np.linalg.svd(slope)
                held = sigma > neutral
                corrections[v, entries] = -right[held].T @ ((left[:, held].T @ rates[v, entries]) / sigma[held])
            self.qpos, self.qvel, self.act, self.command = self._moved(corrections)
            self.qpos[:, :3][self.controlled] = 0.0
        return moving

    def _simulate(self, *, duration: float = 20.0, most_steps: int = 10_000) -> None:
        """Move all vehicles under their commands for `duration`, s, then return them to their initial positions."""
        self._place(self.qpos, self.qvel, self.act, self.command)
        for _ in range(min(round(duration / self.timestep), most_steps)):
            evaluate_forces(*self.compiled, 0.0)
            mujoco.mj_step(self.model, self.data)
        self.qpos, self.qvel = self.data.qpos.reshape(-1, 7).copy(), self.data.qvel.reshape(-1, 6).copy()
        self.act = self.data.act.copy()
        self.qpos[:, :3][self.controlled] = 0.0

    def _rotations(self) -> Array:
        """Return the attitudes, body to world, shape (V, 3, 3)."""
        R = np.empty((len(self.qpos), 9))
        for row, quaternion in zip(R, self.qpos[:, 3:], strict=True):
            mujoco.mju_quat2Mat(row, quaternion)
        return R.reshape(-1, 3, 3)

    def _moved(self, difference: Array) -> tuple[Array, Array, Array, Array]:
        """Return qpos, qvel, act and commands of the present state plus a difference."""
        R, (turn, place, motion, thrust) = self._rotations(), np.split(difference, (3, 6, 12), axis=1)
        hand = np.cross(turn, R[:, :, 0]) * self.hand[:, None]  # by which turning would move the hand point
        dq = np.hstack([np.where(self.controlled, -hand, place), np.einsum("vij,vi->vj", R, turn)])
        qpos = self.qpos.copy()
        mujoco.mj_integratePos(self.model, qpos.reshape(-1), dq.reshape(-1), 1.0)
        act = self.act + (thrust * self.mass[:, None])[self.activated]
        return qpos, self.qvel + motion, act, self.command + place * self.controlled

    def _place(self, qpos: Array, qvel: Array, act: Array, command: Array) -> None:
        self.data.qpos, self.data.qvel, self.data.act = qpos.ravel(), qvel.ravel(), act
        self.data.time = 0.0
        self.loop.state.memory.command[:] = command

    def _step(self, difference: Array) -> Array:
        """Return the difference of states after a physics step from a difference before it."""
        self._place(*self._moved(difference))
        x, R = self.loop.state.x, self._rotations()
        controlled_positions(self.loop.params.fleet, self.data.qpos, x)
        begin = x.copy()
        evaluate_forces(*self.compiled, 0.0)
        mujoco.mj_step(self.model, self.data)
        dq, after = np.empty(self.model.nv), self.still.copy()
        mujoco.mj_differentiatePos(self.model, dq, 1.0, self.qpos.ravel(), self.data.qpos)
        dq = dq.reshape(-1, 6)
        controlled_positions(self.loop.params.fleet, self.data.qpos, x)
        after[:, :3] = np.einsum("vij,vj->vi", R, dq[:, 3:])
        after[:, 3:6] = np.where(self.controlled, x - begin, dq[:, :3])
        after[:, 6:12] = self.data.qvel.reshape(-1, 6) - self.qvel
        after[:, 12:][self.activated] = self.data.act - self.act
        after[:, 12:] /= self.mass[:, None]
        return after
