"""The record of a check: what `check --json` prints. Its JSON Schema is `mjsheaf schema --check`.

Numbers that are infinite are null; a flag or a sentence beside them says so.
"""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RegionRecord(_Part):
    """Where the constants were taken."""

    source: str
    verified: bool = Field(
        description="whether agents of an unlimited law are proven to stay there; else it is a guess"
    )
    agents_low: list[float] = Field(description="corner of the box about the agents' region, m")
    agents_high: list[float] = Field(description="opposite corner, m")
    start: float = Field(description="s")
    end: float = Field(description="s")
    samples: int = Field(description="cells that cover the targets' path, or instants where it is not known")
    path_error: float | None = Field(description="of the targets' path, for which the bounds allow, m; null: not known")


class AssumptionRecord(_Part):
    """A numbered assumption of the paper."""

    number: int
    name: str
    verdict: Literal["holds", "fails", "undecided"]
    value: float | None
    unit: str
    witness: str


class DirectionRecord(_Part):
    """A direction in which agents can drift."""

    description: str
    motion: dict[str, list[float]] = Field(description="how each agent moves; agents that do not move are left out")


class NearNullRecord(_Part):
    """A direction that is barely held."""

    description: str
    eigenvalue: float
    ratio: float = Field(description="to the largest eigenvalue of H")


class RepairRecord(_Part):
    """One edge or anchor to add."""

    kind: Literal["communication", "sensing", "anchor"]
    description: str
    removes: int = Field(description="how many free directions it holds by itself")
    lambda_min_alone: float = Field(description="of H with this repair alone")
    lambda_min_without: float = Field(description="of H with all repairs but this one")


class MendingRecord(_Part):
    """The smallest set of repairs that makes the relative cohomology trivial."""

    needed: int
    exact: bool = Field(description="whether no smaller set exists among the candidates; else greedy")
    candidates: int
    repairs: list[RepairRecord]
    lambda_min: float = Field(description="of H with all repairs")
    alternatives: list[list[str]] = Field(description="other sets of the same size, described")


class CohomologyRecord(_Part):
    """H^0(G, G_p; F), explained."""

    dimension: int
    tolerance: float = Field(description="relative to the largest singular value")
    method: str
    basis: list[DirectionRecord]
    near_null: list[NearNullRecord]
    mending: MendingRecord | None = Field(description="null where nothing is free")


class WeakerRecord(_Part):
    """The bound with rho = 0 and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2)."""

    f_bar: float | None
    radius: float | None = Field(description="ultimate radius, m")


class TheoremRecord(_Part):
    """Theorem 1, computed."""

    applies: bool = Field(
        description="the gain condition and every numbered assumption hold, and no hold or speed limit is in the way"
    )
    gain_condition: bool = Field(
        description="k_min > rho(2 sqrt(mu / lambda_V)) + lambda_V, over the targets' known path"
    )
    approximate: bool = Field(description="the law is held over a period; the theorem's is continuous")
    reason: str = Field(description="why it does not apply, or empty")
    gain: float = Field(description="k1, 1/s")
    lambda_min: float
    lambda_max: float
    sigma_max_B: float
    omega_bar: float | None = Field(description="m/s")
    f_bar: float | None = Field(description="m/s")
    rho: float | None = Field(
        description="constant Lipschitz bound, 1/s; of a user's rho its value at the initial error"
    )
    rho_seen: float | None = Field(description="largest slope found, 1/s")
    rho_source: str
    lambda_V: float | None = Field(description="rate, 1/s; the best one unless given")
    lambda_V_given: bool
    k_min: float = Field(description="1/s")
    mu: float | None = Field(description="m^2/s")
    chi: float | None = Field(description="m; null where it is infinite: rho is constant over the region")
    chi_infinite: bool | None = Field(description="null where the gain condition fails")
    radius_D: float | None = Field(description="m; null: the whole space, or the condition fails")
    radius_S: float | None = Field(description="m; null: the whole space, or the condition fails")
    radius_U: float | None = Field(description="m; null where the condition fails")
    initial_error: float = Field(description="|e(t0)|, m")
    initial_error_inside_S: bool | None = Field(
        description="null where the gain condition fails, so that there is no S"
    )
    wanted_radius: float = Field(description="m")
    gain_for_wanted_radius: float | None = Field(description="smallest k1 that meets it, 1/s")
    weaker: WeakerRecord


class HoldRecord(_Part):
    """The sampled law on ideal kinematics."""

    period: float
    product: float = Field(description="k1 h lambda_max: below 2 it converges, up to 1 it does not ring")
    largest_gain: float | None = Field(description="1/s; null where H = 0")
    ringing_gain: float | None = Field(description="1/s; null where H = 0")


