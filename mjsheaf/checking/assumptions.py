"""The paper's numbered assumptions, each with a verdict, the number behind it, and a witness."""

from dataclasses import dataclass
from typing import Literal

import networkx
import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics import Vehicle, vehicles_of
from mjsheaf.backends.system import System
from mjsheaf.checking.cohomology import RelativeCohomology
from mjsheaf.checking.constants import Constants
from mjsheaf.checking.region import Region
from mjsheaf.dynamics.bounds import lipschitz_constant
from mjsheaf.dynamics.effectiveness import is_rank_deficient
from mjsheaf.team import Team

Array = NDArray[np.float64]
Verdict = Literal["holds", "fails", "undecided"]


@dataclass(frozen=True)
class Assumption:
    """One of the paper's assumptions.

    Attributes:
        number: in the paper.
        name: what it says, in a few words.
        verdict: 'holds', 'fails', or 'undecided' where nothing here can decide it.
        value: the number behind the verdict, or None.
        unit: of the value.
        witness: what shows it, in the words of the team.
    """

    number: int
    name: str
    verdict: Verdict
    value: float | None
    unit: str
    witness: str


def decide(system: System, region: Region, constants: Constants, cohomology: RelativeCohomology) -> list[Assumption]:
    """Decide all seven assumptions over a region."""
    vehicles = dict(zip(system.bodies.vehicle, vehicles_of(system), strict=True))
    return [
        _smooth(system, region, constants),
        _full_row_rank(system, vehicles),
        _disturbances(constants),
        _bounded_inverse(system, vehicles),
        _topology(system.team),
        _cohomology(cohomology),
        _bounded_difference(region, constants),
    ]


def _smooth(system: System, region: Region, constants: Constants) -> Assumption:
    name = "f is continuously differentiable"
    targets = region.path.positions[:, len(system.team.agents) :]
    low, high = targets.min(axis=(0, 1)), targets.max(axis=(0, 1))
    met = system.fields_met(len(system.team.agents), len(system.team.members))
    steepest = constants.lipschitz
    own = [lipschitz_constant(flow, low, high, planar=planar) for flow, planar in met]
    for whom, found in (("agents", [steepest]), ("targets", own)):
        for slope in found:
            if not np.isfinite(slope.upper):
                at = ", ".join(f"{x:.3g}" for x in np.atleast_1d(slope.where))
                witness = f"the field that {whom} meet is singular at ({at}), inside their region: a core radius is 0"
                return Assumption(1, name, "fails", None, "1/s", witness)
    at = ", ".join(f"{x:.3g}" for x in np.atleast_1d(steepest.where))
    witness = "no agent's drift depends on where it is"
    if steepest.upper > 0.0:
        witness = f"every kernel is smooth over the region; the agents' field is steepest near ({at})"
    return Assumption(1, name, "holds", steepest.upper, "1/s", witness)


def _full_row_rank(system: System, vehicles: dict[str, Vehicle]) -> Assumption:
    """g = R W with a rotation R: its singular values are those of W, wherever the agent is."""
    name = "g has full row rank"
    where = "the same at every position and heading, as g only turns with them"
    found, unit = _singular_values(system, vehicles)
    for who, singular in found:
        if is_rank_deficient(singular):
            witness = f"{who} cannot push in every direction of its state space, {where}"
            return Assumption(2, name, "fails", float(singular[-1]), unit, witness)
    who, singular = min(found, key=lambda item: item[1][-1])
    return Assumption(2, name, "holds", float(singular[-1]), unit, f"smallest singular value, that of {who}; {where}")


def _singular_values(
    system: System, vehicles: dict[str, Vehicle]
) -> tuple[list[tuple[str, NDArray[np.floating]]], str]:
    """Singular values of g, largest first, of each agent or kind of body, and their unit.

    g is what the scenario gives for the ideal backend; where it gives none, that of the bodies' reduced model.
    """
    effectiveness = system.effectiveness
    given = [
        (agent.id, np.linalg.svd(effectiveness.W[i, : agent.dimension], compute_uv=False))
        for i, agent in enumerate(system.team.agents)
        if effectiveness.given[i]
    ]
    if given:
        return given, ""
    bodies = dict.fromkeys(system.bodies.vehicle[: len(system.team.agents)])
    return [
        (f"body {name}", np.linalg.svd(vehicles[name].reduced_model().g(np.eye(3)), compute_uv=False))
        for name in bodies
    ], "m/s per unit command"


def _disturbances(constants: Constants) -> Assumption:
    largest = constants.largest_disturbance
    witness = "there is no disturbance" if largest == 0.0 else "sums of sines: continuous, and bounded by construction"
    return Assumption(3, "disturbances are continuous and bounded", "holds", largest, "m/s", witness)


def _bounded_inverse(system: System, vehicles: dict[str, Vehicle]) -> Assumption:
    name = "g^+ is continuous and bounded"
    found, unit = _singular_values(system, vehicles)
    for who, singular in found:
        if is_rank_deficient(singular):
            return Assumption(4, name, "fails", None, "", f"g of {who} loses rank, so that g^+ is not bounded near it")
    who, singular = min(found, key=lambda item: item[1][-1])
    unit = "units of command per m/s" if unit else ""
    return Assumption(4, name, "holds", float(1.0 / singular[-1]), unit, f"largest gain of g^+, that of {who}")


def _topology(team: Team) -> Assumption:
    graph = networkx.Graph()
    graph.add_nodes_from(team.agent_ids)
    graph.add_edges_from((e.tail, e.head) for e in team.communication)
    parts = [sorted(part, key=team.agent_ids.index) for part in networkx.connected_components(graph)]
    sensed = {e.head for e in team.sensing}
    unseen = [t for t in team.target_ids if t not in sensed]
    complaints = []
    if len(parts) > 1:
        listed = "; ".join("{" + ", ".join(p[:6]) + (", ..." if len(p) > 6 else "") + "}" for p in parts[:4])
        complaints.append(f"the agents fall into {len(parts)} parts: {listed}{'; ...' if len(parts) > 4 else ''}")
    if unseen:
        complaints.append(f"no agent senses {', '.join(unseen[:8])}{', ...' if len(unseen) > 8 else ''}")
    witness = "; ".join(complaints) or (
        f"{len(team.communication)} links connect {len(team.agents)} agents; every target is sensed"
    )
    name = "G_q is connected and every target is sensed"
    return Assumption(
        5, name, "fails" if complaints else "holds", float(len(parts)), "part" if len(parts) == 1 else "parts", witness
    )


def _cohomology(cohomology: RelativeCohomology) -> Assumption:
    free = [direction.description for direction in cohomology.basis]
    witness = "; ".join(free[:4]) + ("; ..." if len(free) > 4 else "") if free else "no agent is free to drift"
    verdict: Verdict = "fails" if free else "holds"
    return Assumption(6, "H^0(G, G_p; F) = 0", verdict, float(cohomology.dimension), "", witness)


def _bounded_difference(region: Region, constants: Constants) -> Assumption:
    name = "bounded difference of target and agent dynamics"
    if not np.isfinite(constants.f_bar) or not np.isfinite(constants.speed.upper):
        witness = "a field is unbounded inside the region: a core radius is 0 there"
        return Assumption(7, name, "fails", None, "m/s", witness)
    where = f"largest at t = {constants.f_bar_time:.4g} s, targets along their trajectories"
    if not region.verified:
        return Assumption(7, name, "undecided", constants.f_bar, "m/s", f"{where}; the region is {region.source}")
    return Assumption(7, name, "holds", constants.f_bar, "m/s", f"{where}; region: {region.source}")
