"""An integrator of the continuous closed loop that shares no code with the one under test.

It reads a scenario's plain numbers, assembles its own H, B, c, references and flow, and integrates agents and targets
together with Dormand and Prince's 8(5,3) pair (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I,
II.5 and II.10; coefficients from SciPy). Nothing is recorded on a grid: every step of the integrator is a sample. A
step is so short that

- no vehicle moves by more than a quarter of the size of a kernel that it is near, in any stage of the step;
- no motion or disturbance turns by more than 0.4 rad, no waypoint piece is crossed in fewer than four steps;
- the span has at least a thousand steps.

So it cannot step over a jet, whatever the error estimate says, and sees |e| between any samples that a run records.

Only the draw of the disturbances' harmonics is taken from the project: it is a sequence of random numbers, not
mathematics. Effectiveness is not read: g g^+ = I wherever g has full row rank.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import factorial
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate._ivp import dop853_coefficients as dop
from scipy.interpolate import BSpline, PPoly, make_interp_spline
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

SOURCE, VORTEX, CHANNEL = 0, 1, 2
_MOST_STEPS = 3_000_000
_FEWEST_STEPS = 1000
_CHUNK = 20_000
_FINISHED, _FULL, _BLEW_UP = 0, 1, 2


class Loop(NamedTuple):
    """The closed loop in numbers, for V vehicles, the first N of them agents; positions are padded to (V, 3).

    A (3V, 3V), c (3V,) with residual A x - c; gain (V,) 1/s; limit (V,) m/s.
    drift (V, 3) m/s; kernels (V, K, 12): kind, in space or not, centre (3), axis (3), strength, and core^2 or width
    and length; kernel_count (V,). planar (V,).
    pull (V,) 1/s; origin, amplitude, rate, phase (V, 3); pieces (V,), knots (V, P + 1), coefficients (V, P, 6, 3);
    period (V,) s, of a closed path. harmonics (V, K, 5): amplitude (3), rate, phase.
    """

    A: Array
    c: Array
    gain: Array
    limit: Array
    drift: Array
    kernels: Array
    kernel_count: NDArray[np.int64]
    planar: NDArray[np.bool_]
    pull: Array
    origin: Array
    amplitude: Array
    rate: Array
    phase: Array
    pieces: NDArray[np.int64]
    knots: Array
    coefficients: Array
    period: Array
    harmonics: Array


@dataclass(frozen=True)
class Truth:
    """Solution of a scenario by the independent integrator.

    Attributes:
        status: 'finished', 'blew up' (the solution leaves every bound, or reaches a singularity), or 'too long'.
        time: Time of every step of the integrator, shape (T,), s.
        error: |e| at these times, shape (T,), m.
        targets: Positions of the targets, padded, shape (T, M, 3), m.
        target_velocities: Velocities of the targets, shape (T, M, 3), m/s.
        agents: Positions of the agents, padded, shape (T, N, 3), m.
    """

    status: str
    time: Array
    error: Array
    targets: Array
    target_velocities: Array
    agents: Array


@njit(cache=True)
def reference(loop, v, t, r, dr):
    """Write the reference position r (3,) and velocity dr (3,) of vehicle v."""
    if loop.pieces[v] == 0:
        for i in range(3):
            turn = loop.rate[v, i] * t + loop.phase[v, i]
            r[i] = loop.origin[v, i] + loop.amplitude[v, i] * np.sin(turn)
            dr[i] = loop.amplitude[v, i] * loop.rate[v, i] * np.cos(turn)
        return
    knots, last = loop.knots[v], loop.pieces[v]
    s = t - knots[0]
    if loop.period[v] > 0.0:
        s -= loop.period[v] * np.floor(s / loop.period[v])
    s = min(knots[0] + s, knots[last])
    k = min(max(np.searchsorted(knots[: last + 1], s, side="right") - 1, 0), last - 1)
    h = s - knots[k]
    for i in range(3):
        r[i], dr[i] = 0.0, 0.0
        for j in range(6):
            power = 5 - j
            r[i] += loop.coefficients[v, k, j, i] * h**power
            if power > 0:
                dr[i] += power * loop.coefficients[v, k, j, i] * h ** (power - 1)
    if loop.period[v] == 0.0 and t > knots[last]:
        for i in range(3):
            dr[i] = 0.0


@njit(cache=True)
def flow(loop, v, x, w):
    """Write the velocity of the medium that vehicle v meets at x into w (3,)."""
    for i in range(3):
        w[i] = loop.drift[v, i]
    r = np.empty(3)
    for k in range(loop.kernel_count[v]):
        row = loop.kernels[v, k]
        for i in range(3):
            r[i] = x[i] - row[2 + i]
        if row[1] == 0.0:
            r[2] = 0.0
        square = r[0] ** 2 + r[1] ** 2 + r[2] ** 2
        if row[0] == SOURCE:
            power = 1.5 if row[1] == 1.0 else 1.0
            for i in range(3):
                w[i] += row[8] * r[i] / (square + row[9]) ** power
        elif row[0] == VORTEX:
            share = row[8] / (square + row[9])
            w[0] += share * (row[6] * r[2] - row[7] * r[1])
            w[1] += share * (row[7] * r[0] - row[5] * r[2])
            w[2] += share * (row[5] * r[1] - row[6] * r[0])
        else:
            along = r[0] * row[5] + r[1] * row[6] + r[2] * row[7]
            across = max(square - along**2, 0.0)
            share = row[8] * np.exp(-0.5 * across / row[9] ** 2) * np.exp(-0.5 * along**2 / row[10] ** 2)
            for i in range(3):
                w[i] += share * row[5 + i]
    if loop.planar[v]:
        w[2] = 0.0


@njit(cache=True)
def commands(loop, t, x, out):
    """Write the commanded velocity of every vehicle, shape (V, 3): law or reference and consensus, limited."""
    V = len(loop.gain)
    flat = x.reshape(-1)
    r, dr = np.empty(3), np.empty(3)
    for v in range(V):
        reference(loop, v, t, r, dr)
        speed = 0.0
        for i in range(3):
            row = 3 * v + i
            residual = -loop.c[row]
            for j in range(3 * V):
                residual += loop.A[row, j] * flat[j]
            out[v, i] = dr[i] + loop.pull[v] * (r[i] - x[v, i]) - loop.gain[v] * residual
            speed += out[v, i] ** 2
        speed = np.sqrt(speed)
        if speed > loop.limit[v]:
            for i in range(3):
                out[v, i] *= loop.limit[v] / speed


@njit(cache=True)
def medium(loop, t, x, out):
    """Write the velocity of the medium about every vehicle, its flow and its disturbance, shape (V, 3)."""
    for v in range(len(loop.gain)):
        flow(loop, v, x[v], out[v])
        for k in range(loop.harmonics.shape[1]):
            h = loop.harmonics[v, k]
            s = np.sin(h[3] * t + h[4])
            for i in range(3):
                out[v, i] += h[i] * s


@njit(cache=True)
def slope(loop, held, t, x, command, out):
    """Write x' into out (V, 3); commands are those held, or follow the state."""
    if not held:
        commands(loop, t, x, command)
    medium(loop, t, x, out)
    for v in range(out.shape[0]):
        for i in range(3):
            out[v, i] += command[v, i]


