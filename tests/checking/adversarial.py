"""Scenarios that attack the certificate: what `check` says of them must be so.

`adversarial_scenario(seed)` is a pure function of its seed. Each family aims at one way in which constants of Theorem 1
can be taken from less than what happens. Gains are chosen from lambda_min(H) and a bound on the slopes of the agents'
field, so that a good share of the teams does satisfy the gain condition.

`test_adversarial` holds what the package says of them against an oracle.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.builders import make_fields, turn
from tests.checking.oracle import stiffness

Array = NDArray[np.float64]
Raw = dict[str, Any]
Rng = np.random.Generator

TEAMS = 1000
"""Number of teams of the whole study: 50 of each family."""

_STIFFEST = 6e4  # k1 lambda_max times the span: what an explicit integrator does in a second


def adversarial_scenario(seed: int) -> Raw:
    """The scenario of a seed; `family_of` names what it attacks."""
    name = family_of(seed)
    raw = FAMILIES[name](np.random.default_rng([seed, 11]))
    return {**raw, "name": f"{name}{seed}", "seed": seed}


def family_of(seed: int) -> str:
    """Name of the family of a seed; families take turns."""
    return list(FAMILIES)[seed % len(FAMILIES)]


# -- what families are made of -------------------------------------------------------------------------------------


def _between(rng: Rng, low: float, high: float) -> float:
    """A number between two, evenly in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _channel(centre: list[float], direction: list[float], beta: float, width: float, length: float) -> Raw:
    return {"centre": centre, "direction": direction, "beta": beta, "width": width, "length": length}


def _across(x: float, beta: float, width: float, length: float = 1e5) -> Raw:
    """A jet along y that crosses the axis of x there."""
    return _channel([x, 0.0], [0, 1], beta, width, length)


def _lissajous(amplitude: list[float], rate: list[float], phase: list[float], **pull: float) -> Raw:
    return {"kind": "lissajous", "amplitude": amplitude, "rate": rate, "phase": phase, **pull}


def _slots(raw: Raw) -> NDArray[np.int64]:
    """Places of the agents' coordinates among the rows of A."""
    return np.concatenate([3 * i + np.arange(len(a["position"])) for i, a in enumerate(raw["agents"])])


def _spectrum(raw: Raw) -> tuple[float, float]:
    """lambda_min and lambda_max of H."""
    A, slots = stiffness(raw)[0], _slots(raw)
    found = np.linalg.eigvalsh(A[np.ix_(slots, slots)])
    return float(found[0]), float(found[-1])


def _start_settled(raw: Raw) -> None:
    """Put the agents where e = 0."""
    (A, c), slots, N = stiffness(raw), _slots(raw), len(raw["agents"])
    p = np.concatenate([[*t["position"], 0.0][:3] for t in raw["targets"]])
    q = np.zeros(3 * N)
    q[slots] = np.linalg.solve(A[np.ix_(slots, slots)], (c[: 3 * N] - A[: 3 * N, 3 * N :] @ p)[slots])
    for i, agent in enumerate(raw["agents"]):
        agent["position"] = q[3 * i :][: len(agent["position"])].tolist()


def steepest(flow: Raw | None) -> float:
    """A bound on the norm of a field's Jacobian everywhere: the sum over its kernels, 1/s."""
    if flow is None:
        return 0.0
    core, power = flow.get("core") or 0.0, 2 if flow["dimension"] == 2 else 3
    total = sum(abs(k["alpha"]) / core**power for k in flow.get("sources", []))
    total += sum(abs(k["gamma"]) * np.linalg.norm(k.get("axis", [1.0])) / core**2 for k in flow.get("vortices", []))
    total += sum(0.6066 * abs(k["beta"]) / min(k["width"], k["length"]) for k in flow.get("channels", []))
    return float(total)


def _choose_gain(rng: Rng, raw: Raw, kappa: float, share: tuple[float, float] = (1.1, 4.0)) -> None:
    """Set the gain so that k1 lambda_min is kappa, and more where the agents' field is steep; cut the span if stiff."""
    low, high = _spectrum(raw)
    kappa = max(kappa, 2.0 * steepest(raw.get("flow", {}).get("agents")) * float(rng.uniform(*share)))
    raw["controller"]["gain"] = kappa / low
    start = raw["time"].get("start", 0.0)
    span = min(raw["time"]["end"] - start, _STIFFEST * low / (kappa * high))
    raw["time"]["end"] = start + span
    record = raw["controller"].get("record_period", 0.01)
    raw["controller"]["record_period"] = min(record, span)


def _enlarge(rng: Rng, raw: Raw) -> None:
    """Perhaps let agents without a target follow the first one, in frames of their own, at an offset."""
    first = raw["agents"][0]
    n = len(first["position"])
    raw.setdefault("communication", [])
    for i in range(int(rng.choice([0, 0, 1, 2]))):
        other = raw["agents"][int(rng.integers(len(raw["agents"])))]
        place = rng.uniform(-2, 2, n)
        kind = str(rng.choice(["shared", "local_frame", "matrix"]))
        yaw = float(rng.uniform(-180, 180))
        edge: Raw = {"between": [f"B{i}", other["id"]], "weight": _between(rng, 0.5, 3.0)}
        R = np.eye(n)
        if kind == "matrix":
            R = np.linalg.qr(rng.standard_normal((n, n)))[0]
            edge["map"] = {"tail": R.tolist(), "head": R.tolist()}
        elif kind == "local_frame" and n == 2:
            R = turn(np.deg2rad(yaw)).T
            edge["map"] = "local_frame"
        edge["offset"] = (R @ place).tolist()
        agent = {"id": f"B{i}", "position": (np.array(other["position"]) + place).tolist(), "frame": {"yaw": yaw}}
        raw["agents"].append(agent)
        raw["communication"].append(edge)


