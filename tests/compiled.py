"""Compile the loops that many tests run, in one process: `python -m tests.compiled`.

Scenarios that ship, for a few periods: they have every kind of edge, link, term, medium and vehicle. It takes seconds
where machine code is on the disk.
"""

from mjsheaf import load_scenario, simulate
from mjsheaf.scenario import list_scenarios

ENGINES = (("ideal", "mujoco"), ("physics", "mujoco"), ("physics", "fused"))


def main() -> None:
    for name in list_scenarios():
        for backend, engine in ENGINES:
            scenario = load_scenario(name, {"time.end": 0.1, "events": [], "physics.contacts": False})
            if scenario.expect.refused is None:
                simulate(scenario, backend, engine=engine)


if __name__ == "__main__":
    main()
