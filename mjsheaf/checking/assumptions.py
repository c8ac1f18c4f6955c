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
from mjsheaf.team import Team

Array = NDArray[np.float64]
Verdict = Literal["holds", "fails", "undecided"]

_RANK_TOLERANCE = 1e-9


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
        _smooth(system, constants),
        _full_row_rank(system, vehicles),
        _disturbances(constants),
        _bounded_inverse(system, vehicles),
        _topology(system.team),
        _cohomology(cohomology),
        _bounded_difference(region, constants),
    ]


def _smooth(system: System, constants: Constants) -> Assumption:
    name = "f is continuously differentiable"
    for whom, field in (("agents", system.agent_flow), ("targets", system.target_flow)):
        if field.core == 0.0 and (len(field.sources) or len(field.vortices)):
            kernel = (*field.sources, *field.vortices)[0]
            centre = ", ".join(f"{x:g}" for x in kernel[: field.dimension])
            return Assumption(
                1,
                name,
                "fails",
                None,
                "1/s",
                f"the field of the {whom} is singular at ({centre}): its core radius is 0",
            )
    steepest = constants.lipschitz
    at = ", ".join(f"{x:.3g}" for x in np.atleast_1d(steepest.where))
    witness = "no agent's drift depends on where it is"
    if steepest.upper > 0.0:
        witness = f"every kernel is smooth; the agents' field is steepest near ({at})"
    return Assumption(1, name, "holds", steepest.upper, "1/s", witness)


def _full_row_rank(system: System, vehicles: dict[str, Vehicle]) -> Assumption:
    """g = R W with a rotation R: its singular values are those of W, wherever the agent is."""
    who, singular, unit = _least_effective(system, vehicles)
    where = "the same at every position and heading, as g only turns with them"
    if _deficient(singular):
        witness = f"{who} cannot push in every direction of its state space, {where}"
        return Assumption(2, "g has full row rank", "fails", float(singular[-1]), unit, witness)
    witness = f"smallest singular value, for its size least on {who}; {where}"
    return Assumption(2, "g has full row rank", "holds", float(singular[-1]), unit, witness)


def _least_effective(system: System, vehicles: dict[str, Vehicle]) -> tuple[str, NDArray[np.floating], str]:
    """The agent whose g is nearest to losing rank: who, its singular values, and their unit.

    g is what the ideal backend uses where the scenario gives one, and that of the reduced model of its body.
    """
    found: list[tuple[str, NDArray[np.floating], str]] = []
    bodies = {
        name: np.linalg.svd(vehicle.control_effectiveness(np.eye(3)), compute_uv=False)
        for name, vehicle in vehicles.items()
    }
    for i, agent in enumerate(system.team.agents):
        if system.effectiveness.given[i]:
            W = system.effectiveness.W[i, : agent.dimension]
            found.append((f"{agent.id} (as given for the ideal backend)", np.linalg.svd(W, compute_uv=False), ""))
        name = system.bodies.vehicle[i]
        found.append((f"{agent.id} (body {name})", bodies[name], "m/s per unit command"))
    return min(found, key=lambda item: item[1][-1] / max(item[1][0], 1e-300))


def _deficient(singular: NDArray[np.floating]) -> bool:
    return bool(singular[-1] <= _RANK_TOLERANCE * singular[0])


def _disturbances(constants: Constants) -> Assumption:
    largest = constants.largest_disturbance
    witness = "there is no disturbance" if largest == 0.0 else "sums of sines: continuous, and bounded by construction"
    return Assumption(3, "disturbances are continuous and bounded", "holds", largest, "m/s", witness)


def _bounded_inverse(system: System, vehicles: dict[str, Vehicle]) -> Assumption:
    name = "g^+ is continuous and bounded"
    who, singular, unit = _least_effective(system, vehicles)
    if _deficient(singular):
        return Assumption(4, name, "fails", None, "", f"g of {who} loses rank, so that g^+ is not bounded near it")
    unit = "units of command per m/s" if unit else ""
    return Assumption(4, name, "holds", float(1.0 / singular[-1]), unit, f"largest gain of g^+, on {who}")


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
    return Assumption(5, name, "fails" if complaints else "holds", float(len(parts)), "parts", witness)


def _cohomology(cohomology: RelativeCohomology) -> Assumption:
    free = [direction.description for direction in cohomology.basis]
    witness = "; ".join(free[:4]) + ("; ..." if len(free) > 4 else "") if free else "no agent is free to drift"
    verdict: Verdict = "fails" if free else "holds"
    return Assumption(6, "H^0(G, G_p; F) = 0", verdict, float(cohomology.dimension), "dimensions", witness)


def _bounded_difference(region: Region, constants: Constants) -> Assumption:
    name = "bounded difference of target and agent dynamics"
    if not np.isfinite(constants.f_bar) or not np.isfinite(constants.speed.upper):
        return Assumption(
            7, name, "fails", None, "m/s", "the agents' field is unbounded in their region: a core radius is 0 there"
        )
    witness = f"largest at t = {constants.f_bar_time:.4g} s; targets along their trajectories, from {region.source}"
    return Assumption(7, name, "holds", constants.f_bar, "m/s", witness)