def _finish(rng: Rng, raw: Raw, kappa: float, low: float, high: float) -> Raw:
    """Enlarge the team, choose its gain for `kappa` times a number between two, turn and shift all of it."""
    _enlarge(rng, raw)
    _choose_gain(rng, raw, kappa * _between(rng, low, high))
    return _rotate(rng, raw)


def _rotate(rng: Rng, raw: Raw) -> Raw:
    """Turn and shift a planar scenario with nothing but points, directions and drifts in it."""
    R, shift = turn(float(rng.uniform(-np.pi, np.pi))), rng.uniform(-20, 20, 2)
    for member in [*raw["agents"], *raw["targets"]]:
        member["position"] = (R @ member["position"] + shift).tolist()
        motion = member.get("motion", {})
        if "points" in motion:
            motion["points"] = [(R @ p + shift).tolist() for p in motion["points"]]
    for flow in raw.get("flow", {}).values():
        if "drift" in flow:
            flow["drift"] = (R @ flow["drift"]).tolist()
        for kernel in [k for kind in ("sources", "vortices", "channels") for k in flow.get(kind, [])]:
            kernel["centre"] = (R @ kernel["centre"] + shift).tolist()
            if "direction" in kernel:
                kernel["direction"] = (R @ kernel["direction"]).tolist()
    return raw


def _frame_of(rng: Rng, end: float, record: float | None = None) -> Raw:
    """Time and a continuous law, recorded at a random period; sometimes the run starts after t = 0."""
    start = float(rng.choice([0.0, 0.0, 0.0, 7.5, 1000.0]))
    period = record or float(rng.choice([0.005, 0.05, 0.3, 1.0])) * min(end, 10.0) / 10.0
    return {
        "time": {"start": start, "end": start + end},
        "controller": {"gain": 1.0, "control_period": 0, "record_period": period},
    }


def _one_on_one(rng: Rng, end: float, n: int = 2, record: float | None = None) -> Raw:
    """One agent on its one target, both at the origin."""
    frame = _frame_of(rng, end, record)
    edge = {"between": ["A", "T"], "weight": _between(rng, 0.3, 3.0)}
    return make_fields({"A": [0.0] * n}, {"T": [0.0] * n}, [edge], flow={}, **frame)


def _lane(rng: Rng, x: float, y: float, speed: float) -> Raw:
    """A fast lane along x that begins at (x, y)."""
    length = _between(rng, 3.0, 10.0)
    return _channel([x + float(rng.uniform(2.5, 3.2)) * length, y], [1, 0], speed, float(rng.uniform(0.3, 0.9)), length)


# -- families: where the targets go --------------------------------------------------------------------------------


def drifting_across_jets(rng: Rng) -> Raw:
    """A steady current carries the target across a jet, into a lane that it would pass otherwise.

    Attacks an integrator of the targets that lengthens its step in calm water until it steps over the jet.
    """
    U, w = _between(rng, 0.5, 3.0), _between(rng, 0.1, 0.7)
    end = _between(rng, 60.0, 240.0) / U
    raw = _one_on_one(rng, end)
    aside = float(rng.uniform(2.0, 6.0))
    jet = aside * U / (w * np.sqrt(2 * np.pi))
    x = float(rng.uniform(0.2, 0.7)) * U * end
    lane = _lane(rng, x, aside + 0.3 * float(rng.uniform(-1, 1)), float(rng.uniform(1.5, 4.0)) * (jet + U))
    raw["flow"]["targets"] = {"dimension": 2, "drift": [U, 0.0], "channels": [_across(x, jet, w), lane]}
    return _finish(rng, raw, lane["beta"] / lane["length"], 0.5, 3.0)


def swinging_across_jets(rng: Rng) -> Raw:
    """A target on a Lissajous path crosses a jet that carries it off for good, towards a lane.

    Attacks steps of the order of the motion's own period, which is long against the time in the jet.
    """
    A, rate, w = _between(rng, 15, 80), _between(rng, 0.05, 1.0), _between(rng, 0.1, 0.3)
    raw = _one_on_one(rng, np.pi / rate)
    raw["time"] = {"end": np.pi / rate * float(rng.uniform(0.8, 1.3))}
    motion = _lissajous([A, 0.0], [rate, 0.0], [-np.pi / 2, 0.0])
    raw["targets"][0] |= {"position": [-A, 0.0], "motion": motion}
    raw["agents"][0]["position"] = [-A, 0.0]
    x = float(rng.uniform(-0.7, 0.2)) * A
    speed = rate * np.sqrt(A**2 - x**2)
    aside = float(rng.uniform(2.0, 5.0))
    jet = aside * speed / (w * np.sqrt(2 * np.pi))
    lane = _lane(rng, x, aside + 0.3 * float(rng.uniform(-1, 1)), float(rng.uniform(1.5, 4.0)) * (jet + speed))
    raw["flow"]["targets"] = {"dimension": 2, "channels": [_across(x, jet, w), lane]}
    _enlarge(rng, raw)
    _choose_gain(rng, raw, lane["beta"] / lane["length"] * _between(rng, 0.5, 3.0))
    return raw