@njit(cache=True)
def _velocities(loop, time, path):
    """x' of the law that is not held at each sample, shape (T, V, 3)."""
    out, command = np.empty_like(path), np.empty(path.shape[1:])
    for k in range(len(time)):
        slope(loop, False, time[k], path[k], command, out[k])
    return out


@njit(cache=True)
def _room(loop, x):
    """Return the largest displacement of each vehicle in a step, the minimum over its kernels, shape (V,), m."""
    V = x.shape[0]
    room = np.full(V, np.inf)
    r = np.empty(3)
    for v in range(V):
        for k in range(loop.kernel_count[v]):
            row = loop.kernels[v, k]
            for i in range(3):
                r[i] = x[v, i] - row[2 + i]
            if row[1] == 0.0:
                r[2] = 0.0
            square = r[0] ** 2 + r[1] ** 2 + r[2] ** 2
            if row[0] == CHANNEL:
                along = r[0] * row[5] + r[1] * row[6] + r[2] * row[7]
                across = max(square - along**2, 0.0)
                away = np.sqrt(across / row[9] ** 2 + along**2 / row[10] ** 2)  # in units of its size
                allowed = min(row[9], row[10]) * max(0.25, 0.5 * (away - 8.0))
            else:
                allowed = 0.25 * np.sqrt(square + row[9]) + 1e-12
            room[v] = min(room[v], allowed)
    return room


