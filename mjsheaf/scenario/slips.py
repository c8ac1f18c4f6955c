"""Notes on a scenario's files: static targets in a flow, uneven recordings, what a vehicle cannot do or leaves out.

`check`, `run` and `list --vehicles` print them.
"""

import numpy as np

from mjsheaf.errors import listed
from mjsheaf.law.paths import Adrift, Recorded, Static
from mjsheaf.media.gridded import GriddedFlow, Medium
from mjsheaf.media.medium import mean_flow
from mjsheaf.scenario.scenario import Scenario
from mjsheaf.vehicles.effects import leeway_of, shortfalls_of
from mjsheaf.vehicles.vehicle import Vehicle


def slips_of(scenario: Scenario) -> list[str]:
    """Return the notes on a scenario and its vehicles, in sentences."""
    vehicles = {id(vehicle): vehicle for vehicle in scenario.system.vehicles}
    media: dict[str, Medium | None] = {"agents": None, "targets": None, "air": "air", "water": "water"}
    flows = [(name, getattr(scenario.flow, name)) for name in media]
    read = [(name, flow.read(media[name])) for name, flow in flows if isinstance(flow, GriddedFlow)]
    pairs = zip(scenario.targets, scenario.target_motions, strict=True)
    curves = {t.id: m.curve(len(t.position)) for t, m in pairs if isinstance(m, Recorded)}
    return [
        *_static_in_flow(scenario),
        *(f"recorded path of {name}: {curve.note}" for name, curve in curves.items() if curve.note),
        *(f"flow.{name}: {note}" for name, flow in read for note in flow.notes),
        *(slip for vehicle in vehicles.values() for slip in slips_of_vehicle(vehicle)),
    ]


def slips_of_vehicle(vehicle: Vehicle) -> list[str]:
    """Return sentences on what a vehicle cannot do of what its description asks, and on ignored parts of its file."""
    slips = [shortfall.sentence for shortfall in shortfalls_of(vehicle)]
    if vehicle.left_out:
        slips.append(f"left out of {vehicle.path.name}: {listed(vehicle.left_out)}")
    return slips


def drifts_of(scenario: Scenario, *, steps: int = 200, least: float = 1e-3) -> dict[str, float]:
    """Estimate how far the flow carries each target without a motion or a pull by the end of the run, m.

    The targets move with the mean medium, and hulls with their leeway in the wind, without gusts, waves and
    disturbance, up to where it is known, in a number of steps. Those that drift by less than `least`, m, are left out.
    """
    phases, N = scenario.phases, len(scenario.agents)
    free = [
        k
        for k, motion in enumerate(scenario.target_motions)
        if motion is None or isinstance(motion, Adrift) or (isinstance(motion, Static) and motion.pull == 0.0)
    ]
    first, grid = phases[0].system, phases[0].system.grid
    if not free or all(flow.is_steady and not flow.table.any() for phase in phases for flow in phase.system.flows):
        return {}
    v = N + np.array(free)
    x = first.initial[v].copy()
    leeway = np.array([leeway_of(first.vehicles[k], first.mean_wind[k]) for k in v.tolist()])
    times = np.linspace(grid.start, grid.start + grid.steps * grid.period, steps + 1)
    h = float(times[1] - times[0])
    for t in times[:-1]:
        system = [phase for phase in phases if phase.time <= t + 1e-9][-1].system
        for field, planar in {(int(system.field[i]), bool(system.planar[i])) for i in v}:
            own = (system.field[v] == field) & (system.planar[v] == planar)
            vehicle = int(v[own][0])
            middle = x[own] + 0.5 * h * mean_flow(system.medium, vehicle, float(t), x[own])
            known = np.isfinite(middle).all(axis=1)
            step = h * mean_flow(system.medium, vehicle, float(t) + 0.5 * h, np.where(known[:, None], middle, x[own]))
            x[own] += np.where(np.isfinite(step) & known[:, None], step + h * leeway[own], 0.0)
    away = np.linalg.norm(x - first.initial[v], axis=1)
    return {scenario.targets[k].id: float(far) for k, far in zip(free, away, strict=True) if far > least}


def _static_in_flow(scenario: Scenario) -> list[str]:
    """Name static targets that the flow carries away."""
    motions = dict(zip([target.id for target in scenario.targets], scenario.target_motions, strict=True))
    if not any(isinstance(motion, Static) and motion.pull == 0.0 for motion in motions.values()):
        return []
    far = {id: away for id, away in drifts_of(scenario).items() if isinstance(motions[id], Static)}
    if not far:
        return []
    farthest = max(far, key=far.__getitem__)
    distance = f"{far[farthest]:.3g} m by the end" if len(far) == 1 else f"{farthest} {far[farthest]:.3g} m by the end"
    return [
        f"motion static does not hold a target: the flow carries {listed(list(far))} away, {distance}; expected fixed "
        "for a target that stays where it is, or adrift for one that floats"
    ]
