"""A run as an xarray Dataset with CF attributes: what result.nc holds."""

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf._version import __version__
from mjsheaf.control.law import limited_commands
from mjsheaf.results.metrics import evaluate_errors
from mjsheaf.simulation.ideal import inputs
from mjsheaf.simulation.trajectory import Trajectory
from mjsheaf.system import System
from mjsheaf.team.null_modes import describe_null_modes

Array = NDArray[np.float64]
Variable = tuple[str | tuple[str, ...], NDArray[Any], dict[str, str]]
"""Dimensions, values and attributes, as xarray takes them."""


def make_dataset(system: System, trajectory: Trajectory, backend: str, seed: int) -> xr.Dataset:
    """Gather a trajectory, its errors and its commands.

    Args:
        system: what was simulated.
        trajectory: what came out, or a piece of it.
        backend: 'ideal' or 'physics'.
        seed: seed of the scenario.

    Returns:
        Variables over the dimensions time, agent, target and axis; see README for the list. Attributes name the
        scenario, backend, status and groups.
    """
    return next(make_datasets(system, [trajectory], backend, seed))


def make_datasets(system: System, pieces: Iterable[Trajectory], backend: str, seed: int) -> Iterator[xr.Dataset]:
    """Gather a trajectory that comes in pieces, each as `make_dataset` does; the last piece has the run's status."""
    attributes = _attributes(system, backend, seed)
    thrusters = _thrusters(system) if backend == "physics" else []
    for piece in pieces:
        if len(piece.time):
            dataset = _gather(system, piece, thrusters)
        else:  # the run blew up right after the piece before
            dataset = dataset.isel(time=slice(0, 0)).copy(deep=True)
        dataset.attrs = attributes | {"status": piece.status, "message": piece.message}
        yield dataset


def join(pieces: Iterable[xr.Dataset]) -> xr.Dataset:
    """The dataset of a whole run from those of its pieces."""
    parts = list(pieces)
    if len(parts) == 1:
        return parts[0]
    whole = parts[-1].isel(time=slice(0, 0))
    joined = {
        name: (variable.dims, np.concatenate([part[name].values for part in parts]), variable.attrs)
        for name, variable in whole.variables.items()
        if "time" in variable.dims
    }
    rest = whole.drop_dims("time")
    return xr.Dataset(
        {str(n): joined[n] if n in joined else rest[n] for n in whole.data_vars},
        {str(n): joined[n] if n in joined else rest[n] for n in whole.coords},
        whole.attrs,
    )


def _gather(system: System, trajectory: Trajectory, thrusters: list[list[str]]) -> xr.Dataset:
    team = system.team
    N = len(team.agents)
    errors = evaluate_errors(team, trajectory.positions)
    padded = team.unpack(team.pack(trajectory.positions), np.nan)
    velocity = limited_commands(-system.gain * errors.disagreement, system.law.limit[:N])
    groups = [f.name for f in team.formations]

    # Gathered first: a dataset that grows variable by variable aligns all of them each time.
    variables: dict[str, Variable] = {}
    coordinates: dict[str, Variable] = {
        "time": ("time", trajectory.time, {"long_name": "time", "units": "s"}),
        "agent": _labels("agent", team.agent_ids, "agent"),
        "target": _labels("target", team.target_ids, "target"),
        "axis": _labels("axis", ["x", "y", "z"], "axis of the world frame"),
    }

    def add(name: str, dims: tuple[str, ...], values: Array, units: str, long_name: str) -> None:
        variables[name] = (dims, values, {"units": units, "long_name": long_name})

    body = ("time", "agent", "axis")
    add("agent_position", body, padded[:, :N], "m", "controlled position of each agent")
    add("target_position", ("time", "target", "axis"), padded[:, N:], "m", "position of each target")
    add("harmonic_extension", body, errors.harmonic_extension, "m", "q*, the harmonic extension of the targets")
    add(
        "disagreement",
        ("time", "agent"),
        np.linalg.norm(np.nan_to_num(errors.disagreement), axis=2),
        "m",
        "|eta_i|, norm of the disagreement",
    )
    add("tracking_error", ("time", "agent"), errors.tracking, "m", "|q*_i - q_i|")
    add("velocity_command", body, velocity, "m s-1", "-k1 eta_i, limited: commanded velocity relative to the medium")
    add("formation_error", ("time",), errors.formation_rms(), "m", "RMS residual over the edges inside formations")
    add("centering_error", ("time",), errors.largest_centering(), "m",
        "largest distance of a group's centroid from where its formation wants it")  # fmt: skip
    if groups:
        coordinates["group"] = _labels("group", groups, "formation group")
        by_group = ("time", "group")
        add("group_formation_error", by_group, np.column_stack([errors.formation_rms(g) for g in groups]), "m",
            "RMS residual over the edges of a group")  # fmt: skip
        add("group_centering_error", by_group, np.column_stack([errors.centering[g] for g in groups]), "m",
            "distance of each centroid from its place: target's projection plus mean displacement")  # fmt: skip

    if trajectory.thrust is None:
        u = inputs(system, trajectory.time, np.nan_to_num(velocity), trajectory.positions)
        add("command", ("time", "agent", "channel"), u, "1", "u_i = g_i^+ (-k1 eta_i), control input of each agent")
    else:
        _add_body_data(variables, coordinates, system, trajectory, thrusters)
    return xr.Dataset(variables, coordinates)


