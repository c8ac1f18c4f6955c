"""Comparison of ideal kinematics with bodies: what each effect costs, and what to change.

Modules:

- recording: Runs in memory, with their phases.
- ladder: Variants of a scenario, from ideal kinematics to its own bodies, and their runs.
- measures: Errors, distances and saturation of a run, and the budget of an error by effect.
- demands: Commanded speeds against the vehicles' speeds, and the cost of the velocity limit.
- convergence: Bodies with a shrinking time constant.
- ringing: Damping predicted and measured, and the usable gain.
- gains: Limits of the gain, and runs at higher gains.
- verdict: Contents of compare.json, and the verdict in sentences.
- compare: The whole comparison.
- report: The page and the directory.
- summary: The answer on one screen.
- figures: Plots of the comparison.
- overlay: Finished runs compared with the first of them.
"""

from mjsheaf.comparing.compare import Comparison, compare
from mjsheaf.comparing.verdict import CompareRecord

__all__ = ["CompareRecord", "Comparison", "compare"]
