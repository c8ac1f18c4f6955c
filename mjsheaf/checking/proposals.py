"""Changes that bring the error of a run below a desired radius: terms, rounds and gain, and their cost."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

from pydantic import Field

from mjsheaf.checking.loop.body_loop import loop_on_path
from mjsheaf.checking.loop.held_law import LawLoop, envelope, law_loop, loop_of
from mjsheaf.checking.theorem.certificate import Certificate
from mjsheaf.errors import UndecidedError
from mjsheaf.law.terms import Drift, Feedforward, Newton, Odometry, Terms, pack_terms
from mjsheaf.section import OF_TEAM, TEAM_NORM, Finite, Norm, Record
from mjsheaf.system import System


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


def propose(
    system: System,
    certificate: Certificate,
    radius: float,
    *,
    gains: Sequence[float] = (1.0, 2.0, 5.0, 10.0),
    rounds: Sequence[int] = (1, 2, 3, 5, 8, 13),
    filtering: float = 0.1,
    most: int = 3_000_000,
) -> list[Proposal]:
    """Find the cheapest of each kind of law whose bound is at most the radius: the smallest gain, then fewest rounds.

    The kinds are the paper's law; feedforward; Newton's direction too; drift and extrapolation too. None is proposed
    where nothing can be decided, where links are not exact, or where the run is long.

    Args:
        system: System under its law.
        certificate: Its certificate.
        radius: Desired bound on |e|, m.
        gains: Gains that are tried, times the scenario's.
        rounds: Rounds of exchange that are tried.
        filtering: Filter of the drift's observer, s.
        most: Largest number of samples times states.
    """
    try:
        loop_of(system)  # where it is undecided, as with rounds that can be delayed or lost, so are its variants
    except UndecidedError:
        return []
    if (
        system.team.linearised_at is not None
        or len(system.law.links.table)
        or system.grid.steps * system.team.dirichlet.H.shape[0] > most
    ):
        return []
    odometry = Odometry(noise=system.law.terms.noise, bias=system.law.terms.bias)
    proposals = []
    for kind in range(4):
        terms = [
            Terms(
                feedforward=Feedforward(rounds=r, extrapolate=kind == 3) if kind else None,
                newton=Newton(rounds=r) if kind > 1 else None,
                drift=Drift(filter=filtering) if kind == 3 else None,
                odometry=odometry,
            )
            for r in (rounds if kind else [1])
        ]
        for gain in (factor * system.gain for factor in gains):
            laws = [_law(system, gain, each) for each in terms]
            # More rounds leave less, or nearly so: the first number that does it is found by halves.
            first = bisect_left(laws, True, key=lambda law: _keeps(law, certificate, radius))
            if first < len(laws):
                on_bodies = loop_on_path(laws[first], certificate).stable
                found = law_loop(laws[first], certificate)
                proposals.append(_proposal(gain, terms[first], system.law.term_names, found, on_bodies))
                break
    return proposals


def _law(system: System, gain: float, terms: Terms) -> System:
    """The system under another law."""
    gains = system.law.gain.copy()
    gains[: len(system.team.agents)] = gain
    packed = pack_terms(terms, system.team, system.grid.period)
    return replace(system, gain=gain, law=system.law._replace(gain=gains, terms=packed))


def _keeps(system: System, certificate: Certificate, radius: float, *, reserve: float = 2.0) -> bool:
    """Return True if the law's bound is at most the radius, m, and `reserve` times its gain is stable."""
    try:
        loop = loop_of(system)
        stable = max(loop.radius, replace(loop, gain=reserve * loop.gain).radius) < 1.0
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
