"""Result of a backend, and its message if a simulation diverges."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.compile.jit import inline_jit
from mjsheaf.compile.parts import for_each
from mjsheaf.law.in_python import Controller
from mjsheaf.law.law import LawArrays, Memory
from mjsheaf.media.medium import MediumState, unknown_flow
from mjsheaf.system import Phase, System

_PIECE = 2**16  # of vehicles and samples, their product: a few megabytes of results


def samples_in_piece(system: System) -> int:
    """Return the number of samples in a chunk, chosen so that memory does not grow with the length of a run."""
    return max(16, min(2048, _PIECE // len(system.team.members)))


READERS: dict[str, tuple[Any, int]] = {}
"""Compiled functions that read what only the loop knows, by name, and how many numbers each writes.

`read(run, memory, v, out)` is called for vehicle v at every sample: `run` is the Loop on bodies and the Integrator on
ideal kinematics, `memory` is the law's. See `results.dataset.Samples.recorded`.
"""


class Extra(NamedTuple):
    """Recorded values of one of the READERS.

    Attributes:
        values: The values, shape (T, V, width).
        read: The function that writes those of one vehicle.
    """

    values: Array
    read: Any


class Log(NamedTuple):
    """T samples of V vehicles, recorded in the loop; arrays that a backend does not fill have no samples.

    Attributes:
        positions: Positions seen by the law, padded, shape (T, V, 3), m.
        residual: eta of the agents from received measurements, L_T p - c_T of the targets, padded, shape (T, V, 3), m.
        command: Commanded velocities relative to the medium, limited, shape (T, V, 3), m/s.
        velocity: Velocity of the controlled state on ideal kinematics, of the body's origin on bodies, shape (T, V, 3),
            m/s.
        medium: Velocity of flow and disturbance around each vehicle, shape (T, V, 3), m/s.
        inputs: Inputs u_i = g_i^+ command on ideal kinematics, shape (T, N, s).
        origin: Origins of bodies, shape (T, V, 3), m.
        quaternions: Attitudes of bodies (w, x, y, z), body to world, shape (T, V, 4).
        thruster_command: Commands of all actuators, shape (T, A).
        thruster_output: Lagged commands: forces of the actuators, N, or angles, rad, shape (T, A).
        saturation: Fraction of each vehicle's thrusters at a limit, shape (T, V).
        heard: Reception on each link (see `mjsheaf.law.links`), shape (T, L).
        measurements: Delivered measurements, -b if nothing was received, shape (T, m), m; recorded on request.
        safety: Results of the safety filter (see `mjsheaf.law.safety`), shape (T, V, 4); without one (T, V, 0).
        extra: An Extra for each of the READERS.
    """

    positions: Array
    residual: Array
    command: Array
    velocity: Array
    medium: Array
    inputs: Array
    origin: Array
    quaternions: Array
    thruster_command: Array
    thruster_output: Array
    saturation: Array
    heard: Array
    measurements: Array
    safety: Array
    extra: Any = ()

    def span(self, begin: int, end: int) -> "Log":
        """Return views of the samples from `begin` up to but without `end`."""
        arrays = [values[begin:end] for values in self[:-1]]
        return Log._make([*arrays, tuple(Extra(one.values[begin:end], one.read) for one in self.extra)])


def new_log(T: int, law: LawArrays, *, inputs: tuple[int, int] | None = None, actuators: int | None = None) -> Log:
    """A log for T samples of a law's vehicles, on ideal kinematics with `inputs` (N, s) or bodies with `actuators`."""
    V, links = len(law.gain), law.links
    ideal, bodies = T * (inputs is not None), T * (actuators is not None)
    return Log(
        positions=np.empty((T, V, 3)),
        residual=np.empty((T, V, 3)),
        command=np.empty((T, V, 3)),
        velocity=np.empty((T, V, 3)),
        medium=np.empty((T, V, 3)),
        inputs=np.full((ideal, *(inputs or (0, 0))), np.nan),
        origin=np.empty((bodies, V, 3)),
        quaternions=np.empty((bodies, V, 4)),
        thruster_command=np.empty((bodies, actuators or 0)),
        thruster_output=np.empty((bodies, actuators or 0)),
        saturation=np.empty((bodies, V)),
        heard=np.empty((T, len(links.table))),
        measurements=np.empty((T, len(law.edges.b) if links.record else 0)),
        safety=np.zeros((T, V, 4 if law.safety else 0)),
        extra=tuple(Extra(np.full((T, V, width), np.nan), read) for read, width in READERS.values()),
    )


