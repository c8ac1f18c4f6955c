"""The paper's assumptions and Theorem 1 for a team and its scenario: whether they hold, why not, and what to change.

Rooms: `topology` looks at the team's sheaf alone; `theorem` follows the targets' path, takes the theorem's constants
along it, finds the region that proves itself and decides the assumptions; `loop` has the sampled law with its terms,
links and vehicles. check gathers all in a record that report prints and figures draws. finished compares a run with
the certificate and says how it ended; stuck finds agents that do not move.
"""

from mjsheaf.checking.check import CheckRecord, Examination, check, examine, examine_scenario

__all__ = ["CheckRecord", "Examination", "check", "examine", "examine_scenario"]
