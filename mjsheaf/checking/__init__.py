"""Will it hold, why not, and what to change: the paper's assumptions and Theorem 1, for a team and its scenario.

spectrum, cohomology, mending and fragility look at the team's sheaf alone. targets follows the targets' path, drift
bounds f_B along it, region is where agents can be, certificate finds the region that proves itself and says what the
theorem does; assumptions decides the paper's seven, margins what theory leaves out. check gathers a record, bound
compares a finished run with the certificate.
"""

from mjsheaf.checking.check import Examination, check, examine
from mjsheaf.checking.record import CheckRecord

__all__ = ["CheckRecord", "Examination", "check", "examine"]
