"""Compare what `check` predicts of links with runs: `python benchmarks/links.py` prints the table in docs/claims.md.

The published run and variants of it, on ideal kinematics. Takes about a minute.
"""

from typing import Any

import numpy as np

import mjsheaf

SEEDS = range(20)
STILL = {"flow.agents": None, "flow.targets": None, "target_motion": None, "target_formation": None}
"""The published run in still water, about targets at rest."""
TOGETHER = {f"targets.{k}.position": [40.0, 5.0, -40.0] for k in range(4)} | {"formations": []}
"""All targets in one place and no formation: edges agree at q*, where losses then leave nothing."""


def links(changes: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return the links part of the record of `check`."""
    answers: dict[str, dict[str, float]] = mjsheaf.check(mjsheaf.load_scenario("paper", changes), trial=False)["links"]
    return answers


def run(changes: dict[str, Any]) -> tuple[bool, np.ndarray, np.ndarray]:
    """Run; return True if it finished, q* - q by sample and agent, m, and commands, m/s."""
    data = mjsheaf.simulate(mjsheaf.load_scenario("paper", changes), backend="ideal")
    error = data["harmonic_extension"].values - data["agent_position"].values
    return data.attrs["status"] == "finished", error[..., :2], data["velocity_command"].values[..., :2]


def delay(changes: dict[str, Any]) -> tuple[float, float]:
    """Return the largest stable delay, s, predicted and found: the last for which |e| falls in a run's second half."""
    predicted, periods, falls = links(changes)["delay"]["margin"], -1, True
    while falls:
        periods += 1
        _, e, _ = run({**STILL, **changes, "time.end": 100, "links.all.delay": 0.01 * (periods + 1)})
        square = (e**2).sum(axis=(1, 2))
        falls = len(e) == 10_000 and bool(square[-200:].sum() < max(square[len(e) // 2 :][:200].sum(), 1e-18))
    return predicted, 0.01 * periods


def noise(changes: dict[str, Any]) -> tuple[float, float, float, float]:
    """RMS of |e| that noise makes alone, m, and of all commands, m/s: predicted and measured, in turn."""
    predicted = links(changes)["noise"]
    _, error, command = run({**changes, "links.all.noise": 0})
    found = []
    for seed in SEEDS:
        _, e, u = run({**changes, "seed": seed})
        late = len(e) // 4
        found.append([((a - b)[late:] ** 2).sum(axis=(1, 2)).mean() for a, b in ((e, error), (u, command))])
    error_rms, command_rms = np.sqrt(np.mean(found, axis=0)).tolist()
    return predicted["error"], error_rms, predicted["command"], command_rms


def loss(changes: dict[str, Any]) -> tuple[float, float]:
    """Rate of the root of E|e|^2 under loss, 1/s: predicted, and fitted to the mean over runs."""
    predicted = links(changes)["loss"]["rate"]
    square = np.mean([(run({**changes, "seed": seed})[1] ** 2).sum(axis=(1, 2)) for seed in range(200)], axis=0)
    time = 0.01 * np.arange(len(square))
    chosen = (time > 1.0) & (time < 4.0)
    return predicted, -0.5 * float(np.polyfit(time[chosen], np.log(square[chosen]), 1)[0])


if __name__ == "__main__":
    for gain, rounds in ((10, 0), (3, 0), (10, 2)):
        law = {"controller.gain": gain} | ({"controller.newton.rounds": rounds} if rounds else {})
        print(f"delay margin at gain {gain}, {rounds} rounds of newton (s)", *delay(law))
    print("noise of 0.3 m: |e| (m), commands (m/s)", *noise({"links.all.noise": 0.3}))
    for share in (0.2, 0.5):
        lossy = {**STILL, **TOGETHER, "links.all.loss": share, "time.end": 5}
        print(f"rate with {share} lost (1/s)", *loss(lossy))