@njit(cache=True)
def _integrate(loop, t, end, longest, first, x, command, held, rtol, atol, A, B, C, E3, E5, times, states, count):
    """Advance x (V, 3) to `end`, recording steps from `count` on; return (status, t, next step, count)."""
    stages = 12
    V = x.shape[0]
    K = np.zeros((stages + 1, V, 3))
    y, new = np.empty((V, 3)), np.empty((V, 3))
    step = min(first, longest)
    slope(loop, held, t, x, command, K[0])
    while t < end:
        if count == len(times):
            return _FULL, t, step, count
        room = _room(loop, x)
        for v in range(V):
            speed = np.sqrt(K[0, v, 0] ** 2 + K[0, v, 1] ** 2 + K[0, v, 2] ** 2)
            if speed * step > room[v]:
                step = room[v] / speed
        if not step > 4e-16 * max(abs(t), 1e-300) or not step > 1e-15 * longest:
            return _BLEW_UP, t, step, count
        h = min(step, longest, end - t)
        too_far = 0.0
        for s in range(1, stages + 1):
            for v in range(V):
                moved = 0.0
                for i in range(3):
                    total = 0.0
                    for k in range(s):
                        total += (A[s, k] if s < stages else B[k]) * K[k, v, i]
                    y[v, i] = x[v, i] + h * total
                    moved += (h * total) ** 2
                too_far = max(too_far, np.sqrt(moved) / room[v])
            slope(loop, held, t + (C[s] if s < stages else 1.0) * h, y, command, K[s])
        new[:] = y
        e5, e3, finite = 0.0, 0.0, True
        for v in range(V):
            for i in range(3):
                scale = atol + rtol * max(abs(x[v, i]), abs(new[v, i]))
                a, b = 0.0, 0.0
                for k in range(stages + 1):
                    a += E5[k] * K[k, v, i]
                    b += E3[k] * K[k, v, i]
                e5 += (a / scale) ** 2
                e3 += (b / scale) ** 2
                finite = finite and abs(new[v, i]) < 1e9
        error = 0.0 if e5 == 0.0 else h * e5 / np.sqrt((e5 + 0.01 * e3) * 3 * V)
        if not np.isfinite(error) or not finite:
            step = 0.1 * h
            continue
        if error >= 1.0:
            step = h * max(0.2, 0.9 * error ** (-1.0 / 8.0))
            continue
        if too_far > 2.0:
            step = 0.5 * h
            continue
        t = end if h >= end - t else t + h
        x[:] = new
        K[0] = K[stages]
        times[count], states[count] = t, x
        count += 1
        step = h * (5.0 if error == 0.0 else min(5.0, 0.9 * error ** (-1.0 / 8.0)))
    return _FINISHED, t, step, count


