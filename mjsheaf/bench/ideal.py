"""The published run on ideal kinematics: 4,998 held steps of 17 vehicles at a relative tolerance of 1e-9."""

from typing import Any

import mjsheaf
from mjsheaf.bench.clock import best_cpu
from mjsheaf.bench.rows import Row, at_most, informs
from mjsheaf.simulation.ideal import run_ideal

WANTED_S = 0.3

AUTHORS_S = 38.0
"""The paper's own code, which calls scipy for each agent and step, on a machine of two cores."""


def measure(short: bool = False, end: float | None = None) -> dict[str, Any]:
    """Integrate the run, and make its dataset; compiled before the clock starts.

    Args:
        short: fewer repetitions.
        end: an earlier end of the run, s.

    Returns:
        `steps`; `run_s`: integration; `simulate_s`: that, building the system and its data, as `mjsheaf.simulate` does.
        Both in s of processor time.
    """
    scenario = mjsheaf.load_scenario("paper", {} if end is None else {"time.end": end})
    system = scenario.system
    mjsheaf.simulate(scenario, backend="ideal")
    repetitions = 5 if short else 20
    return {
        "steps": system.grid.steps,
        "run_s": best_cpu(lambda: run_ideal(system), repetitions),
        "simulate_s": best_cpu(lambda: mjsheaf.simulate(scenario, backend="ideal"), repetitions),
    }


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted."""
    run, steps = figures["run_s"], figures["steps"]
    return [
        at_most("ideal", f"published run, {steps} steps, s", run, WANTED_S, run / WANTED_S, 1.0, "wanted time"),
        informs("ideal", "simulate() of it, s", figures["simulate_s"], AUTHORS_S, "the authors' code"),
    ]
