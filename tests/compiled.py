"""Compile the loops that many tests run, in one process for each engine: `python -m tests.compiled ideal|mujoco|fused`.

Scenarios that ship, for a few periods. Together they have the kinds of edges, links, terms, media and vehicles of all
tests that are not marked `long`. It takes seconds where machine code is on the disk.
"""

import sys

from mjsheaf import load_scenario, simulate

LOOPS = {
    "ideal": (
        *("altitude_anchor", "bearing_formation", "certified", "double_gyre", "harbour_feedforward", "harbour_gusts"),
        *("harbour_piers", "narrow_gate", "noisy_harbour", "open_sea", "range_localisation"),
    ),
    "mujoco": (
        *("altitude_anchor", "bearing_formation", "harbour", "harbour_feedforward", "harbour_piers", "noisy_odometry"),
        *("open_sea", "paper_delay", "range_localisation"),
    ),
    "fused": ("altitude_anchor", "bearing_formation", "harbour_piers", "harbour_wind", "otters", "swap"),
}


def main(loop: str) -> None:
    backend, engine = ("ideal", "mujoco") if loop == "ideal" else ("physics", loop)
    for name in LOOPS[loop]:
        scenario = load_scenario(name, {"time.end": 0.1, "events": [], "physics.contacts": False})
        simulate(scenario, backend, engine=engine)


if __name__ == "__main__":
    main(sys.argv[1])