def gathering_across_jets(rng: Rng) -> Raw:
    """Targets that gather by a slow consensus cross a jet on the way.

    Attacks steps of the order of the consensus' time constant.
    """
    g, w, D = _between(rng, 0.02, 0.5), _between(rng, 0.1, 0.3), _between(rng, 40, 200)
    raw = _frame_of(rng, float(rng.uniform(1.0, 2.5)) / g)
    raw["agents"] = [{"id": "A", "position": [D, 0.0]}]
    raw["targets"] = [{"id": "T", "position": [D, 0.0]}, {"id": "R", "position": [0.0, 0.0]}]
    raw["sensing"] = [["A", "T"], {"between": ["A", "R"], "weight": 1e-3}]
    raw["target_edges"] = [["T", "R"]]
    raw["target_formation"] = {"gain": g}
    x = float(rng.uniform(0.7, 0.95)) * D
    speed = g * (2 * x - D)
    aside = float(rng.uniform(2.0, 6.0))
    jet = aside * speed / (w * np.sqrt(2 * np.pi))
    lane = _lane(rng, 0.0, aside + 0.3 * float(rng.uniform(-1, 1)), -float(rng.uniform(1.5, 4.0)) * (jet + speed))
    lane["length"] = 0.07 * (x - 0.5 * D) + 1.0
    lane["centre"][0] = x - float(rng.uniform(2.5, 3.2)) * lane["length"]
    raw["flow"] = {"targets": {"dimension": 2, "channels": [_across(x, jet, w), lane]}}
    _start_settled(raw)
    return _finish(rng, raw, -lane["beta"] / lane["length"], 0.3, 2.0)


def gathering_at_once(rng: Rng) -> Raw:
    """A consensus of targets that is over within milliseconds, and at the start does not move q*.

    Attacks samples of f_B: 0 at the first, 0 at the second, enormous between them, so that q* jumps.
    """
    M = int(rng.integers(3, 6))
    n = int(rng.choice([2, 3]))
    ids = [f"T{k}" for k in range(M)]
    L = np.zeros((M, M))
    edges = []
    for k in range(1, M):
        for j in {int(rng.integers(k)), *(int(j) for j in range(k) if rng.random() < 0.2)}:
            weight = _between(rng, 0.5, 2.0)
            edges.append({"between": [ids[k], ids[j]], "weight": weight})
            delta = np.eye(M)[k] - np.eye(M)[j]
            L += weight * np.outer(delta, delta)
    weights = np.exp(rng.uniform(np.log(0.2), np.log(5.0), M))
    normal = L @ weights
    p = rng.uniform(-20, 20, (M, n))
    p -= np.outer(normal, normal @ p) / (normal @ normal)  # sum_k w_k (L p)_k = 0
    raw = _frame_of(rng, _between(rng, 2.0, 60.0))
    slowest = float(np.linalg.eigvalsh(L)[1])
    end = raw["time"]["end"] - raw["time"]["start"]
    gain = min(_between(rng, 1e2, 1e4), 2e4 / (end * float(np.linalg.eigvalsh(L)[-1])))
    raw |= {
        "agents": [{"id": "A", "position": [0.0] * n}],
        "targets": [{"id": t, "position": p[k].tolist()} for k, t in enumerate(ids)],
        "sensing": [{"between": ["A", t], "weight": float(weights[k])} for k, t in enumerate(ids)],
        "target_edges": edges,
        "target_formation": {"gain": gain},
        "flow": {},
    }
    if rng.random() < 0.3:  # with something to do afterwards
        raw["flow"]["targets"] = {"dimension": n, "drift": rng.uniform(-1, 1, n).tolist()}
    _start_settled(raw)
    if n == 2:
        _enlarge(rng, raw)
    _choose_gain(rng, raw, _between(rng, 0.3, min(3.0, 0.1 * gain * slowest)))
    return raw


def circling_in_step(rng: Rng) -> Raw:
    """A target inside the core of a vortex turns once, or a few times, between any two of 400 samples.

    Attacks samples that all see the same phase: f_B is 0 there, since the agents' drift is the target's velocity at
    that phase, and twice that half a turn later. Distances between samples are small; so are chords.
    """
    core, turns = _between(rng, 0.2, 5.0), 400
    end = _between(rng, 1.0, 20.0)
    rate = 2 * np.pi * turns / end * (1.0 + float(rng.choice([-1, 1])) * _between(rng, 1e-8, 1e-5))
    r = float(rng.uniform(0.02, 0.2)) * core
    raw = _one_on_one(rng, end, record=end / float(rng.choice([50, 400, 1000])))
    raw["targets"][0]["position"] = [r, 0.0]
    raw["agents"][0]["position"] = [r, 0.0]
    vortex = {"centre": [0.0, 0.0], "gamma": rate * (r**2 + core**2)}
    raw["flow"] = {
        "targets": {"dimension": 2, "core": core, "vortices": [vortex]},
        "agents": {"dimension": 2, "drift": [0.0, rate * r]},
    }
    _enlarge(rng, raw)
    _choose_gain(rng, raw, _between(rng, 2.0, 20.0) / end)
    return _rotate(rng, raw)


