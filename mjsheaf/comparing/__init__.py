"""Comparison of ideal kinematics with bodies: what each effect costs, and what to change.

Modules:

- variants: Variants of a scenario, from ideal kinematics to its own bodies; their runs, errors and saturation,
  the budget of an error by effect, and bodies with a shrinking time constant.
- margins: Ringing of the loop, limits of the gain, runs at higher gains, commanded speeds, the velocity limit.
- causes: Contents of compare.json, and the verdict in sentences.
- compare: The whole comparison, and its directory.
- page: The answer on one screen, and the whole report.
- figures: Plots of the comparison.
"""

from mjsheaf.comparing.causes import CompareRecord
from mjsheaf.comparing.compare import Comparison, compare

__all__ = ["CompareRecord", "Comparison", "compare"]