def solve(raw: dict[str, Any], rtol: float = 1e-10, atol: float = 1e-12) -> Truth:
    """Integrate the closed loop of a scenario: with its law continuous where control_period is 0, else held."""
    loop, x, project = loop_of(raw)
    start, controller = raw["time"].get("start", 0.0), raw["controller"]
    held = bool(controller.get("control_period", 0.01) > 0.0)
    period = controller.get("control_period", 0.01) or controller.get("record_period", 0.01)
    steps = int((raw["time"]["end"] - start) / period + 1e-6)
    end = start + period * steps
    longest = min((end - start) / _FEWEST_STEPS, _longest_step(loop))
    A, B, C, E3, E5 = (np.ascontiguousarray(c) for c in (dop.A[:12, :12], dop.B, dop.C[:12], dop.E3, dop.E5))
    ends = start + period * np.arange(1, steps + 1) if held else np.array([end])
    t, step, status = start, longest * 1e-3, _FINISHED
    times, states = [np.array([start])], [x[None].copy()]
    buffer_t, buffer_x = np.empty(_CHUNK), np.empty((_CHUNK, *x.shape))
    command, done, count = np.zeros_like(x), 0, 0
    for stop in ends:
        if held:
            commands(loop, t, x, command)
        while True:
            status, t, step, count = _integrate(
                loop, t, stop, longest, step, x, command, held, rtol, atol, A, B, C, E3, E5, buffer_t, buffer_x, count
            )
            if status != _FULL:
                break
            times.append(buffer_t[:count].copy())
            states.append(buffer_x[:count].copy())
            done, count = done + count, 0
            if done > _MOST_STEPS:
                break
        if status != _FINISHED:
            break
        step = max(step, longest * 1e-6)
    times.append(buffer_t[:count])
    states.append(buffer_x[:count])
    time, path = np.concatenate(times), np.concatenate(states)
    N = len(raw["agents"])
    e = project(path)
    return Truth(
        {_FINISHED: "finished", _FULL: "too long", _BLEW_UP: "blew up"}[status],
        time,
        np.sqrt((e**2).sum(axis=1)),
        path[:, N:],
        _velocities(loop, time, path)[:, N:],
        path[:, :N],
    )


def _longest_step(loop: Loop) -> float:
    fastest = max(float(np.abs(loop.rate[loop.amplitude != 0.0]).max(initial=0.0)), 1e-300)
    if loop.harmonics.size:
        fastest = max(fastest, float(np.abs(loop.harmonics[..., 3]).max()))
    longest = 0.4 / fastest
    for v in np.flatnonzero(loop.pieces):
        longest = min(longest, 0.25 * float(np.diff(loop.knots[v, : loop.pieces[v] + 1]).min()))
    return longest


# -- from plain numbers to the loop --------------------------------------------------------------------------------


def loop_of(raw: dict[str, Any]) -> tuple[Loop, Array, Any]:
    """The loop of a scenario, its initial positions (V, 3), and the map from positions (T, V, 3) to e (T, n_q)."""
    agents, targets = raw["agents"], raw["targets"]
    members = [*agents, *targets]
    N, V = len(agents), len(members)
    n = [len(m["position"]) for m in members]
    x = np.zeros((V, 3))
    for v, member in enumerate(members):
        x[v, : n[v]] = member["position"]
    A, c = stiffness(raw)
    controller = raw["controller"]
    gain = np.full(V, float(controller["gain"]))
    gain[N:] = raw.get("target_formation", {}).get("gain", 0.0)
    limit = np.full(V, np.inf)
    for i, agent in enumerate(agents):
        limit[i] = agent.get("velocity_limit") or controller.get("velocity_limit") or np.inf
    fields = [_field(raw, v, N) for v in range(V)]
    most = max(len(rows) for _, rows in fields)
    kernels = np.zeros((V, max(most, 1), 12))
    for v, (_, rows) in enumerate(fields):
        kernels[v, : len(rows)] = np.array(rows).reshape(-1, 12)
    motion = _motions(raw, x, n)
    loop = Loop(
        A=A,
        c=c,
        gain=gain,
        limit=limit,
        drift=np.array([d for d, _ in fields]),
        kernels=kernels,
        kernel_count=np.array([len(rows) for _, rows in fields]),
        planar=np.array([k == 2 for k in n]),
        **motion,
        harmonics=_harmonics(raw, V),
    )
    slots = np.concatenate([3 * i + np.arange(n[i]) for i in range(N)])
    columns = np.concatenate([3 * v + np.arange(n[v]) for v in range(N, V)])
    H, B = A[np.ix_(slots, slots)], -A[np.ix_(slots, columns)]
    inverse = np.linalg.inv(H)

    def errors(path: Array) -> Array:
        flat = path.reshape(len(path), -1)
        return (flat[:, columns] @ B.T + c[slots]) @ inverse.T - flat[:, slots]

    return loop, x, errors