def circling_a_tight_vortex(rng: Rng) -> Raw:
    """A target circles a vortex hundreds of times while a source widens its circle, until it meets a jet or a lane.

    Attacks the error of a long integration, and a resolution that follows the span instead of the turning.
    """
    core, r = _between(rng, 0.05, 0.3), float(rng.uniform(0.5, 2.0))
    rate = _between(rng, 3.0, 60.0)
    end = float(rng.uniform(60, 150)) * 2 * np.pi / rate
    raw = _one_on_one(rng, end)
    raw["targets"][0]["position"] = raw["agents"][0]["position"] = [r, 0.0]
    widen = float(rng.uniform(0.0, 3.0)) / end
    x, beta = r + float(rng.uniform(0.5, 2.0)), rate * r * float(rng.uniform(0.2, 3.0))
    raw["flow"]["targets"] = {
        "dimension": 2,
        "core": core,
        "vortices": [{"centre": [0.0, 0.0], "gamma": rate * r**2}],
        "sources": [{"centre": [0.0, 0.0], "alpha": widen * r}],
        "channels": [_across(x, beta, _between(rng, 0.1, 0.5), 2.0)],
    }
    if rng.random() < 0.5:
        raw["flow"]["agents"] = {"dimension": 2, "channels": [_channel([r, 0.0], [1, 0], 1.0, 1.0, 3.0)]}
    return _finish(rng, raw, rate, 0.3, 3.0)


def past_small_cores(rng: Rng) -> Raw:
    """Targets drift at speed past sources and vortices whose cores are centimetres wide.

    Attacks peaks of f_B that last milliseconds, and paths that a near miss bends.
    """
    n = int(rng.choice([2, 3]))
    core, U = _between(rng, 0.01, 0.2), _between(rng, 1.0, 20.0)
    raw = _one_on_one(rng, 40.0 / U, n)
    flow: Raw = {"dimension": n, "core": core, "drift": [U, *[0.0] * (n - 1)], "sources": [], "vortices": []}
    for _ in range(int(rng.integers(1, 5))):
        miss = (core * rng.standard_normal(n - 1) * float(rng.choice([0.5, 3.0]))).tolist()
        centre = [float(rng.uniform(3, 35)), *miss]
        strength = float(rng.choice([-1, 1])) * U * core * float(rng.uniform(0.05, 0.6))
        if rng.random() < 0.5:
            flow["sources"].append({"centre": centre, "alpha": strength * (core if n == 3 else 1.0)})
        else:
            axis = {"axis": rng.standard_normal(3).tolist()} if n == 3 else {}
            flow["vortices"].append({"centre": centre, "gamma": strength, **axis})
    raw["flow"]["targets"] = flow
    _choose_gain(rng, raw, _between(rng, 0.3, 10.0))
    return raw


def splitting_at_a_saddle(rng: Rng) -> Raw:
    """A current carries the target past a source, close to the line on which it would stop; one side has a jet.

    Attacks errors of the path that the flow itself enlarges: a millionth of a metre decides on which side it passes.
    """
    core, U = _between(rng, 0.1, 0.5), _between(rng, 0.5, 2.0)
    alpha = U * core * float(rng.uniform(0.4, 3.0))
    raw = _one_on_one(rng, 60.0 / U)
    beside = float(rng.choice([-1, 1])) * _between(rng, 1e-5, 1e-2)
    raw["targets"][0]["position"] = raw["agents"][0]["position"] = [0.0, beside]
    jet = _channel([20.0, 1.5], [1, 0], 10.0 * U, 0.3, 5.0)
    raw["flow"]["targets"] = {
        "dimension": 2,
        "core": core,
        "drift": [U, 0.0],
        "sources": [{"centre": [10.0, 0.0], "alpha": alpha}],
        "channels": [jet] if rng.random() < 0.7 else [],
    }
    return _finish(rng, raw, 1.0, 0.3, 5.0)


def fast_lissajous(rng: Rng) -> Raw:
    """Lissajous figures of incommensurable, high frequencies, in a field with cores; pulls to 1e3.

    Attacks caps on the number of samples, and a pull that makes the path stiff.
    """
    n = int(rng.choice([2, 3]))
    fastest = _between(rng, 10.0, 1000.0)
    end = _between(rng, 20.0, 80.0) * 2 * np.pi / fastest
    raw = _one_on_one(rng, end, n)
    amplitude = rng.uniform(0.1, 2.0, n) * min(1.0, 50.0 / fastest)
    rate = fastest * rng.uniform(0.3, 1.0, n)
    phase = rng.uniform(0, 6, n)
    pull = float(rng.choice([0.0, 1.0, 1e2, 1e3]))
    raw["targets"][0]["motion"] = _lissajous(amplitude.tolist(), rate.tolist(), phase.tolist(), pull=pull)
    flow: Raw = {
        "dimension": n,
        "core": _between(rng, 0.2, 1.0),
        "sources": [{"centre": rng.uniform(-3, 3, n).tolist(), "alpha": float(rng.uniform(-1, 1))}],
    }
    raw["flow"] = {"targets": flow}
    if rng.random() < 0.5:
        raw["flow"]["agents"] = flow
    _choose_gain(rng, raw, _between(rng, 1.0, fastest))
    return raw


