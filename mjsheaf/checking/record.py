"""Record of a check: what `mjsheaf check --json` prints, with the meaning of each field."""

from typing import Any

from pydantic import Field

from mjsheaf.checking.fragility import Fragility
from mjsheaf.checking.loop.held_law import LawLoop
from mjsheaf.checking.loop.links import LinkRecord
from mjsheaf.checking.loop.margins import Margins
from mjsheaf.checking.loop.prediction import DisturbanceRecord, SteadyError
from mjsheaf.checking.repairs import Augmentation, Rigidity
from mjsheaf.checking.separation import SafetyRecord
from mjsheaf.checking.spectrum import RelativeCohomology
from mjsheaf.checking.theorem.certificate import Assumption
from mjsheaf.checking.theorem.targets import TargetsLoop
from mjsheaf.checking.trial import TrialRecord
from mjsheaf.section import OF_TEAM, TEAM_NORM, Finite, Norm, Record


class RegionSummary(Record):
    """Region over which the constants were taken."""

    source: str
    verified: bool = Field(description="whether agents of an unlimited law are proven to stay there; else a guess")
    agents_low: list[float] = Field(description="corner of the box about the agents' region, m")
    agents_high: list[float] = Field(description="opposite corner, m")
    start: float = Field(description="of the time, s")
    end: float = Field(description="of the time, s")
    samples: int = Field(description="cells that cover the targets' path, or instants where it is not known")
    path_error: Finite = Field(description="error of the targets' path that the bounds include, m; null: not known")


class ExplainedCohomology(RelativeCohomology):
    """H^0(G, G_p; F), explained, and what would make it trivial."""

    mending: Augmentation | None = Field(description="null where nothing is free")


