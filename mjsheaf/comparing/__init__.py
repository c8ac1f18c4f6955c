"""Comparison of ideal kinematics with bodies: what each effect costs, and what to change.

Modules:

- variants: Variants of a scenario, from ideal kinematics to its own bodies, and their runs.
- measures: Errors, distances and saturation of a run, and the budget of an error by effect.
- demands: Commanded speeds against the vehicles' speeds, and the cost of the velocity limit.
- convergence: Bodies with a shrinking time constant.
- gains: Ringing of the vehicles' loop, limits of the gain, and runs at higher gains.
- causes: Contents of compare.json, and the verdict in sentences.
- compare: The whole comparison.
- page: The answer on one screen, and the whole report.
- figures: Plots of the comparison.
- publish: The directory.
"""

from mjsheaf.comparing.causes import CompareRecord
from mjsheaf.comparing.compare import Comparison, compare

__all__ = ["CompareRecord", "Comparison", "compare"]