def sharp_corners(rng: Rng) -> Raw:
    """Waypoint paths with legs from centimetres to tens of metres, which turn back sharply and overshoot.

    Attacks boxes and speeds taken from waypoints, and samples that count pieces instead of speeds.
    """
    n = int(rng.choice([2, 3]))
    raw = _one_on_one(rng, 1.0, n)
    place, points = np.zeros(n), []
    for _ in range(int(rng.integers(2, 9))):
        direction = rng.standard_normal(n)
        place = place + direction / np.linalg.norm(direction) * _between(rng, 0.2, 20.0)
        points.append(place.tolist())
    length = float(np.linalg.norm(np.diff(np.array([np.zeros(n), *points]), axis=0), axis=1).sum())
    speed = _between(rng, 1.0, 10.0)
    raw["time"] = {"end": length / speed * float(rng.uniform(0.7, 1.5))}
    raw["controller"]["record_period"] = raw["time"]["end"] * float(rng.choice([0.003, 0.05, 1.0]))
    raw["targets"][0]["motion"] = {
        "kind": "waypoints",
        "points": points,
        "speed": speed,
        "closed": bool(rng.random() < 0.4),
        "pull": float(rng.choice([0.0, 1.0, 100.0])),
    }
    middle = np.mean(points, axis=0)
    channels = []
    for _ in range(int(rng.integers(0, 4))):
        centre, direction = middle + rng.uniform(-10, 10, n), rng.standard_normal(n)
        sizes = float(rng.uniform(0.5, 3.0)), _between(rng, 0.3, 3.0), _between(rng, 3.0, 30.0)
        channels.append(_channel(centre.tolist(), direction.tolist(), *sizes))
    flow = {"dimension": n, "channels": channels}
    raw["flow"] = {"targets": flow, "agents": flow}
    _choose_gain(rng, raw, _between(rng, 0.5, 5.0), share=(0.5, 3.0))
    return raw


def long_spans(rng: Rng) -> Raw:
    """Hours of drifting, with a far jet; some are too long to follow, with a disturbance that forbids long steps.

    Attacks a path that is given up, and steps that grow over hours.
    """
    U, w = _between(rng, 0.01, 0.2), _between(rng, 0.5, 5.0)
    fast = rng.random() < 0.06
    end = _between(rng, 60.0, 120.0) if fast else _between(rng, 500.0, 4000.0)
    raw = _one_on_one(rng, end, record=end / 500)
    x = float(rng.uniform(0.2, 0.6)) * U * end
    aside = float(rng.uniform(3, 20))
    beta = aside * U / w
    lane = _lane(rng, x, 2 * aside, 30.0 * U + 3.0 * beta)
    raw["flow"]["targets"] = {"dimension": 2, "drift": [U, 0.0], "channels": [_across(x, beta, w, 1e6), lane]}
    if fast:
        raw["disturbance"] = {"agents": {"bound": 0.01, "frequencies": [40.0, 60.0], "components": 2}}
    elif rng.random() < 0.5:
        raw["disturbance"] = {"agents": {"bound": 0.002, "components": 2}}
    return _finish(rng, raw, lane["beta"] / lane["length"], 1.0, 10.0)


# -- families: where the agents go ---------------------------------------------------------------------------------


def _trap(rng: Rng, raw: Raw, x: float, kappa: float, speed: float) -> None:
    """Jets next to a path along x. An agent reaches them only if a wide, flat channel displaces it.

    The flat channel's slopes allow the gain, those of the jets do not, and lie outside of a box about the path.
    """
    unit = float(rng.uniform(0.9, 1.1))
    flat = kappa * unit * float(rng.uniform(0.45, 0.75))
    strength = kappa * float(rng.uniform(40, 120))
    high = flat / kappa * min(1.0, 2.0 * unit * kappa / speed) + 0.3 * unit * float(rng.uniform(0.8, 1.2))
    places = [(high, 0.12), (high + 1.4 * unit, 0.5), (high + 4.4 * unit, 0.9)]
    jets = [_channel([x, y], [0, 1], strength, unit, long * unit) for y, long in places[: int(rng.integers(2, 4))]]
    raw["flow"]["agents"] = {"dimension": 2, "channels": [_across(x, flat, unit, 1e6), *jets]}


def flung_between_records(rng: Rng) -> Raw:
    """Records fall on the agent's turning points only, where it stands still; jets fling it between them.

    Attacks a box of the agents that is taken from what is recorded.
    """
    A, rate = float(rng.uniform(4, 7)), _between(rng, 0.3, 1.5)
    period = 2 * np.pi / rate
    kappa = rate * float(rng.uniform(5.0, 9.0))
    raw = _one_on_one(rng, 6 * period, record=period * float(rng.choice([1.0, 1.0, 2.0, 0.01])))
    raw["time"] = {"end": 6 * period}
    phase = np.pi / 2 + np.arctan(rate / kappa)
    begin = A * float(np.sin(phase))
    motion = _lissajous([A, 0.0], [rate, 0.0], [float(phase), 0.0])
    raw["targets"][0] |= {"position": [begin, 0.0], "motion": motion}
    raw["agents"][0]["position"] = [begin, 0.0]
    _trap(rng, raw, float(rng.uniform(-0.6, 0.6)) * A, kappa, rate * A)
    raw["controller"]["gain"] = kappa / _spectrum(raw)[0]
    return raw


def flung_on_the_way(rng: Rng) -> Raw:
    """A target goes from rest to rest while nothing is recorded; its agent is flung aside in between.

    Attacks a thin box about the path, and speeds of agents that are read where they stand.
    """
    D, speed = float(rng.uniform(15, 30)), _between(rng, 0.5, 3.0)
    kappa = speed * float(rng.uniform(1.2, 3.0))
    end = D / speed + 15.0 / kappa
    raw = _one_on_one(rng, end, record=end * float(rng.choice([1.0, 1.0, 1.0, 0.003])))
    raw["time"] = {"end": end}
    raw["targets"][0]["motion"] = {"kind": "waypoints", "points": [[D, 0.0]], "speed": speed}
    _trap(rng, raw, float(rng.uniform(0.4, 0.6)) * D, kappa, 1.875 * speed)
    if rng.random() < 0.3:  # a gain that the jets allow
        _choose_gain(rng, raw, kappa, share=(1.05, 1.5))
        raw["controller"]["record_period"] = min(raw["controller"]["record_period"], raw["time"]["end"])
    else:
        raw["controller"]["gain"] = kappa / _spectrum(raw)[0]
    return raw  # not turned: a box about a path along x is thin


