"""The closed loop of a team, read off a run by differences, through `Session` alone.

A state of the run is moved by a little, and the run goes on for one control period. The difference at its end, for one
state after the other, is the matrix of the loop, whatever the law, its terms, the links and the vehicles are. Only
states that the agents' positions act on are moved, so that clocks, targets and random numbers are left out.

The method is that of the script `linearise_the_run`, by which the loops of this project were reviewed.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance

from mjsheaf import Session
from mjsheaf.law.in_python import Sample
from mjsheaf.law.law import disagreement
from mjsheaf.scenario import Scenario

Array = NDArray[np.float64]

STEP = 1e-6
"""Motion of a state, in its unit."""

_NEGLIGIBLE = 1e-8  # of a difference quotient that rounding makes
_AT_REST = 1e-6  # a mode that moves positions by less than this share of the most moving one is not counted
_NEUTRAL = 1e-7  # differences tell a factor from 1 by this


def spectral_radii(scenario: Scenario, backend: str, settling: float, *changed: Scenario) -> list[float]:
    """Return the largest factor of a mode that moves an agent, for one control period, of each of several laws.

    Args:
        scenario: Scenario of the run.
        backend: 'ideal' or 'physics'.
        settling: Time after which the team has settled, s.
        changed: Scenarios with other laws that remember the same, which continue there; the scenario's own if none.
    """
    with Session(scenario, backend, allow_drift=True) as session:
        while session.time < settling:
            session.step()
        state = session.state
    lines = (int(delay) + 1 for delay in scenario.system.law.links.table["delay"])
    periods, radii = math.lcm(*lines), []
    for each in changed or (scenario,):
        with Session(each, backend, allow_drift=True) as session:
            radii.append(float(np.abs(factors_of_loop(session, state, periods)).max()))
    return radii


def radii_in_a_medium(scenario: Scenario, gains: list[float], settling: float) -> list[float]:
    """Return the same at several gains, 1/s, of bodies in a medium that stands still or moves, under the paper's law.

    The team settles at the scenario's own gain, which must be stable. Then the gain changes and the desired
    disagreement with it, so that commands stay what they were.
    """
    own, at_rest = scenario.system.gain, np.zeros(3)
    used = {"gain": own}

    def law(_: float, sample: Sample) -> Array:
        return -own * at_rest - used["gain"] * (sample.disagreement - at_rest)

    with Session(scenario, controller=law, allow_drift=True) as session:
        while session.time < settling:
            session.step()
        state, system = session.state, session.engine.system
        at_rest = disagreement(system.law, session.observe().truth.positions)[: len(system.team.agents)]
        radii = []
        for gain in gains:
            used["gain"] = gain
            radii.append(float(np.abs(factors_of_loop(session, state)).max()))
    return radii


def factors_of_loop(session: Session, state: Array, periods: int = 1) -> NDArray[np.complex128]:
    """Return the factors over one control period of the modes that move an agent, less those of free coordinates.

    A coordinate that nothing holds, in the kernel of H, stays where it is: its factor is 1.

    Args:
        session: Session that takes the state.
        state: State about which the loop is linearised.
        periods: Control periods after which lines of delayed measurements hold them in the same places again.
    """
    places = np.array([_positions(session, moved) for moved in _moved(state)]).reshape(len(state), 2, -1)
    places = (places[:, 0] - places[:, 1]) / (2.0 * STEP)
    columns: dict[int, Array] = {}
    pending = np.flatnonzero(np.abs(places).max(axis=1) > 0.5).tolist()
    while pending:
        i = pending.pop()
        ahead, behind = (_state_after(session, moved, periods) for moved in _moved(state, i))
        columns[i] = (ahead - behind) / (2.0 * STEP)
        reached = np.flatnonzero(np.abs(columns[i]) > _NEGLIGIBLE).tolist()
        pending += [j for j in reached if j not in columns and j not in pending]
    chosen = sorted(columns)
    # States have units of their own, newtons as metres: balanced, those of a mode can be compared.
    A, units = matrix_balance(np.column_stack([columns[i][chosen] for i in chosen]), permute=False)
    factors, vectors = np.linalg.eig(A)
    motion = np.linalg.norm(places[chosen].T @ units @ vectors, axis=0) / np.linalg.norm(vectors, axis=0)
    taking_part = motion > _AT_REST * motion.max()
    H = session.engine.system.team.law_problem.H.toarray()
    if np.linalg.matrix_rank(H) < len(H):
        assert not session.engine.system.law.extended  # whose own modes may be neutral
        taking_part &= np.abs(factors - 1.0) > _NEUTRAL
    return np.asarray(factors[taking_part].astype(np.complex128) ** (1.0 / periods))


def _moved(state: Array, *chosen: int) -> Array:
    """Return the state with each of the chosen entries, or of all, moved up and down, shape (2 k, n)."""
    numbers = np.repeat(chosen or np.arange(len(state)), 2)
    states = np.tile(state, (len(numbers), 1))
    states[range(len(numbers)), numbers] += np.where(np.arange(len(numbers)) % 2, -STEP, STEP)
    return states


def _positions(session: Session, state: Array) -> Array:
    """Return the controlled coordinates of the agents in a state, m."""
    session.state = state
    dimensions = [agent.dimension for agent in session.engine.system.team.agents]
    return np.concatenate([x[:d] for x, d in zip(session.observe().truth.positions, dimensions, strict=False)])


def _state_after(session: Session, state: Array, periods: int) -> Array:
    """Return the state some control periods after a state."""
    session.state = state
    for _ in range(periods):
        session.step()
    return session.state
