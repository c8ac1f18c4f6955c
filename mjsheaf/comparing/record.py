"""What compare.json holds. Its JSON Schema is `mjsheaf schema --compare`.

Errors, distances and their parts are in m, times in s, speeds in m/s. What has no meaning, is infinite, or comes from a
run that blew up is null.
"""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ErrorsRecord(_Part):
    """Errors of the team or of a group, m."""

    tracking_error: float | None
    formation_error: float | None
    centering_error: float | None


class ScopeRecord(_Part):
    """Errors of the team or of a group, at the end and on average."""

    final: ErrorsRecord = Field(description="at the last sample, as summary.json has them")
    late: ErrorsRecord = Field(description="RMS over the last half of the run")


class DistanceRecord(_Part):
    """The largest distance of an agent from where it was in the ideal run."""

    distance_m: float
    agent: str
    time_s: float


class SaturationRecord(_Part):
    """How much of the time thrusters are at a limit."""

    role: Literal["agents", "targets"]
    vehicle: str = Field(description="empty: all agents")
    share: float = Field(description="of time and thrusters, 0 to 1")


class RungRecord(_Part):
    """One rung of the ladder."""

    key: str
    label: str
    kind: Literal["ideal", "part", "base", "alone", "all", "without"]
    effect: str | None = Field(description="what it adds to base ('alone') or takes from all ('without')")
    status: str
    message: str
    timestep_s: float | None = Field(description="of the physics; null on ideal kinematics")
    errors: dict[str, ScopeRecord] = Field(description="by scope: 'team', then the groups by name")
    settling_time_s: float | None = Field(
        description="first time after the start from which the team's formation error (or that of tracking, in a "
        "team without formations) stays below 1.25 times the largest of the last half plus 2% of the largest of "
        "all; null where it still falls or grows by a factor of 2 in the end"
    )
    distance: DistanceRecord | None = Field(description="from the ideal run, over all time")
    distance_late: DistanceRecord | None = Field(
        description="the same over the last half of the run, by which a run has settled that ever does"
    )
    saturation: list[SaturationRecord]


class ItemRecord(_Part):
    """One effect's part in an error."""

    effect: str
    alone_m: float | None = Field(description="what it adds to bodies with ideal thrusters")
    give_back_m: float | None = Field(description="what the scenario as it stands would lose without it")


class BudgetRecord(_Part):
    """Where one error comes from: ideal + targets + agents + together + alone of all effects + interaction = all."""

    scope: str
    measure: Literal["tracking_error", "formation_error"]
    statistic: Literal["late", "final"]
    at_q_star_m: float | None = Field(
        description="with the agents at q* along the ideal run: no law or vehicle mends that; no part of the sum"
    )
    ideal_m: float | None
    targets_m: float | None = Field(description="what targets add as bodies with ideal thrusters")
    agents_m: float | None = Field(description="what agents add likewise")
    together_m: float | None = Field(description="what both have beyond that")
    effects: list[ItemRecord]
    interaction_m: float | None = Field(description="what all effects have beyond the sum of each alone")
    all_m: float | None


class ReleaseRecord(_Part):
    """One free-decay experiment on bodies."""

    bodies: str
    damping_ratio: float | None = Field(description="of the fitted second-order response; null: it does not swing")
    frequency_rad_s: float | None
    overshoot: float = Field(description="beyond q*, of the displacement")
    amplitude_m: float = Field(description="displacement of the farthest agent")
    saturation: float
    status: str


class RingingRecord(_Part):
    """The least damped mode: what inertia predicts, and what bodies do."""

    agent: str = Field(description="who moves most in it")
    predicted_damping_ratio: float = Field(
        description="of T e'' + e' + k1 H e = 0, T = M / (M k_v + D); no hold, no lag"
    )
    predicted_damping_ratio_held: float = Field(description="the same under the held law")
    predicted_frequency_rad_s: float
    predicted_overshoot: float = Field(description="in the same experiment, of the displacement")
    overdamped: bool = Field(description="whether no mode is predicted to swing")
    measured: list[ReleaseRecord]


class PointRecord(_Part):
    """Bodies with one time constant tau."""

    tau_s: float
    timestep_s: float
    distance_m: float | None


class ConvergenceRecord(_Part):
    """Largest distance to the ideal run, both from q*, against the time constant tau of all bodies."""

    points: list[PointRecord]
    start_s: float
    end_s: float
    slope: float | None = Field(description="log-log, by least squares; theory: 1")
    constant: float | None = Field(description="distance = constant tau^slope, m and s")
    reason: str = Field(description="why there is none, or empty")


class UnlimitedRecord(_Part):
    """A run with the law's velocity limit, and the same without."""

    run: Literal["ideal", "all"]
    share_at_limit: float = Field(description="of agents and samples in the last half of the run with the limit")
    status_without: str
    errors_without: dict[str, ScopeRecord] = Field(description="by scope, as in the ladder")


class VelocityLimitRecord(_Part):
    """The law's velocity limit (controller.velocity_limit, or that of single agents) and what it costs."""

    lowest_m_s: float
    highest_m_s: float
    asked_m_s: float = Field(description="largest speed in the last half of the ideal run without it: it would do")
    who: str
    runs: list[UnlimitedRecord]

    def run(self, key: str) -> UnlimitedRecord:
        """The ideal run ('ideal') or that of the scenario as it stands ('all')."""
        return next(run for run in self.runs if run.run == key)


class DemandRecord(_Part):
    """What the vehicles of one kind are asked for in the last half of a run, relative to the medium."""

    run: Literal["ideal", "all"]
    role: Literal["agents", "targets"]
    vehicle: str
    moves_in: Literal["the plane", "space"]
    asked_m_s: float
    who: str
    time_s: float
    share_beyond: float = Field(description="time share in which who is asked for more than least_speed")
    least_speed_m_s: float | None = Field(description="in the slowest horizontal direction; null: no limit")
    forward_speed_m_s: float | None


class FastestRecord(_Part):
    """The fastest vehicle with limits that comes with mjsheaf."""

    moves_in: Literal["the plane", "space"]
    vehicle: str
    speed_m_s: float


class CompareRecord(_Part):
    """Ideal kinematics against bodies."""

    mjsheaf_version: str
    scenario: str
    origin: str | None = Field(None, description="scenario: its name, or its file relative to this directory")
    seed: int
    gain: float = Field(description="k1, 1/s")
    usable_gain: float | None = Field(
        description="k1 up to which neither hold nor bodies ring, 1/s, from the least damped mode; null: any will do"
    )
    time_s: float = Field(description="length of the run")
    formation_size_m: float | None = Field(description="RMS over edges inside groups of the distance they ask for")
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

    def limit_costs(self, scope: str, measure: str, run: str) -> float | None:
        """What an error would lose without the velocity limit, RMS over the last half, m; None where it is not known.

        Args:
            scope: 'team' or a group.
            measure: of ErrorsRecord.
            run: 'ideal' or 'all'.
        """
        if self.velocity_limit is None:
            return None
        now = getattr(self.rung(run).errors[scope].late, measure)
        without = getattr(self.velocity_limit.run(run).errors_without[scope].late, measure)
        return None if now is None or without is None else now - without

    @property
    def measure(self) -> Literal["tracking_error", "formation_error"]:
        """The error that matters: the formation error, or that of tracking in a team without formations."""
        return "tracking_error" if self.rung("ideal").errors["team"].late.formation_error is None else "formation_error"