def far_starts(rng: Rng) -> Raw:
    """Agents start hundreds of metres off, or exactly where they belong, and cross jets and cores in their transient.

    Attacks boxes and constants that do not reach from the start to q*; and the first instants.
    """
    n = int(rng.choice([2, 3]))
    raw = _one_on_one(rng, 1.0, n)
    far = float(rng.choice([0.0, 1.0])) * _between(rng, 10.0, 1000.0)
    away = rng.standard_normal(n)
    away *= far / np.linalg.norm(away)
    raw["agents"][0]["position"] = away.tolist()
    channels = []
    for _ in range(int(rng.integers(1, 4))):
        centre, direction = away * float(rng.uniform(0, 1)), rng.standard_normal(n)
        sizes = float(rng.uniform(0.5, 5.0)), _between(rng, 0.1, 1.0), _between(rng, 1.0, 1e3)
        channels.append(_channel(centre.tolist(), direction.tolist(), *sizes))
    vortex = {"centre": (away * float(rng.uniform(0, 1))).tolist(), "gamma": float(rng.uniform(-1, 1))}
    if n == 3:
        vortex["axis"] = rng.standard_normal(3).tolist()
    flow = {"dimension": n, "core": _between(rng, 0.2, 1.0), "channels": channels, "vortices": [vortex]}
    raw["flow"] = {"agents": flow}
    kappa = 2.2 * steepest(flow)
    raw["time"] = {"end": 30.0 / kappa}
    raw["controller"]["record_period"] = 30.0 / kappa * float(rng.choice([0.003, 0.1, 0.5]))
    amplitude, rate, phase = rng.uniform(0, 2, n), kappa * rng.uniform(0.05, 1.0, n), rng.uniform(0, 6, n)
    raw["targets"][0]["motion"] = _lissajous(amplitude.tolist(), rate.tolist(), phase.tolist())
    _choose_gain(rng, raw, 0.1, share=(0.6, 3.0))
    return raw


# -- families: the sheaf -------------------------------------------------------------------------------------------


def _network(
    rng: Rng, N: int, M: int, dimensions: list[int], weights: tuple[float, float], maps: bool, near: float = 0.2
) -> Raw:
    """A random connected team whose every target is sensed; spatial agents have an altimeter."""
    agents, targets = [f"A{i}" for i in range(N)], [f"T{k}" for k in range(M)]
    n = {name: int(rng.choice(dimensions)) for name in agents + targets}

    def edge(tail: str, head: str) -> Raw:
        found: Raw = {"between": [tail, head], "weight": _between(rng, *weights)}
        kind = str(rng.choice(["shared", "local_frame", "matrix"])) if maps else "shared"
        m = min(n[tail], n[head])
        if kind == "matrix":
            turn = np.linalg.qr(rng.standard_normal((m, m)))[0]
            F = [turn @ (np.eye(m, n[v]) + near * rng.standard_normal((m, n[v]))) for v in (tail, head)]
            found["map"] = {"tail": F[0].tolist(), "head": F[1].tolist()}
            found["offset"] = rng.uniform(-2, 2, m).tolist()
        else:
            found["map"] = kind
        return found

    raw = _frame_of(rng, 4.0)
    raw["agents"] = []
    for a in agents:
        place, frame = rng.uniform(-5, 5, n[a]), rng.uniform(-180, 180, 3)
        angles = dict(zip(("roll", "pitch", "yaw"), frame.tolist(), strict=True))
        raw["agents"].append({"id": a, "position": place.tolist(), "frame": angles})
    raw["targets"] = [{"id": t, "position": rng.uniform(-5, 5, n[t]).tolist()} for t in targets]
    raw["communication"] = [edge(agents[i], agents[int(rng.integers(i))]) for i in range(1, N)]
    raw["communication"] += [edge(a, b) for a in agents for b in agents if a < b and rng.random() < 0.2]
    raw["sensing"] = [edge(agents[int(rng.integers(N))], t) for t in targets]
    raw["sensing"] += [edge(a, t) for a in agents for t in targets if rng.random() < 0.4]
    raw["target_edges"] = [edge(a, b) for a in targets for b in targets if a < b and rng.random() < 0.7]
    anchors = [
        {"agent": a, "axes": ["z"], "value": [1.0], "weight": _between(rng, *weights)} for a in agents if n[a] == 3
    ]
    raw |= {"anchors": anchors, "flow": {}}
    return raw


def _moving(rng: Rng, raw: Raw, fastest: float) -> None:
    for target in raw["targets"]:
        n = len(target["position"])
        amplitude, rate, phase = rng.uniform(0, 2, n), fastest * rng.uniform(0.05, 1.0, n), rng.uniform(0, 6, n)
        pull = float(rng.choice([0.0, 0.5, 50.0]))
        target["motion"] = _lissajous(amplitude.tolist(), rate.tolist(), phase.tolist(), pull=pull)


