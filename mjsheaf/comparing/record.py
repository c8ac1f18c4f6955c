"""What compare.json holds. Its JSON Schema is `mjsheaf schema --compare`.

Errors, distances and their parts are in m, times in s, speeds in m/s. What has no meaning, is infinite, or comes from a
run that blew up is null. Each part is defined by the module that computes it.
"""

from pydantic import Field

from mjsheaf.comparing.convergence import ConvergenceRecord
from mjsheaf.comparing.demands import DemandRecord, FastestRecord, VelocityLimitRecord
from mjsheaf.comparing.ladder import RungRecord
from mjsheaf.comparing.measures import FORMATION, TEAM, TRACKING, BudgetRecord, Measure
from mjsheaf.comparing.ringing import RingingRecord
from mjsheaf.io.section import Finite, FiniteRecord


class LoopRecord(FiniteRecord):
    """The loop of the scenario's vehicles, for small motions, as `check` has it."""

    stable: bool | None = Field(description="null where undecided")
    largest_gain: float | None = Field(description="from which on it is unstable, 1/s")
    reason: str = Field(description="why it is undecided, or empty")


class CompareRecord(FiniteRecord):
    """Ideal kinematics against bodies."""

    mjsheaf_version: str
    scenario: str
    origin: str | None = Field(None, description="scenario: its name, or its file relative to this directory")
    seed: int
    gain: float = Field(description="k1, 1/s")
    usable_gain: float | None = Field(
        description="k1 up to which neither hold nor bodies ring, 1/s, from the least damped mode; null: any will do"
    )
    loop: LoopRecord | None = Field(None, description="null where the ideal run blew up")
    time_s: float = Field(description="length of the run")
    formation_size_m: Finite = Field(description="RMS over edges inside groups of the distance they ask for")
    ladder: list[RungRecord]
    budgets: list[BudgetRecord]
    ringing: RingingRecord | None = Field(description="null for teams of too many states")
    convergence: ConvergenceRecord
    velocity_limit: VelocityLimitRecord | None = Field(None, description="null where no agent has one")
    demands: list[DemandRecord]
    fastest: list[FastestRecord]
    verdict: list[str] = Field(description="what to change, the most telling sentence first")
    wall_time_s: float
    video: str | None = Field(description="name of the file, or null")

    def rung(self, key: str) -> RungRecord:
        """The rung with a key."""
        return next(rung for rung in self.ladder if rung.key == key)

    def budget(self, scope: str, measure: str, statistic: str) -> BudgetRecord:
        """The budget of one error."""
        wanted = (scope, measure, statistic)
        return next(b for b in self.budgets if (b.scope, b.measure, b.statistic) == wanted)

    @property
    def scopes(self) -> list[str]:
        """'team', then the names of the groups."""
        return list(self.ladder[0].errors)

    @property
    def measure(self) -> Measure:
        """The error that matters: the formation error, or that of tracking in a team without formations."""
        return TRACKING if self.rung("ideal").errors[TEAM].late.formation_error is None else FORMATION

    def limit_costs(self, scope: str, measure: str, run: str) -> float | None:
        """What an error would lose without the velocity limit, RMS over the last half, m; None where it is not known.

        Args:
            scope: 'team' or a group.
            measure: of ErrorsRecord.
            run: 'ideal' or 'all'.
        """
        if self.velocity_limit is None:
            return None
        now = self.rung(run).errors[scope].error(measure)
        without = self.velocity_limit.run(run).errors_without[scope].error(measure)
        return None if now is None or without is None else now - without