@dataclass(frozen=True)
class Trajectory:
    """Samples of a run under one system.

    Attributes:
        system: the system; of a run with phases, that of the phase.
        time: sample times, shape (T,), s.
        log: the samples.
        message: what blew up, where and when; empty where nothing did.
    """

    system: System
    time: Array
    log: Log
    message: str = ""

    @property
    def status(self) -> str:
        """'finished' or 'unstable'."""
        return "unstable" if self.message else "finished"

    @property
    def positions(self) -> Array:
        """Controlled positions, agents then targets, shape (T, V, 3), m."""
        return self.log.positions


@inline_jit
def _read_extra(extra, _, run, memory, k, v):
    extra.read(run, memory, v, extra.values[k, v])


_read_extras = for_each(lambda _: _read_extra)


@inline_jit
def record_vehicle(run, memory, log, k, v, position, velocity, medium):
    """Write the values that every backend records of vehicle v as sample k.

    Args:
        run: A Loop on bodies, an Integrator on ideal kinematics; see `READERS`.
        memory: Memory of the law.
        log: Log to write to.
        k, v: Numbers of the sample and the vehicle.
        position: Position seen by the law, at least 3 numbers, m.
        velocity: Velocity of the vehicle, at least 3 numbers, m/s.
        medium: Velocity of the medium around it, (x, y, z), m/s.
    """
    for i in range(3):
        log.positions[k, v, i] = position[i]
        log.residual[k, v, i] = memory.residual[v, i]
        log.command[k, v, i] = memory.command[v, i]
        log.velocity[k, v, i] = velocity[i]
        log.medium[k, v, i] = medium[i]
    for i in range(log.safety.shape[2]):
        log.safety[k, v, i] = memory.safety.found[v, i]
    _read_extras(log.extra, log.extra, None, run, memory, k, v)


@inline_jit
def record_links(heard, y, log, k):
    """Write the reception on each link as sample k, and measurements y (m,) if the log has room for them."""
    for i in range(log.heard.shape[1]):
        log.heard[k, i] = heard[i]
    for i in range(log.measurements.shape[1]):
        log.measurements[k, i] = y[i]


def quaternions_of(heading: Array) -> Array:
    """Level attitudes (w, x, y, z), body to world, of headings (V,) in rad, shape (V, 4)."""
    zero = np.zeros_like(heading)
    return np.column_stack([np.cos(heading / 2.0), zero, zero, np.sin(heading / 2.0)])


def pieces_of(phases: Sequence[Phase], samples: int, end: int, first: int = 0) -> Iterator[tuple[System, int, int]]:
    """Cut a run, from sample `first` on, into pieces of at most `samples` samples and one phase each.

    Yields:
        System, first sample and end of each piece.
    """
    for phase, stop in zip(phases, [*(later.start for later in phases[1:]), end], strict=True):
        for begin in range(max(phase.start, first), min(stop, end), samples):
            yield phase.system, begin, min(begin + samples, stop, end)


def blow_up_message(
    system: System,
    vehicle: int,
    detail: str,
    time: float,
    speed: str,
    memory: Memory,
    medium: MediumState,
    controller: Controller | None = None,
) -> str:
    """Name the vehicle, the time and the speed of a blow-up, and the cause, or where to find it.

    Args:
        system: The system.
        vehicle: Number of the vehicle that blew up.
        detail: What is added to its name.
        time: Time, s.
        speed: Its speed, in words.
        memory: Memory of the law.
        medium: State of the medium.
        controller: Law in Python that is in control, which may be the cause.
    """
    gain = "the law, with a controller.gain"
    if vehicle >= len(system.team.agents):
        gain = "the targets' consensus or pull, with a target_formation.gain or motion.pull"
    cause = controller.cause_of_blow_up(system.team, vehicle, memory.command) if controller else ""
    cause = unknown_flow(system.moving, medium.parts, vehicle) or cause
    cause = cause or (
        f"likely cause: {gain} that is too high for the control period, the links or the bodies, or a flow or motion "
        "too strong to integrate; mjsheaf check names the margin"
    )
    return f"unstable: {system.team.members[vehicle].id}{detail} at t = {time:.6g} s, {speed}; {cause}"