def unlike_weights(rng: Rng) -> Raw:
    """Weights from 1e-3 to 1e3.

    Attacks lambda_min, and constants that are right only where H is well conditioned.
    """
    spread = float(rng.choice([10.0, 100.0, 1000.0]))
    raw = _network(rng, int(rng.integers(1, 6)), int(rng.integers(1, 4)), [2], (1 / spread, spread), maps=False)
    _moving(rng, raw, 5.0)
    for target in raw["targets"]:
        target["motion"]["pull"] = 0.0
    raw["target_formation"] = {"gain": _between(rng, 0.01, 1.0) / spread}
    if rng.random() < 0.5:
        raw["flow"]["agents"] = {"dimension": 2, "channels": [_channel([0, 0], [1, 1], 0.5, 1.5, 4.0)]}
    if rng.random() < 0.5:
        _start_settled(raw)
    _choose_gain(rng, raw, _between(rng, 1.0, 10.0))
    return raw


def unlike_frames(rng: Rng) -> Raw:
    """Mixed dimensions, frames that turn, maps at random, targets' consensus with gains to 1e3 through such maps.

    Attacks B, c and offsets in f_B, and a target Laplacian that is not a graph's.
    """
    raw = _network(rng, int(rng.integers(1, 6)), int(rng.integers(1, 4)), [2, 3], (0.5, 2.0), maps=True)
    _moving(rng, raw, _between(rng, 1.0, 20.0))
    raw["target_formation"] = {"gain": _between(rng, 0.05, 1000.0)}
    d = int(rng.choice([2, 3]))
    flow: Raw = {
        "dimension": d,
        "core": _between(rng, 0.5, 3.0),
        "drift": rng.uniform(-0.5, 0.5, d).tolist(),
        "sources": [{"centre": rng.uniform(-4, 4, d).tolist(), "alpha": float(rng.uniform(-1, 1))}],
    }
    raw["flow"] = {"agents": flow, "targets": flow}
    if rng.random() < 0.5:
        raw["disturbance"] = {
            who: {"bound": _between(rng, 1e-4, 0.3), "frequencies": [0.1, 20.0], "components": 3}
            for who in ("agents", "targets")
        }
    _choose_gain(rng, raw, _between(rng, 0.5, 10.0))
    return raw


def limited_speed(rng: Rng) -> Raw:
    """Speed limits near the commanded speeds, on an agent or on all; effectiveness that turns with place and time.

    Attacks a bound of the unlimited law where a limit acts.
    """
    raw = _network(rng, int(rng.integers(1, 4)), 1, [2], (0.5, 2.0), maps=True, near=0.05)
    _moving(rng, raw, 1.0)
    _start_settled(raw)
    for agent in raw["agents"]:
        agent["position"] = (np.array(agent["position"]) + _between(rng, 1e-3, 3.0) * rng.standard_normal(2)).tolist()
    if rng.random() < 0.5:
        raw["agents"][0]["effectiveness"] = {
            "layout": [[1.0, 0.0, 0.5], [0.0, 1.0, -0.5]],
            "heading": 30.0,
            "heading_gradient": [20.0, -40.0],
            "heading_rate": 100.0,
        }
    _choose_gain(rng, raw, _between(rng, 1.0, 8.0))
    asked = raw["controller"]["gain"] * _spectrum(raw)[1] * _between(rng, 0.1, 30.0)
    if rng.random() < 0.5:
        raw["controller"]["velocity_limit"] = asked
    else:
        raw["agents"][-1]["velocity_limit"] = asked
    return raw


# -- families: where nothing may be claimed ------------------------------------------------------------------------


def held_targets(rng: Rng) -> Raw:
    """A hold that the agents survive and the targets' consensus or pull does not: gain h lambda near and above 2."""
    h = _between(rng, 0.01, 0.1)
    raw = _frame_of(rng, float(rng.uniform(40, 100)) * h)
    raw["controller"] = {"gain": 1.0, "control_period": h}
    product = float(rng.uniform(1.5, 2.6))
    raw["agents"] = [{"id": "A", "position": [10.0, 5.0]}]
    raw["targets"] = [{"id": "T", "position": [9.0, 5.0]}, {"id": "R", "position": [12.0, 5.0]}]
    raw["sensing"] = [{"between": ["A", "T"], "weight": float(rng.uniform(0.5, 3.0))}, ["A", "R"]]
    raw["target_edges"] = [["T", "R"]]
    if rng.random() < 0.5:
        raw["target_formation"] = {"gain": product / (2 * h)}
    else:
        raw["target_formation"] = {"gain": 0.01 / h}
        raw["flow"] = {"targets": {"dimension": 2, "drift": [0.01, 0.0]}}
        raw["targets"][0]["motion"] = {"kind": "static", "pull": product / h}
    _, high = _spectrum(raw)
    raw["controller"]["gain"] = float(rng.uniform(0.05, 0.5)) / (h * high)
    return raw


def beside_singularities(rng: Rng) -> Raw:
    """Kernels without a core close to the path of a target, an agent or q*: a collapse, or a narrow escape."""
    raw = _one_on_one(rng, 10.0)
    miss = float(rng.choice([0.0, 1.0])) * _between(rng, 1e-4, 1.0)
    alpha = float(rng.choice([-1, 1])) * _between(rng, 1e-3, 1.0)
    U = _between(rng, 0.5, 5.0)
    raw["time"] = {"end": 30.0 / U}
    raw["controller"] |= {"record_period": 0.1 / U, "gain": float(rng.uniform(0.5, 5.0))}
    kind = {"sources": [{"centre": [15.0, miss], "alpha": alpha}]}
    if rng.random() < 0.3:
        kind = {"vortices": [{"centre": [15.0, miss], "gamma": alpha}]}
    whom = str(rng.choice(["agents", "targets"]))
    drift = [U, 0.0] if whom == "targets" or rng.random() < 0.5 else [0.0, 0.0]
    raw["flow"][whom] = {"dimension": 2, "core": 0, "drift": drift, **kind}
    if drift == [0.0, 0.0]:
        raw["targets"][0]["motion"] = {"kind": "waypoints", "points": [[30.0, 0.0]], "speed": U}
    return raw


