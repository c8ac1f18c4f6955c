"""Ideal kinematics against bodies: what each effect costs, and what to change.

Where to look:

- recording: runs in memory, with their phases; gains: what limits the gain, and runs at higher ones;
- overlay: finished runs compared with the first of them;
- ladder: the variants of a scenario, from ideal kinematics to its own bodies, and their runs;
- measures: errors, distances and saturation of a run, and how much of an error each effect adds;
- demands: speeds asked against speeds possible, and what the velocity limit costs;
- convergence: bodies whose time constant shrinks; ringing: damping predicted and measured, how far to raise the gain;
- verdict: what compare.json holds, and what to change, in sentences; compare: all of the above together;
- report: the page and the directory; figures: its plots.
"""

from mjsheaf.comparing.compare import Comparison, compare
from mjsheaf.comparing.verdict import CompareRecord

__all__ = ["CompareRecord", "Comparison", "compare"]
