"""Ideal kinematics against bodies: what each effect costs, and what to change.

Where to look:

- ladder: the variants of a scenario, from ideal kinematics to its own bodies, and their runs;
- measures: errors, distances and saturation of a run, and how much of an error each effect adds;
- demands: speeds asked against speeds possible, and what the velocity limit costs;
- convergence: bodies whose time constant shrinks; ringing: damping predicted and measured, how far to raise the gain;
- record: what compare.json holds; compare: all of the above together; verdict: what to change, in sentences;
- report: the page and the directory; figures: its plots.
"""

from mjsheaf.comparing.compare import Comparison, compare
from mjsheaf.comparing.record import CompareRecord

__all__ = ["CompareRecord", "Comparison", "compare"]