def reported_cases(rng: Rng) -> Raw:
    """The cases of the first attack, as they were reported, and with the numbers moved a little."""
    raw = REPORTED[int(rng.integers(len(REPORTED)))]()
    if rng.random() < 0.6:
        raw["controller"]["gain"] *= float(rng.uniform(0.97, 1.03))
        for flow in raw.get("flow", {}).values():
            for channel in flow.get("channels", []):
                channel["beta"] *= float(rng.uniform(0.98, 1.02))
    return raw


def _pair(end: float, gain: float, period: float = 0, record: float = 0.01) -> Raw:
    law = {"gain": gain, "control_period": period, "record_period": record}
    return make_fields({"A1": [0.0, 0.0]}, {"T1": [0.0, 0.0]}, [["A1", "T1"]], time={"end": end}, controller=law)


def _stiff() -> Raw:
    return make_fields(
        {"A1": [-8, 0]},
        {"T1": [-20, 0], "T2": [-20, 0], "T3": [40, 0]},
        [{"between": ["A1", "T1"], "weight": 3}, ["A1", "T2"], ["A1", "T3"]],
        time={"end": 2},
        controller={"gain": 1, "control_period": 0},
        target_edges=[["T1", "T2"], ["T2", "T3"]],
        target_formation={"gain": 1.0e4},
    )


def _records(period: float) -> Raw:
    x, phase = 4.9394335096009065, 1.7266028267644382
    raw = _pair(60, 4, record=period)
    raw["agents"][0]["position"] = [x, 0]
    raw["targets"][0] |= {"position": [x, 0], "motion": _lissajous([5, 0], [0.6283185307179586, 0], [phase, 0])}
    jets = [(0, 2, 1.0e6), (0.8, 200, 0.12), (2.2, 200, 0.5)]
    channels = [_channel([-2, y], [0, 1], beta, 1, length) for y, beta, length in jets]
    return {**raw, "flow": {"agents": {"dimension": 2, "channels": channels}}}


def _jets() -> Raw:
    jet = _channel([16.749147005160673, 0], [0, 1], 2.1769816073801875, 0.7385330151472779, 1.0e5)
    centre = [36.74914700516067, 3.934966245565401]
    lane = _channel(centre, [1, 0], 9.239669611007042, 0.5447501259444556, 7.297914759997795)
    flow = {"targets": {"dimension": 2, "drift": [1, 0], "channels": [jet, lane]}}
    return {**_pair(120, 1.4765173430324394, record=0.05), "flow": flow}


def _singular_guess() -> Raw:
    flow = {"dimension": 2, "core": 0, "drift": [50, 0], "sources": [{"centre": [30, 0], "alpha": -1}]}
    return {**_pair(10, 1.0, period=0.01), "flow": {"agents": flow}}


def _targets_hold() -> Raw:
    return make_fields(
        {"A1": [10, 5]},
        {"T1": [9, 5], "T2": [12, 5]},
        [{"between": ["A1", "T1"], "weight": 2}, ["A1", "T2"]],
        time={"end": 4},
        controller={"gain": 2, "control_period": 0.05},
        target_edges=[["T1", "T2"]],
        target_formation={"gain": 22},
    )


def _frozen_target() -> Raw:
    flow = {"targets": {"dimension": 2, "drift": [0.01, 0], "channels": [_across(60, 50, 5, 1.0e6)]}}
    return {**_pair(12000, 1.0, record=1.0), "flow": flow, "disturbance": {"agents": {"bound": 0.01}}}


def _tiny_position() -> Raw:
    raw = _pair(1, 1.0, period=0.01)
    raw["agents"][0]["position"], raw["targets"][0]["position"] = [1e-16, 0.0], [1.0, 0.0]
    return raw


def _target_sink() -> Raw:
    raw = _pair(2, 1.0, period=0.01)
    raw["agents"][0]["position"] = [1.0, 1.0]
    raw["targets"][0] |= {"position": [3.0, 3.0], "motion": {"kind": "static", "pull": 1}}
    flow = {"dimension": 2, "core": 0, "sources": [{"centre": [3.01, 3], "alpha": -0.001}]}
    return {**raw, "flow": {"targets": flow}}


REPORTED: tuple[Callable[[], Raw], ...] = (
    _stiff,
    lambda: _records(10.0),
    lambda: _records(0.01),
    *(_jets, _singular_guess, _targets_hold, _frozen_target, _tiny_position, _target_sink),
)
"""Findings of the first attack: stiff targets, records (coarse, fine), jets, a sink in the agents' way, held
targets, a span too long to follow, a start at 1e-16 m, a sink beside a target."""

_FAMILIES = (
    drifting_across_jets, swinging_across_jets, gathering_across_jets, gathering_at_once, circling_in_step,
    circling_a_tight_vortex, past_small_cores, splitting_at_a_saddle, fast_lissajous, sharp_corners, long_spans,
    flung_between_records, flung_on_the_way, far_starts, unlike_weights, unlike_frames, limited_speed, held_targets,
    beside_singularities, reported_cases,
)  # fmt: skip
FAMILIES: dict[str, Callable[[Rng], Raw]] = {family.__name__: family for family in _FAMILIES}
