"""The paper's assumptions and Theorem 1 for a team and its scenario: whether they hold, why not, and what to change.

`spectrum` and `repairs` look at the team's sheaf alone; `theorem` follows the targets' path, takes the
theorem's constants along it, finds the region that proves itself and decides the assumptions; `loop` has the sampled
law with its terms, links and vehicles. `check` gathers all in a record, and tries the mission and the fixes. `record`
says what is in it and why it is not ok, and `report` prints it.
"""

from mjsheaf.checking.check import Examination, check, examine, examine_scenario
from mjsheaf.checking.record import CheckRecord

__all__ = ["CheckRecord", "Examination", "check", "examine", "examine_scenario"]
