"""Small scenarios for the backends' tests, and plain forms of the closed loop to compare with."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjsheaf.dynamics import disturbance
from mjsheaf.dynamics.motion import add_reference
from mjsheaf.scenario import Scenario, scenario_from_mapping
from mjsheaf.system import System

Array = NDArray[np.float64]

FLOW = {
    "dimension": 3,
    "core": 0.5,
    "drift": [0.2, 0.05, -0.1],
    "sources": [{"centre": [1, 0, 0], "alpha": 1.0}],
    "vortices": [{"centre": [0, 1, 0], "axis": [0, 0, 1], "gamma": 0.8}],
}


def make(fields: dict[str, Any]) -> Scenario:
    """A scenario from a mapping, checked as a file would be."""
    return scenario_from_mapping({"name": "test", **fields})


def mixed(**fields: Any) -> Scenario:
    """A boat and two aircraft that track a diver and a boat, in a flow, with a formation; fields replace fields."""
    return make(
        {
            "time": {"end": 1.0},
            "controller": {"gain": 3.0, "control_period": 0.01},
            "agents": [
                {"id": "boat", "position": [-2, 1], "heading": 30},
                {"id": "front", "position": [3, 1, 2], "heading": -60},
                {"id": "back", "position": [0, -3, 5], "heading": 120},
            ],
            "targets": [
                {"id": "diver", "position": [1, 1, -2], "heading": 10},
                {"id": "ship", "position": [-3, 2], "heading": 45},
            ],
            "communication": [["boat", "front"], ["front", "back"]],
            "sensing": [["boat", "ship"], ["front", "diver"], {"between": ["back", "diver"], "map": "local_frame"}],
            "target_edges": [["diver", "ship"]],
            "target_motion": None,
            "target_formation": {"gain": 0.3},
            "formations": [
                {"name": "pair", "shape": "line", "members": ["front", "back"], "about": "diver", "spacing": 3.0}
            ],
            "flow": {"agents": FLOW, "targets": FLOW},
            **fields,
        }
    )


def velocity_commands(system: System, t: float, x: Array) -> Array:
    """-k1 eta on agents, -k_T (L_T p - c_T) + v(t) on targets, shape (V, 3), by dense products."""
    team, problem = system.team, system.team.dirichlet
    n_q = problem.H.shape[0]
    q, p = np.split(team.pack(x), [n_q])
    targets = team.target_sheaf
    eta = problem.H @ q - problem.B @ p - problem.c
    zeta = targets.laplacian() @ p - targets.adjoint_coboundary() @ targets.offset()
    gain = np.concatenate([np.full(n_q, system.gain), np.full(len(p), system.law.gain[-1])])
    command = team.unpack(-gain * np.concatenate([eta, zeta]))
    for v in range(len(x)):
        add_reference(system.motion, v, t, x[v], command[v])
    return command


def medium(system: System, v: int, t: float, x: Array) -> Array:
    """Flow and disturbance about vehicle v at x (3,)."""
    w = system.flow_of(v).velocity(x)
    w[system.team.members[v].dimension :] = 0.0
    return w + disturbance.evaluate(system.harmonics, np.array([t]))[0, v]
