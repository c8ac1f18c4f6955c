"""Compile the loops that many tests run, in one process for each engine: `python -m tests.compiled ideal|mujoco|fused`.

Scenarios that ship, for a few periods: they have every kind of edge, link, term, medium and vehicle. It takes seconds
where machine code is on the disk.
"""

import sys

from mjsheaf import load_scenario, simulate
from mjsheaf.scenario import list_scenarios

WITH_TERMS = (
    *("feedforward", "gate", "noisy", "paper_delay", "paper_half_lost", "gusts", "localisation", "steady_current"),
)
"""Parts of names of scenarios whose terms, links or gusts only slow tests have on the fused engine."""

LOOPS = {"ideal": ("ideal", "mujoco"), "mujoco": ("physics", "mujoco"), "fused": ("physics", "fused")}


def main(loop: str) -> None:
    backend, engine = LOOPS[loop]
    for name in list_scenarios():
        if engine == "fused" and any(part in name for part in WITH_TERMS):
            continue
        scenario = load_scenario(name, {"time.end": 0.1, "events": [], "physics.contacts": False})
        if scenario.expect.refused is None:
            simulate(scenario, backend, engine=engine)


if __name__ == "__main__":
    main(sys.argv[1])