class WeakerBound(Record):
    """The bound with rho = 0 and f_bar enlarged by 2 sqrt(sum_i sup |f_i|^2)."""

    f_bar: Finite = Field(description="so enlarged, m/s")
    radius: Finite = Field(description="ultimate radius of |e|, m")
    radius_per_agent: Finite = Field(description="the same as RMS over agents, radius / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)


class TheoremSummary(Record):
    """Theorem 1, computed."""

    holds: bool | None = Field(
        description="the same as `applies`; null where the theorem is about other teams: with ranges, bearings or "
        "directed edges, or without targets"
    )
    applies: bool = Field(
        description="the gain condition and every numbered assumption hold, and no hold or speed limit is in the way"
    )
    gain_condition: bool = Field(
        description="k_min > rho(2 sqrt(mu / lambda_V)) + lambda_V; the targets' path is known"
    )
    approximate: bool = Field(description="the law is held over a period; the theorem's is continuous")
    reason: str = Field(description="why it does not apply, or empty")
    gain: float = Field(description="k1, 1/s")
    lambda_min: float = Field(description="smallest eigenvalue of H")
    lambda_max: float = Field(description="largest eigenvalue of H")
    sigma_max_B: float = Field(description="largest singular value of B")
    omega_bar: Finite = Field(description="bound on the effect of disturbances, m/s")
    f_bar: Finite = Field(description="bound on |H^-1 B f_p - f_q(q*)| along the targets' path, m/s")
    rho: Finite = Field(description="constant Lipschitz bound, 1/s; of a user's rho its value at the initial error")
    rho_seen: Finite = Field(description="largest slope found, 1/s")
    rho_source: str
    lambda_V: Finite = Field(description="rate, 1/s; the best one unless given")
    lambda_V_given: bool = Field(description="lambda_V is the caller's, not the best one")
    k_min: float = Field(description="k1 lambda_min / 2, 1/s")
    mu: Finite = Field(description="(f_bar + omega_bar)^2 / (2 k1 lambda_min), m^2/s")
    chi: Finite = Field(description="radius of D, m; null where it is infinite: rho is constant over the region")
    chi_infinite: bool | None = Field(description="D is the whole space; null where the gain condition fails")
    radius_D: Finite = Field(description="of the set that is never left, m; null: the whole space, or none")
    radius_S: Finite = Field(description="of the set in which an error may begin, m; null: the whole space, or none")
    radius_U: Finite = Field(description="ultimate radius of |e|, m; null where the condition fails")
    initial_error: Finite = Field(
        description="|e(t0)|, m; of a later phase a bound: that of the phase before at its end, and the jump "
        "of q*; null where there is none"
    )
    radius_U_per_agent: Finite = Field(description="the same as RMS over agents, radius_U / sqrt(N), m")
    initial_error_per_agent: Finite = Field(description="initial error as RMS over agents, m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    initial_error_inside_S: bool | None = Field(description="the error begins in S; null: there is no S")
    wanted_radius: float = Field(description="desired bound on |e|, the norm of the whole team, m")
    gain_for_wanted_radius: Finite = Field(
        description="smallest k1 that was found at which the theorem applies with that radius, in its own region and "
        "from the initial error as here, 1/s; null: see its reason"
    )
    gain_for_wanted_radius_reason: str = Field(description="why there is no such gain, or empty")
    weaker: WeakerBound


class Proposal(Record):
    """A law whose bound on ideal kinematics is at most the desired radius, and its cost."""

    controller: dict[str, object] = Field(
        description="fields of the scenario's controller to set; null takes a term away, others stay as they are"
    )
    bound: float = Field(description="on |e| at samples of the second half, without speed limits, m")
    bound_per_agent: float = Field(description="`bound` as RMS over agents, bound / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    certified: bool = Field(description="no speed limit can be met, so that the bound is the run's")
    command: Finite = Field(description="bound on each agent's command over the second half, m/s")
    stable_on_bodies: bool | None = Field(description="the loop of the real vehicles is stable too; null: undecided")
    exchanges: float = Field(description="rounds of exchange a second")
    numbers: float = Field(description="numbers that an agent sends a second, on average")
    noise: Finite = Field(description="bound on the RMS noise of commands per noise of odometry, 1/s")


class TriedFix(Record):
    """A fix that was tried on bodies."""

    ok: bool = Field(description="nothing failed")
    tracking_error: Finite = Field(description="with it, RMS over agents and the second half, m; null: none")
    without: Finite = Field(description="the same without it, m; null: none")
    problem: str = Field(description="what still failed, or empty")


class Problem(Record):
    """A reason why a check is not ok."""

    kind: str = Field(
        description="assumption_1 to assumption_7, rigid, place, undecided, held_law, links, bodies, targets, turning, "
        "flow, wind, gusts, slow, limited, unsafe, room, or untried"
    )
    what: str = Field(description="what is wrong, in a few words")
    why: str = Field("", description="the reason, with numbers, or empty")
    fix: str = Field("", description="the smallest change that removes it, or empty")
    changes: dict[str, Any] = Field({}, description="fields of the scenario that the fix sets, as for --set")
    additions: dict[str, list[Any]] = Field({}, description="entries that the fix adds to lists of the scenario")
    tried: TriedFix | None = Field(None, description="the fix, tried on bodies; null if it was not")

    def __str__(self) -> str:
        return f"{self.what}: {self.why}" if self.why else self.what


class PartRecord(Record):
    """Analysis of a team and its law while neither changes."""

    ok: bool = Field(
        description="every numbered assumption that applies holds (none fails, none is undecided), check has a model "
        "of the whole law; neither the held law, alone and over its links, nor the targets' own, nor the vehicles' "
        "loop is unstable; and the vehicles can do what the mission demands: `problems` is empty"
    )
    problems: list[Problem] = Field([], description="why the analysis is not ok, each with a fix")
    assumptions: list[Assumption]
    relative_cohomology: ExplainedCohomology
    theorem: TheoremSummary = Field(description="of the paper's law, whatever terms the scenario's has")
    law: LawLoop
    links: LinkRecord | None = Field(description="what links do to the law; null without a held law")
    targets: TargetsLoop = Field(description="the targets' own law, on ideal kinematics and on their vehicles")
    margins: Margins
    rigidity: Rigidity = Field(description="of the communication edges, linearised at q*")
    safety: SafetyRecord | None = Field(
        description="what keeps vehicles apart, null without it; with it, what is said of the law and of loops is "
        "about the team while the filter does not act"
    )
    disturbance: DisturbanceRecord
    fragility: Fragility = Field(description="which single event more breaks an assumption")
    topology_fix: str = Field(
        description="edges that would make assumption 5 hold, the shortest ones; empty if it holds"
    )
    topology_edges: dict[str, list[list[str]]] = Field(description="the same edges, as the scenario's lists have them")


class PhaseRecord(PartRecord):
    """A check of one phase of a run with events, of the present agents alone and the time until the next event.

    Its |e(t0)| is at most the smallest bound of the phase before at its end, and the jump of q* more. An agent that
    joins adds its distance from q*, if it is proven to have stayed where it began: it has held its position from the
    start of the run, and the medium there is never faster than its velocity limit. No bound is claimed where an agent
    joins that was lost, drifts or may have been carried off, where the phase before leaves none, nor where the
    paper's law follows one with terms. What is asked at the start (`margins.speed`) is as if the phase before had come
    to rest.
    """

    start: float = Field(description="s")
    events: list[str] = Field(description="what happens there")
    absent: list[str] = Field(description="agents that are lost or have yet to join")
    jump: Finite = Field(description="|q*_new - q*_old| at its start, of the agents present before and after, m")
    norm: Norm = Field(TEAM_NORM, description="which norm `jump` is")
    jumps: dict[str, Finite] = Field(description="the same of each of these agents, m")


class CheckRecord(PartRecord):
    """A check of a scenario; of a run with events it is about the first phase, and `phases` about each of them.

    `ok` and `problems` are about all phases, and `ok` about the trial too.
    """

    scenario: str
    region: RegionSummary
    steady: SteadyError
    proposals: list[Proposal] = Field(
        description="laws whose bound is at most the desired radius, the cheapest of each kind"
    )
    phases: list[PhaseRecord] = Field(default_factory=list, description="of a run with events, the first included")
    trial: TrialRecord | None = Field(None, description="the mission, tried on bodies; null where it was not tried")
    drifts: dict[str, float] = Field(
        {}, description="how far the flow carries each target that nothing holds by the end of the run, m"
    )
    notes: list[str] = Field(
        default_factory=list, description="values in the files that look like mistakes, in sentences"
    )