def stiffness(raw: dict[str, Any]) -> tuple[Array, Array]:
    """A (3V, 3V) and c (3V,): the gradient of half the weighted squared residuals, A x - c, agents and targets apart.

    Rows of agents see all edges but those between targets; rows of targets see those alone. The study has no
    formations, weights are numbers, and anchors name their axes.
    """
    assert "formations" not in raw
    members = [*raw["agents"], *raw["targets"]]
    index = {m["id"]: v for v, m in enumerate(members)}
    n = [len(m["position"]) for m in members]
    N, size = len(raw["agents"]), 3 * len(members)
    A, c = np.zeros((size, size)), np.zeros(size)
    for kind in ("communication", "sensing", "target_edges"):
        for edge in raw.get(kind, []):
            edge = {"between": edge} if isinstance(edge, list) else edge
            i, j = (index[end] for end in edge["between"])
            F_i, F_j = _maps(edge, members[i], n[i], n[j])
            delta = np.zeros((len(F_i), size))
            delta[:, 3 * i : 3 * i + n[i]] += F_i
            delta[:, 3 * j : 3 * j + n[j]] -= F_j
            b = np.array(edge.get("offset", np.zeros(len(F_i))), dtype=float)
            rows = slice(3 * N, None) if i >= N else slice(3 * N)
            _add(A, c, delta, b, edge.get("weight", 1.0), rows)
    for anchor in raw.get("anchors", []):
        i = index[anchor["agent"]]
        F = np.eye(3)[["xyz".index(a) for a in anchor["axes"]]][:, : n[i]]
        delta = np.zeros((len(F), size))
        delta[:, 3 * i : 3 * i + n[i]] = F
        _add(A, c, delta, np.array(anchor["value"]), anchor.get("weight", 1.0), slice(3 * N))
    return A, c


def _add(A: Array, c: Array, delta: Array, b: Array, weight: float, rows: slice) -> None:
    A[rows] += weight * (delta.T @ delta)[rows]
    c[rows] += weight * (delta.T @ b)[rows]


def _maps(edge: dict[str, Any], tail: dict[str, Any], n_i: int, n_j: int) -> tuple[Array, Array]:
    name = edge.get("map", "shared")
    if isinstance(name, dict):
        return np.array(name["tail"], dtype=float), np.array(name["head"], dtype=float)
    m = min(n_i, n_j)
    R = np.eye(m)
    if name == "local_frame":
        frame = tail.get("frame", {"yaw": tail.get("heading") or 0.0})
        turned = ["yaw", "pitch", "roll"] if m == 3 else ["yaw"]
        angles = [frame.get(angle, 0.0) for angle in turned]
        R = Rotation.from_euler("ZYX"[: len(turned)], angles, degrees=True).as_matrix().T[:m, :m]
    return R @ np.eye(m, n_i), R @ np.eye(m, n_j)


