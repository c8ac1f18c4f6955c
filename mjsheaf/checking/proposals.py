"""Changes that bring the error of a run below a desired radius: terms, rounds and gain, and their cost."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

from pydantic import Field

from mjsheaf.checking.loop.body_loop import loop_on_path
from mjsheaf.checking.loop.held_law import LawLoop, envelope, law_loop, loop_of
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.errors import UndecidedError
from mjsheaf.io.norms import OF_TEAM, TEAM_NORM, Norm
from mjsheaf.io.section import Finite, Record
from mjsheaf.law.terms import Drift, Feedforward, Newton, Odometry, Terms, pack_terms
from mjsheaf.system import System

_ROUNDS = (1, 2, 3, 5, 8, 13)
_GAINS = (1.0, 2.0, 5.0, 10.0)  # times the scenario's
_RESERVE = 2.0  # factor by which the gain can grow without instability
_FILTER = 0.1  # s, of the drift's observer
_MOST_NUMBERS = 3_000_000  # samples times states


class Proposal(Record):
    """A law whose bound on ideal kinematics is at most the desired radius, and its cost."""

    controller: dict[str, object] = Field(
        description="fields of the scenario's controller to set; null takes a term away, others stay as they are"
    )
    bound: float = Field(description="on |e| at samples of the second half of the run, without speed limits, m")
    bound_per_agent: float = Field(description="`bound` as RMS over agents, bound / sqrt(N), m")
    norm: Norm = Field(TEAM_NORM, description=OF_TEAM)
    certified: bool = Field(description="whether no speed limit can be met, so that the bound is the run's")
    command: Finite = Field(description="no agent's command exceeds it over the second half of the run, m/s")
    stable_on_bodies: bool | None = Field(description="whether the loop of the real vehicles is too; null: undecided")
    exchanges: float = Field(description="rounds of exchange between neighbours a second")
    numbers: float = Field(description="numbers that an agent sends a second, mean over the agents")
    noise: Finite = Field(description="RMS noise of the command over that of a sample of odometry, at most, 1/s")


def propose(system: System, certificate: Certificate, radius: float) -> list[Proposal]:
    """The cheapest of each kind of law whose bound is at most the radius, m: the smallest gain, then fewest rounds.

    None where nothing can be decided, where links are not exact, or where the run is long.
    """
    try:
        loop_of(system)  # where it is undecided, as with rounds that can be delayed or lost, so are its variants
    except UndecidedError:
        return []
    if (
        system.team.linearised_at is not None
        or len(system.law.links.table)
        or system.grid.steps * system.team.dirichlet.H.shape[0] > _MOST_NUMBERS
    ):
        return []
    odometry = Odometry(noise=system.law.terms.noise, bias=system.law.terms.bias)
    return [proposal for kind in range(4) if (proposal := _cheapest(system, certificate, radius, kind, odometry))]


def _cheapest(
    system: System, certificate: Certificate, radius: float, kind: int, odometry: Odometry
) -> Proposal | None:
    """Of one kind; None where none of those tried does it."""
    rounds = _ROUNDS if kind else (0,)
    for gain in (factor * system.gain for factor in _GAINS):
        laws = [_law(system, gain, _terms(kind, r, odometry)) for r in rounds]
        # More rounds leave less, or nearly so: the first number that does it is found by halves.
        first = bisect_left(laws, True, key=lambda law: _keeps(law, certificate, radius))
        if first < len(laws):
            fields, on_bodies = _terms(kind, rounds[first], odometry), loop_on_path(laws[first], certificate).stable
            return _proposal(gain, fields, system.law.term_names, law_loop(laws[first], certificate), on_bodies)
    return None


def _terms(kind: int, rounds: int, odometry: Odometry) -> Terms:
    """The paper's law; feedforward; newton too; drift and extrapolation too."""
    forward = Feedforward(rounds=rounds, extrapolate=kind == 3) if kind else None
    drift = Drift(filter=_FILTER) if kind == 3 else None
    newton = Newton(rounds=rounds) if kind > 1 else None
    return Terms(feedforward=forward, newton=newton, drift=drift, odometry=odometry)


def _law(system: System, gain: float, terms: Terms) -> System:
    """The system under another law."""
    gains = system.law.gain.copy()
    gains[: len(system.team.agents)] = gain
    packed = pack_terms(terms, system.team, system.grid.period)
    return replace(system, gain=gain, law=system.law._replace(gain=gains, terms=packed))


def _keeps(system: System, certificate: Certificate, radius: float) -> bool:
    """Return True if the law's bound is at most the radius, m, and its gain well inside the stable range."""
    try:
        loop = loop_of(system)
        stable = max(loop.radius, replace(loop, gain=_RESERVE * loop.gain).radius) < 1.0
        return stable and envelope(system, certificate).late() <= radius
    except UndecidedError:
        return False


def _proposal(gain: float, terms: Terms, present: Sequence[str], found: LawLoop, on_bodies: bool | None) -> Proposal:
    """The law of these terms in place of one that has those that are present."""
    fields = {name: getattr(terms, name) for name in ("feedforward", "newton", "drift", "integral")}
    sections = {
        name: section and section.model_dump() for name, section in fields.items() if section or name in present
    }
    assert found.unlimited is not None  # of a loop that is within a radius
    assert found.unlimited_per_agent is not None
    return Proposal(
        controller={"gain": gain, **sections},
        bound=found.unlimited,
        bound_per_agent=found.unlimited_per_agent,
        certified=found.radius is not None,
        command=found.command,
        stable_on_bodies=on_bodies,
        exchanges=found.exchanges,
        numbers=found.numbers,
        noise=found.noise,
    )
