"""Ideal kinematics against bodies: what each effect costs, and what to change.

Where to look:

- ladder: the rungs, from ideal kinematics to the scenario's own bodies; climbing: their runs;
- measures: errors, distances, settling and saturation of a run; demands: speeds asked against speeds possible;
- budget: how much of an error each effect adds; ringing: damping predicted and measured; gain: how far it may be
  raised; inertia: the time constant that both stand on; convergence: bodies whose time constant shrinks;
- record: what compare.json holds; compare: all of the above together; verdict: what to change, in sentences;
- report: the page that a person reads; filming: ideal and physics side by side; publishing: the directory.
"""

from mjsheaf.comparing.compare import Comparison, compare
from mjsheaf.comparing.record import CompareRecord

__all__ = ["CompareRecord", "Comparison", "compare"]
