"""Linear vehicles of a team, each about the equilibrium in which it holds station in the mean flow that it would meet.

See `mjsheaf.loop.linear` for a vehicle. Of many vehicles some stand for all, if these behave alike.
"""

from collections.abc import Sequence

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.sampled_loop import ideal_vehicle
from mjsheaf.checking.theorem.constants import agent_flow, agent_motion
from mjsheaf.checking.theorem.targets import TargetPath, targets_loop
from mjsheaf.errors import InputError, NoModelError, OverpoweredError, UndecidedError
from mjsheaf.loop.linear import HeldPoint, LinearVehicle, linearise, power
from mjsheaf.loop.system import System, whole_ratio
from mjsheaf.media.medium import WITHOUT_MEAN
from mjsheaf.vehicles.effects import hold_station, is_one_sided, turning_of

PointKey = tuple[int, bytes]
"""Number of a vehicle; medium and heading in which it holds its place: equal for those that share a linear vehicle."""


def period_of_law(system: System) -> float:
    """Return the time between evaluations of the law, s: a physics step where it is continuous.

    Raises:
        InputError: The timestep does not divide the control period.
    """
    period = system.grid.period
    return period / whole_ratio(period, system.bodies.timestep) if system.grid.continuous else period


def ideal_team(system: System) -> list[LinearVehicle]:
    """Return every agent on ideal kinematics."""
    return [ideal_vehicle(system.grid.period, agent.dimension) for agent in system.team.agents]


def linear_vehicles(
    system: System,
    numbers: Sequence[int],
    medium: Array,
    *,
    most_points: int = 200,
) -> list[LinearVehicle]:
    """Return the linear vehicle of each of some vehicles of a system; those that are alike share one.

    Of many vehicles those that meet the extremes of the flow are linearised, and stand for all if they behave alike.

    Args:
        system: The system.
        numbers: Numbers of the vehicles, length n.
        medium: Velocity of the medium relative to the place that each holds, shape (n, 3), m/s.
        most_points: Largest number of vehicles that are linearised one by one.

    Raises:
        UndecidedError: One has none, they do not behave alike, or a step is not finite.
    """
    if not np.isfinite(medium).all():
        raise UndecidedError("the mean flow along q* is not known")
    names = [system.team.members[v].id for v in numbers]
    points = dict[PointKey, HeldPoint]()
    keys = []
    for v, name, met in zip(numbers, names, medium, strict=True):
        speed = float(np.linalg.norm(met))
        if speed > system.law.limit[v]:
            raise OverpoweredError(
                f"{name}: the mean flow, {speed:.3g} m/s relative to its place, is beyond its velocity limit"
            )
        point = _held_point(system, v, met)
        keys.append((id(point.vehicle), np.round([*point.medium, point.heading, *point.wind], 4).tobytes()))
        points.setdefault(keys[-1], point)
    many = len(points) > most_points
    chosen = list(points)
    if many:
        if len({vehicle for vehicle, _ in points}) > 1:
            raise UndecidedError("too many unlike vehicles")
        flows = np.array([point.medium for point in points.values()])  # its extremes, and some between
        extreme = {*flows.argmin(axis=0), *flows.argmax(axis=0), *np.linspace(0, len(flows) - 1, 20).astype(int)}
        chosen = [chosen[k] for k in sorted(int(k) for k in extreme)]
    try:
        period = period_of_law(system)
        steps = whole_ratio(period, system.bodies.timestep)
        found = linearise([points[key] for key in chosen], system.control, period / steps, steps)
    except (InputError, np.linalg.LinAlgError) as error:
        raise UndecidedError(f"the vehicles cannot be linearised: {error}") from error
    models = {}
    for key, model in zip(chosen, found, strict=True):
        models[key] = _require_linear(names[keys.index(key)], points[key], model)
    if not many:
        return [models[key] for key in keys]
    if not are_alike(list(models.values()), period):
        raise UndecidedError("too many vehicles that behave differently in the flows that they meet")
    return [models[chosen[0]]] * len(keys)


def _require_linear(
    name: str,
    point: HeldPoint,
    model: LinearVehicle | str,
    *,
    still: float = 1e-3,  # m/s: a slower medium is at rest
    way: float = 1.5,  # over the speed from which a boat that cannot go astern turns round: it then has a model
) -> LinearVehicle:
    """Return the linear vehicle of a member about a point.

    Raises:
        UndecidedError: It has none; the model then says why.
    """
    speed = float(np.linalg.norm(point.medium))
    if isinstance(model, str):
        why = f"{model} (some push one way only)" if is_one_sided(point.vehicle) else model
        if speed < still:
            raise NoModelError(f"{name} has no linear model at rest: {why}")
        raise OverpoweredError(
            f"{name} cannot hold station in a mean flow of {speed:.3g} m/s relative to its place"
            f"{' and in its wind' if point.wind.any() else ''}: {why}"
        )
    turning = turning_of(point.vehicle)
    if turning is not None and speed < way * turning.speed:
        raise NoModelError(
            f"{name} has no linear model at {speed:.3g} m/s through the medium: its vehicle cannot go astern, and "
            f"turns round for a target behind it unless it makes {way * turning.speed:.3g} m/s"
        )
    return model