def _labels(dimension: str, names: list[str], long_name: str) -> Variable:
    return dimension, np.array(names, dtype=object), {"long_name": long_name}


def _attributes(system: System, backend: str, seed: int) -> dict[str, Any]:
    """What result.nc says about a run, its status left open."""
    team = system.team
    return {
        "Conventions": "CF-1.11",
        "title": f"mjsheaf run of scenario {system.name}",
        "source": f"mjsheaf {__version__}",
        "scenario": system.name,
        "backend": backend,
        "status": "",
        "message": "",
        "free_directions": "; ".join(describe_null_modes(team)),
        "seed": seed,
        "gain": system.gain,
        "control_period": 0.0 if system.grid.continuous else system.grid.period,
        "groups": json.dumps(
            {f.name: {"members": list(f.members), "about": f.about or ""} for f in team.formations}, sort_keys=True
        ),
    }


def _thrusters(system: System) -> list[list[str]]:
    """Names of every vehicle's thrusters, those of stand-ins where underactuation is off; length V."""
    from mjsheaf.simulation.loop import vehicles_of

    return [list(vehicle.thrusters) for vehicle in vehicles_of(system)]


def _add_body_data(
    variables: dict[str, Variable],
    coordinates: dict[str, Variable],
    system: System,
    trajectory: Trajectory,
    thrusters: list[list[str]],
) -> None:
    """Attitude, height, thruster commands and saturation of bodies."""
    assert trajectory.quaternions is not None  # all four come together, from bodies
    assert trajectory.heights is not None
    assert trajectory.thrust is not None
    assert trajectory.saturation is not None
    N = len(system.team.agents)
    first = np.concatenate([[0], np.cumsum([len(t) for t in thrusters])])
    T, width = len(trajectory.time), max(len(t) for t in thrusters)
    u = np.full((T, len(thrusters), width), np.nan)
    for v, names in enumerate(thrusters):
        u[:, v, : len(names)] = trajectory.thrust[:, first[v] : first[v + 1]]
    variables["command"] = (
        ("time", "agent", "channel"),
        u[:, :N],
        {"units": "N", "long_name": "u_i = W_i^+ [force; moment] + trim, thruster commands of each agent"},
    )
    variables["target_command"] = (
        ("time", "target", "channel"),
        u[:, N:],
        {"units": "N", "long_name": "thruster commands of each target"},
    )
    coordinates["quaternion"] = _labels("quaternion", ["w", "x", "y", "z"], "component of the unit quaternion")
    labels = np.array([names + [""] * (width - len(names)) for names in thrusters], dtype=object)
    for name, kind, own in (("thruster", "agent", labels[:N]), ("target_thruster", "target", labels[N:])):
        long_name = f"thruster behind each channel of each {kind}, empty where it has fewer"
        coordinates[name] = ((kind, "channel"), own, {"long_name": long_name})
    for kind, part in (("agent", slice(None, N)), ("target", slice(N, None))):
        variables[f"{kind}_orientation"] = (
            ("time", kind, "quaternion"),
            trajectory.quaternions[:, part],
            {"units": "1", "long_name": f"attitude of each {kind}, body to world"},
        )
        variables[f"{kind}_height"] = (
            ("time", kind),
            trajectory.heights[:, part],
            {"units": "m", "long_name": f"z of each {kind}'s body"},
        )
        variables[f"{kind}_saturation"] = (
            ("time", kind),
            trajectory.saturation[:, part],
            {"units": "1", "long_name": f"share of each {kind}'s thrusters at a limit"},
        )
