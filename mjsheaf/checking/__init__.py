"""The paper's assumptions and Theorem 1 for a team and its scenario: whether they hold, why not, and what to change.

`spectrum`, `fragility` and `repairs` look at the team's sheaf alone; `theorem` follows the targets' path, takes the
theorem's constants along it, finds the region that proves itself and decides the assumptions; `loop` has the sampled
law with its terms, links and vehicles. `examination` gathers all in a record, `problems` says why it is not ok, and
`check` tries the mission and the fixes. `report` prints the record, `figures` draws it.
"""

from mjsheaf.checking.check import check
from mjsheaf.checking.examination import Examination, examine, examine_scenario
from mjsheaf.checking.record import CheckRecord

__all__ = ["CheckRecord", "Examination", "check", "examine", "examine_scenario"]
