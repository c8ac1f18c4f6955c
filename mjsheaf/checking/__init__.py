"""The paper's assumptions and Theorem 1 for a team and its scenario: whether they hold, why not, and what to change.

cohomology and mending look at the team's sheaf alone. targets follows the targets' path, constants takes the
theorem's constants along it, certificate finds the region that proves itself, applies the theorem and decides the
assumptions; margins holds what theory leaves out. check gathers all in a record that report prints and figures draws.
finished compares a run with the certificate and says how it ended.
"""

from mjsheaf.checking.check import CheckRecord, Examination, check, examine, examine_scenario

__all__ = ["CheckRecord", "Examination", "check", "examine", "examine_scenario"]