def _held_point(
    system: System,
    number: int,
    medium: Array,
    *,
    time_constants: float = 3.0,  # l / |w| of turning into the current, that a run must last to turn a boat
) -> HeldPoint:
    """Return where a vehicle holds its place; one that holds no heading turns into the current if the run lasts.

    In wind, it turns until nothing pushes it abeam.
    """
    vehicle, heading, wind = system.vehicles[number], float(system.bodies.heading[number]), system.mean_wind[number]
    if wind.any():
        lies, command, _ = hold_station(vehicle, heading, medium, wind + medium)
        lies = heading if vehicle.steering.attitude else lies
        return HeldPoint(vehicle, medium, lies, wind + medium, np.append(command, 0.0))
    if vehicle.steering.attitude:
        return HeldPoint(vehicle, medium, heading)
    span = system.grid.period * system.grid.steps
    if float(np.hypot(medium[0], medium[1])) * span < time_constants * vehicle.steering.hand:
        return HeldPoint(vehicle, np.zeros(3), heading)
    return HeldPoint(vehicle, medium, float(np.arctan2(-medium[1], -medium[0])))


def response_of(
    model: LinearVehicle,
    period: float,
    *,
    span: float = 10.0,  # s, over which responses are compared
) -> Array:
    """Positions after a step of the command, less what an ideal vehicle makes, shape (T, n, n), m per m/s."""
    s, n = model.B.shape
    count = int(np.clip(span / period, 20, 400))
    stride = max(1, round(span / period / count))
    step = power(model, stride)
    state, found = np.vstack([np.zeros((s + n, n)), np.eye(n)]), []
    for k in range(count):
        state = step @ state
        found.append(state[s : s + n] - (k + 1) * stride * period * np.eye(n))
    return np.array(found)


def difference_of(one: Array, other: Array) -> float:
    """Largest difference of two responses, as a share of the larger of them."""
    return float(np.abs(one - other).max() / max(np.abs(one).max(), np.abs(other).max()))


def are_alike(
    models: list[LinearVehicle],
    period: float,
    *,
    difference: float = 0.02,  # largest difference between representatives of a large team, of a vehicle's response
) -> bool:
    """Return True if vehicles respond to a command in nearly the same way."""
    first = response_of(models[0], period)
    responses = (response_of(model, period) for model in models[1:])
    return all(r.shape == first.shape and difference_of(r, first) <= difference for r in responses)


def medium_on_path(system: System, path: TargetPath) -> Array:
    """Return the mean velocity of the medium along the targets' path, see `mean_medium`; NaN where none is known.

    Under gusts, which leave no certain path, it is that of targets that stay where they begin.
    """
    gusts = not np.isfinite(system.moving_bounds.speed).all()
    known = (path.cells is not None or gusts) and targets_loop(system).stable
    return mean_medium(system, path.time, path.q_star) if known else np.full((len(system.team.agents), 3), np.nan)


def mean_medium(
    system: System,
    time: Array,
    q_star: Array,
    *,
    most_samples: int = 200,  # of the path, for the mean flow
) -> Array:
    """Mean velocity of the medium relative to each agent's q*, along its path, shape (N, 3), m/s; no disturbance.

    The path is the stacked harmonic extension (T, n_q), m, at times (T,), s.
    """
    some = slice(None, None, max(1, len(q_star) // most_samples))
    w = agent_flow(system, q_star[some]) + agent_motion(system, time[some], q_star[some], WITHOUT_MEAN)
    mean = np.trapezoid(w, time[some], axis=0) / float(time[some][-1] - time[0])
    return system.team.unpack(mean - (q_star[-1] - q_star[0]) / float(time[-1] - time[0]))


def medium_about_targets(system: System, path: TargetPath) -> Array:
    """Return the mean velocity of the medium relative to each target's path, shape (M, 3), m/s.

    If the path is unknown or diverges, it is that where the target begins.
    """
    N = len(system.team.agents)
    bounded = path.cells is not None and targets_loop(system).stable
    positions = path.positions[:, N:] if bounded else system.initial[None, N:]
    medium = -(positions[-1] - positions[0]) / float(path.time[-1] - path.time[0])
    for k in range(len(medium)):
        medium[k] += np.mean(system.flows[int(system.field[N + k])].velocity(positions[:, k]), axis=0)
    return medium