def _field(raw: dict[str, Any], v: int, N: int) -> tuple[Array, list[list[float]]]:
    model = raw.get("flow", {}).get("agents" if v < N else "targets")
    if model is None:
        return np.zeros(3), []
    d = model["dimension"]

    def spatial(p: list[float]) -> list[float]:
        return [*p, 0.0] if d == 2 else list(p)

    core2, space = (model.get("core") or 0.0) ** 2, float(d == 3)
    rows = []
    for k in model.get("sources", []):
        rows.append([SOURCE, space, *spatial(k["centre"]), 0, 0, 0, k["alpha"], core2, 0, 0])
    for k in model.get("vortices", []):
        axis = [0, 0, 1] if d == 2 else k["axis"]
        rows.append([VORTEX, space, *spatial(k["centre"]), *axis, k["gamma"], core2, 0, 0])
    for k in model.get("channels", []):
        axis = np.array(spatial(k["direction"]))
        axis = axis / np.linalg.norm(axis)
        rows.append([CHANNEL, space, *spatial(k["centre"]), *axis, k["beta"], k["width"], k["length"], 0])
    return np.array(spatial(model.get("drift") or [0.0] * d), dtype=float), [r for r in rows if r[8] != 0.0]


def _motions(raw: dict[str, Any], x: Array, n: list[int]) -> dict[str, Any]:
    V, start = len(x), raw["time"].get("start", 0.0)
    arrays: dict[str, Any] = {"pull": np.zeros(V), "origin": x.copy(), "period": np.zeros(V)}
    arrays |= {key: np.zeros((V, 3)) for key in ("amplitude", "rate", "phase")}
    splines: list[PPoly | None] = [None] * V
    N = V - len(raw["targets"])
    for v, target in enumerate(raw["targets"], start=N):
        motion = target.get("motion") or raw.get("target_motion")
        if motion is None:
            continue
        arrays["pull"][v] = motion.get("pull", 1.0 if motion["kind"] == "waypoints" else 0.0)
        if motion["kind"] == "lissajous":
            for key in ("amplitude", "rate", "phase"):
                arrays[key][v, : n[v]] = motion[key]
            arrays["origin"][v] -= arrays["amplitude"][v] * np.sin(arrays["rate"][v] * start + arrays["phase"][v])
        elif motion["kind"] == "waypoints":
            points = [x[v, : n[v]], *map(np.array, motion["points"])]
            points += [points[0]] if motion.get("closed", False) else []
            legs = [float(np.linalg.norm(b - a)) for a, b in pairwise(points)]
            knots = start + np.cumsum([0.0, *legs]) / motion["speed"]
            rest = [(1, np.zeros(n[v])), (2, np.zeros(n[v]))]
            ends: Any = "periodic" if motion.get("closed", False) else (rest, rest)
            splines[v] = _taylor(make_interp_spline(knots, np.array(points), k=5, bc_type=ends))
            arrays["period"][v] = knots[-1] - knots[0] if motion.get("closed", False) else 0.0
    most = max([len(s.x) - 1 for s in splines if s is not None], default=1)
    arrays["pieces"] = np.zeros(V, dtype=np.int64)
    arrays["knots"], arrays["coefficients"] = np.zeros((V, most + 1)), np.zeros((V, most, 6, 3))
    for v, spline in enumerate(splines):
        if spline is not None:
            pieces = len(spline.x) - 1
            arrays["pieces"][v] = pieces
            arrays["knots"][v, : pieces + 1] = spline.x
            arrays["coefficients"][v, :pieces, :, : n[v]] = spline.c.transpose(1, 0, 2)
    return arrays


def _taylor(spline: BSpline) -> PPoly:
    """A quintic spline by its derivatives at its knots."""
    x = np.unique(spline.t[5:-5])  # without the knots beyond both ends
    return PPoly(
        np.array([spline.derivative(5 - j)(x[:-1]) / factorial(5 - j) for j in range(5)] + [spline(x[:-1])]), x
    )


def _harmonics(raw: dict[str, Any], V: int) -> Array:
    if not raw.get("disturbance"):
        return np.zeros((V, 0, 5))
    from mjsheaf.scenario import scenario_from_mapping

    return np.ascontiguousarray(scenario_from_mapping(raw).system.harmonics)
