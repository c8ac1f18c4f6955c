"""The paper's assumptions and Theorem 1 for a team and its scenario: whether they hold, why not, and what to change.

Rooms: `topology` looks at the team's sheaf alone; `theorem` follows the targets' path, takes the theorem's constants
along it, finds the region that proves itself and decides the assumptions; `loop` has the sampled law with its terms,
links and vehicles. examination gathers all in the record of record.py, problems says why it is not ok, check tries the
mission and the fixes. screen and report print the record, and figures draws it. finished compares a run with the
certificate and says how it ended; stuck finds agents that do not move.
"""

from mjsheaf.checking.check import check
from mjsheaf.checking.examination import Examination, examine, examine_scenario
from mjsheaf.checking.record import CheckRecord

__all__ = ["CheckRecord", "Examination", "check", "examine", "examine_scenario"]
