"""The closed loop's error dynamics (eq. error_dynamics), and that all implemented signals stay bounded.

Oracle: each term by itself, from dense matrices and the fields: f_B, f~ and Delta of the paper; derivatives of the
recorded error by central differences of order four.
"""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mjsheaf.loop.system import System
from mjsheaf.media import varying
from mjsheaf.scenario import scenario_from_mapping
from tests.builders import random_scenario
from tests.oracles.law import velocity_commands
from tests.running import run_ideal

Array = NDArray[np.float64]

PERIOD = 0.005  # s


def random_loop(seed: int) -> dict[str, Any]:
    """A random team of unlike dimensions under a continuous law: smooth targets, thrusters, everything switched on."""
    rng = np.random.default_rng(1000 + seed)
    raw = random_scenario(seed)
    for target in raw["targets"]:
        n = len(target["position"])
        numbers = {"amplitude": (0, 2), "rate": (0.1, 4), "phase": (0, 6)}
        motion = {name: rng.uniform(*span, n).tolist() for name, span in numbers.items()}
        target["motion"] = {"kind": "lissajous", "pull": float(rng.uniform(0, 2)), **motion}
    for agent in raw["agents"]:
        n = len(agent["position"])
        layout = np.hstack([np.eye(n), rng.uniform(-1, 1, (n, 2))])
        agent["effectiveness"] = {"layout": layout.tolist(), "heading": 30.0, "heading_rate": 20.0}
    raw["disturbance"] = {who: {"bound": 0.4, "frequencies": [0.05, 1.0]} for who in ("agents", "targets")}
    raw["controller"] = {"gain": 1.0, "control_period": 0, "record_period": PERIOD}
    raw["ideal"] = {"rtol": 1e-12, "atol": 1e-12}
    raw["time"] = {"start": 0.3, "end": 1.1}
    return raw


class Terms:
    """The paper's terms of a system, from dense matrices."""

    def __init__(self, system: System) -> None:
        self.system, self.N = system, len(system.team.agents)
        dirichlet = system.team.dirichlet
        self.H, self.B, self.c = dirichlet.H.toarray(), dirichlet.B.toarray(), dirichlet.c
        self.extension = np.linalg.solve(self.H, self.B)

    def split(self, x: Array) -> tuple[Array, Array]:
        """Stacked agents and targets of padded states (V, 3)."""
        stacked = self.system.team.pack(x)
        return stacked[: len(self.H)], stacked[len(self.H) :]

    def q_star(self, p: Array) -> Array:
        return np.asarray(np.linalg.solve(self.H, self.B @ p + self.c))

    def flows(self, q: Array, p: Array) -> tuple[Array, Array]:
        """f_q at q, and the flow at p."""
        x = self.system.team.unpack(np.concatenate([q, p]))
        w = np.array([self.system.flows[self.system.field[v]].velocity(x[v]) for v in range(len(x))])
        return self.split(w)

    def drift(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """f_B, f~ and Delta at a state (V, 3), stacked."""
        q, p = self.split(x)
        f_q, flow_p = self.flows(q, p)
        star = self.q_star(p)
        f_star, _ = self.flows(star, p)
        _, reference = self.split(velocity_commands(self.system, t, x))
        omega_q, omega_p = self.split(varying.evaluate(self.system.harmonics, np.array([t]))[0])
        f_B = self.extension @ (reference + flow_p) - f_star
        return f_B, f_star - f_q, self.extension @ omega_p - omega_q


@pytest.mark.parametrize("seed", range(12))
def test_the_error_obeys_the_papers_equation(seed: int) -> None:
    raw = random_loop(seed)
    terms = Terms(scenario_from_mapping(raw).system)
    largest = float(np.linalg.eigvalsh(terms.H)[-1])
    raw["controller"]["gain"] = 4.0 / largest  # so that the fastest mode takes a quarter of a second
    system = scenario_from_mapping(raw).system
    trajectory = run_ideal(system)
    assert trajectory.status == "finished"
    x, time = trajectory.positions, trajectory.time
    error = np.array([terms.q_star(terms.split(state)[1]) - terms.split(state)[0] for state in x])
    expected, sizes = [], np.zeros(3)
    for t, state, e in zip(time, x, error, strict=True):
        parts = terms.drift(float(t), state)
        sizes = np.maximum(sizes, [np.abs(part).max() for part in parts])
        expected.append(-system.gain * terms.H @ e + sum(parts))
    assert sizes[[0, 2]].min() > 1e-2  # f_B and Delta have a say; f~ where there is more than a drift
    assert sizes[1] > 1e-3 or len(raw["flow"]["agents"]["sources"] + raw["flow"]["agents"]["vortices"]) == 0
    wanted = np.array(expected)

    def off(stride: int) -> float:
        """Return the largest difference between the equation and e' from differences over `stride` samples."""
        k = np.arange(8, len(time) - 8)
        h = stride * PERIOD
        ahead, behind = error[k + stride] - error[k - stride], error[k + 2 * stride] - error[k - 2 * stride]
        return float(np.abs((8.0 * ahead - behind) / (12.0 * h) - wanted[k]).max())

    scale = float(np.abs(wanted).max())
    coarse, middle, fine = off(4), off(2), off(1)
    assert fine < 1e-7 * scale
    assert coarse / middle > 15.0  # the differences' own order is four: a factor of 16
    assert middle / fine > 12.0

    # u = k1 g^+ H e, and so |u| <= k1 |g^+| |H| |e|, with thrusters that turn.
    u = np.nan_to_num(trajectory.log.inputs)
    pinv = max(np.linalg.norm(P, 2) for P in system.effectiveness.pinv)
    size = np.sqrt((u**2).sum(axis=(1, 2)))
    assert (size <= 4.0 * pinv * np.linalg.norm(error, axis=1) * (1 + 1e-9)).all()
    assert size.max() > 0.01