class SwingRecord(_Part):
    """A mode of the real vehicles' loop."""

    damping: float = Field(description="damping ratio; negative where the mode grows")
    frequency: float = Field(description="natural frequency, rad/s")
    agent: str | None = Field(description="who moves most in it; null where that is not known")


class BodyRecord(_Part):
    """The loop of the real vehicles, for small motions: inertia, attitude, thruster lag, hold, in the mean flow.

    Each vehicle is linearised about the equilibrium in which it holds station in the mean flow that it meets.
    """

    tau: list[float] = Field(description="smallest and largest m / D of the agents, s")
    damping_slowest: float | None = Field(description="of the slowest mode, by inertia alone; null: it does not swing")
    damping_fastest: float | None = Field(description="of the fastest mode, by inertia alone; null: it does not swing")
    stable: bool | None = Field(description="whether every mode of the loop decays; null where undecided: see reason")
    spectral_radius: float | None = Field(
        description="of the loop from one evaluation of the law to the next; below 1 it is stable; null where undecided"
    )
    period: float = Field(description="between evaluations of the law, s: the physics step where the law is continuous")
    largest_gain: float | None = Field(
        description="from which on a mode grows, 1/s; null where undecided, or where none is found"
    )
    least_damped: SwingRecord | None = Field(
        description="the mode with the smallest damping ratio; null where undecided"
    )
    reason: str = Field(description="why it is undecided, or empty")

    def verdict(self) -> str:
        """The loop in a few words."""
        if self.stable is not False:
            return "the vehicles' loop is " + ("stable" if self.stable else f"undecided: {self.reason}")
        mode = self.least_damped
        who = "" if mode is None or mode.agent is None else f" (about {mode.agent})"
        limit = "" if self.largest_gain is None else f": stable below a gain of {self.largest_gain:.3g} 1/s"
        return f"the vehicles' loop is unstable{who}{limit}"


class SpeedRecord(_Part):
    """How fast an agent must be, and can be, m/s."""

    agent: str
    asked: float = Field(description="by the law at the start")
    limit: float | None = Field(description="that the law keeps; null without one")
    steady: float | None = Field(description="largest through the medium along q*; null where a field is singular")
    able: float | None = Field(description="of its body through the medium; null where its thrusters have no limits")


class LagRecord(_Part):
    """The expected steady lag of an agent, the largest along the run."""

    agent: str
    lag: float | None = Field(description="m; null where a field is singular")


class MarginsRecord(_Part):
    """What theory leaves out."""

    hold: HoldRecord | None = Field(description="null where the law is continuous")
    bodies: BodyRecord
    speed: list[SpeedRecord] = Field(description="the most demanding agents first, at most 20")
    lag: list[LagRecord] = Field(description="the largest first, at most 20")


class LossRecord(_Part):
    """What the loss of one edge or agent does."""

    kind: str
    name: str
    breaks: list[str]
    lambda_min: float | None


class FragilityRecord(_Part):
    """Which single loss breaks an assumption."""

    exact: bool
    method: str
    critical: list[LossRecord] = Field(description="losses that break something, at most 50")
    critical_count: int
    worst: LossRecord | None = Field(description="the loss that breaks nothing with the smallest lambda_min")


class CheckRecord(_Part):
    """A check of a scenario."""

    scenario: str
    ok: bool = Field(
        description="every numbered assumption holds (none fails, none is undecided), and the vehicles' loop is not "
        "unstable"
    )
    region: RegionRecord
    assumptions: list[AssumptionRecord]
    relative_cohomology: CohomologyRecord
    theorem: TheoremRecord
    margins: MarginsRecord
    fragility: FragilityRecord

    def verdict(self) -> str:
        """The check in a few words: what holds, where, and what does not."""
        region = f"along the targets' path from {self.region.start:g} to {self.region.end:g} s"
        counts = [sum(a.verdict == kind for a in self.assumptions) for kind in ("holds", "fails", "undecided")]
        loop = "; " + self.margins.bodies.verdict() if self.margins.bodies.stable is False else ""
        if counts[0] == len(self.assumptions):
            return f"all {counts[0]} assumptions hold, the 7th {region}{loop}"
        named = [
            f"{n} {word}"
            for n, word in zip(counts[1:], ("FAIL" if counts[1] > 1 else "FAILS", "undecided"), strict=True)
            if n
        ]
        return f"{counts[0]} assumptions hold, {', '.join(named)}; the 7th is taken {region}{loop}"
