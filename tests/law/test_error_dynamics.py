"""The closed loop's error dynamics (eq. error_dynamics), and the bound on inputs by the error.

Oracle: each term by itself, from dense matrices and the fields: f_B, f~ and Delta of the paper; derivatives of the
recorded error by central differences of order four.
"""

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.media import varying
from tests.builders import mixed_scenario
from tests.oracles.law import velocity_commands
from tests.running import run_ideal

PERIOD = 0.005  # s
TARGETS = {
    "diver": ([1, 1, -2], {"amplitude": [2, 1, 1], "rate": [1, 2, 1], "phase": [1.5, 0, 0], "pull": 0.7}),
    "ship": ([-3, 2], {"amplitude": [1, 2], "rate": [3, 1], "phase": [0.4, 2], "pull": 1.9}),
}
TURNING = {"heading": 30.0, "heading_rate": 20.0}


def test_the_error_obeys_the_papers_equation() -> None:
    """Of a team of unlike dimensions under a continuous law, with smooth targets, thrusters and all that disturbs."""
    scenario = mixed_scenario(
        agents=[
            {"id": "boat", "position": [-2, 1], "effectiveness": {"layout": [[1, 0, 0.5], [0, 1, -0.7]], **TURNING}},
            {"id": "front", "position": [3, 1, 2], "effectiveness": {"layout": np.eye(3).tolist(), **TURNING}},
            {"id": "back", "position": [0, -3, 5], "heading": 120},
        ],
        targets=[{"id": id, "position": x, "motion": {"kind": "lissajous", **m}} for id, (x, m) in TARGETS.items()],
        disturbance={who: {"bound": 0.4, "frequencies": [0.05, 1.0]} for who in ("agents", "targets")},
        controller={"gain": 1.0, "control_period": 0, "record_period": PERIOD},
        ideal={"rtol": 1e-12, "atol": 1e-12},
        time={"start": 0.3, "end": 1.1},
    )
    system = scenario.system
    team, problem, trajectory = system.team, system.team.dirichlet, run_ideal(system)
    assert trajectory.status == "finished"
    H, n = problem.H.toarray(), len(problem.c)
    extension = np.linalg.solve(H, problem.B.toarray())

    def split(x: Array) -> tuple[Array, Array]:
        """Stacked agents and targets of padded states (V, 3)."""
        return team.pack(x)[:n], team.pack(x)[n:]

    def flows(q: Array, p: Array) -> tuple[Array, Array]:
        x = team.unpack(np.concatenate([q, p]))
        return split(np.array([system.flows[system.field[v]].velocity(x[v]) for v in range(len(x))]))

    error, wanted, sizes = [], [], np.zeros(3)
    for t, x in zip(trajectory.time, trajectory.positions, strict=True):
        q, p = split(x)
        star = extension @ p + np.linalg.solve(H, problem.c)
        (f_q, flow_p), (f_star, _) = flows(q, p), flows(star, p)
        _, reference = split(velocity_commands(system, float(t), x))
        omega_q, omega_p = split(varying.evaluate(system.harmonics, np.array([t]))[0])
        parts = extension @ (reference + flow_p) - f_star, f_star - f_q, extension @ omega_p - omega_q
        sizes = np.maximum(sizes, [np.abs(part).max() for part in parts])
        error.append(star - q)
        wanted.append(-system.gain * H @ error[-1] + sum(parts))
    assert sizes.min() > 1e-2  # f_B, f~ and Delta have a say
    e, slope = np.array(error), np.array(wanted)

    def off(stride: int) -> float:
        """Return the largest difference between the equation and e' from differences over `stride` samples."""
        k = np.arange(8, len(e) - 8)
        ahead, behind = e[k + stride] - e[k - stride], e[k + 2 * stride] - e[k - 2 * stride]
        return float(np.abs((8.0 * ahead - behind) / (12.0 * stride * PERIOD) - slope[k]).max())

    coarse, middle, fine = off(4), off(2), off(1)
    assert fine < 1e-7 * float(np.abs(slope).max())
    assert coarse / middle > 15.0  # the differences' own order is four: a factor of 16
    assert middle / fine > 12.0

    # u = k1 g^+ H e, and so |u| <= k1 |g^+| |H| |e|, with thrusters that turn.
    size = np.sqrt((np.nan_to_num(trajectory.log.inputs) ** 2).sum(axis=(1, 2)))
    pinv = max(np.linalg.norm(P, 2) for P in system.effectiveness.pinv)
    largest = system.gain * pinv * float(np.linalg.eigvalsh(H)[-1])
    assert (size <= largest * np.linalg.norm(e, axis=1) * (1 + 1e-9)).all()
    assert size.max() > 0.01
