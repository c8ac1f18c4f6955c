"""Will it hold, why not, and what to change: the paper's assumptions and Theorem 1, for a team and its scenario.

spectrum, cohomology, mending and fragility look at the team's sheaf alone; region, drift, constants, assumptions and
margins at the whole system; check gathers a record, bound compares a finished run with the theorem.
"""

from mjsheaf.checking.check import Examination, check, examine
from mjsheaf.checking.record import CheckRecord

__all__ = ["CheckRecord", "Examination", "check", "examine"]
