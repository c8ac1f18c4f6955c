"""The paper's numbered assumptions, each with a verdict, the number behind it, and a witness."""

from dataclasses import dataclass
from typing import Literal

import networkx
import numpy as np
from numpy.typing import NDArray

from mjsheaf.checking.cohomology import RelativeCohomology
from mjsheaf.checking.constants import Constants, Region, tube_guessed
from mjsheaf.dynamics.bounds import singular_points
from mjsheaf.dynamics.effectiveness import is_rank_deficient
from mjsheaf.io.section import Finite, Record
from mjsheaf.system import System
from mjsheaf.team import Edge, Team

Array = NDArray[np.float64]
Verdict = Literal["holds", "fails", "undecided"]


class Assumption(Record):
    """A numbered assumption of the paper."""

    number: int
    name: str
    verdict: Verdict
    value: Finite
    unit: str
    witness: str

    @property
    def failure(self) -> str:
        """Why it does not hold, in a sentence; empty where it holds."""
        word = {"holds": "", "fails": "fails", "undecided": "is undecided"}[self.verdict]
        return word and f"assumption {self.number} {word}: {self.witness}"


def _assumption(number: int, name: str, verdict: Verdict, value: float | None, unit: str, witness: str) -> Assumption:
    return Assumption(number=number, name=name, verdict=verdict, value=value, unit=unit, witness=witness)


@dataclass(frozen=True)
class _Effectiveness:
    """Singular values of the g of an agent or a kind of body, largest first, and the units of g and of g^+."""

    who: str
    singular: NDArray[np.floating]
    unit: str
    inverse_unit: str


def decide(system: System, region: Region, constants: Constants, cohomology: RelativeCohomology) -> list[Assumption]:
    """Decide all seven assumptions over a region."""
    smooth, effectiveness = _smooth(system, region, constants), _effectiveness(system)
    return [
        smooth,
        _full_row_rank(effectiveness),
        _disturbances(constants),
        _bounded_inverse(effectiveness),
        _topology(system.team),
        _cohomology(cohomology),
        _bounded_difference(region, constants, smooth, cohomology.dimension > 0),
    ]


def _smooth(system: System, region: Region, constants: Constants) -> Assumption:
    """A singularity with a core is smooth everywhere; without one it matters where an agent can reach its centre."""
    name, N, V = "f is continuously differentiable", len(system.team.agents), len(system.team.members)
    rho = constants.rho
    at = ", ".join(f"{x:.3g}" for x in np.atleast_1d(rho.where))
    if _has_poles(system, N, V) and region.path.cells is None:
        witness = (
            f"a kernel of the flow that targets meet has no core, and their path is not known: {region.path.warning}"
        )
        return _assumption(1, name, "undecided", None, "1/s", witness)
    if not _has_poles(system, 0, N):
        steepest = f"every kernel is smooth; the agents' field is steepest near ({at})"
        witness = steepest if rho.upper > 0.0 else "no agent's drift depends on where it is"
        return _assumption(1, name, "holds", rho.upper, "1/s", witness)
    if region.verified and np.isfinite(rho.upper):
        witness = f"the singular kernels lie outside the agents' region, where the field is steepest near ({at})"
        return _assumption(1, name, "holds", rho.upper, "1/s", witness)
    between = tube_guessed(system, region.path, margin=0.0).slope
    if not np.isfinite(between.upper):
        at = ", ".join(f"{x:.3g}" for x in np.atleast_1d(between.where))
        witness = f"the field that agents meet is singular at ({at}), inside their region: a core radius is 0"
        return _assumption(1, name, "fails", None, "1/s", witness)
    witness = "a kernel of the flow that agents meet has no core, and nothing proves that they keep away from it"
    return _assumption(1, name, "undecided", None, "1/s", witness)


def _has_poles(system: System, first: int, last: int) -> bool:
    return any(len(singular_points(flow, planar=planar)) for flow, planar in system.fields_met(first, last))


def _full_row_rank(effectiveness: list[_Effectiveness]) -> Assumption:
    """g = R W with a rotation R: its singular values are those of W, wherever the agent is."""
    name = "g has full row rank"
    where = "the same at every position and heading, as g only turns with them"
    for g in effectiveness:
        if is_rank_deficient(g.singular):
            witness = f"{g.who} cannot push in every direction of its state space, {where}"
            return _assumption(2, name, "fails", float(g.singular[-1]), g.unit, witness)
    least = min(effectiveness, key=lambda g: g.singular[-1])
    witness = f"smallest singular value, that of {least.who}; {where}"
    return _assumption(2, name, "holds", float(least.singular[-1]), least.unit, witness)


def _effectiveness(system: System) -> list[_Effectiveness]:
    """The g that the scenario gives for the ideal backend; for agents without one, that of the reduced model."""
    vehicles = dict(zip(system.bodies.vehicle, system.vehicles, strict=True))
    given, agents = system.effectiveness.given, system.team.agents
    found = [
        _Effectiveness(a.id, np.linalg.svd(system.effectiveness.W[i, : a.dimension], compute_uv=False), "", "")
        for i, a in enumerate(agents)
        if given[i]
    ]
    for name in dict.fromkeys(name for i, name in enumerate(system.bodies.vehicle[: len(agents)]) if not given[i]):
        singular = np.linalg.svd(vehicles[name].reduced_model().g(np.eye(3)), compute_uv=False)
        found.append(_Effectiveness(f"body {name}", singular, "m/s per unit command", "units of command per m/s"))
    return found


def _disturbances(constants: Constants) -> Assumption:
    largest = constants.largest_disturbance
    witness = "there is no disturbance" if largest == 0.0 else "sums of sines: continuous, and bounded by construction"
    return _assumption(3, "disturbances are continuous and bounded", "holds", largest, "m/s", witness)


def _bounded_inverse(effectiveness: list[_Effectiveness]) -> Assumption:
    name = "g^+ is continuous and bounded"
    for g in effectiveness:
        if is_rank_deficient(g.singular):
            witness = f"g of {g.who} loses rank, so that g^+ is not bounded near it"
            return _assumption(4, name, "fails", None, "", witness)
    least = min(effectiveness, key=lambda g: g.singular[-1])
    witness = f"largest gain of g^+, that of {least.who}"
    return _assumption(4, name, "holds", float(1.0 / least.singular[-1]), least.inverse_unit, witness)


def _topology(team: Team) -> Assumption:
    graph = networkx.Graph()
    graph.add_nodes_from(team.agent_ids)
    links = [e for e in team.communication if _couples(e)]
    graph.add_edges_from((e.tail, e.head) for e in links)
    parts = [sorted(part, key=team.agent_ids.index) for part in networkx.connected_components(graph)]
    sensed = {e.head for e in team.sensing if _couples(e)}
    unseen = [t for t in team.target_ids if t not in sensed]
    warnings = []
    if len(parts) > 1:
        listed = "; ".join("{" + ", ".join(p[:6]) + (", ..." if len(p) > 6 else "") + "}" for p in parts[:4])
        warnings.append(f"the agents fall into {len(parts)} parts: {listed}{'; ...' if len(parts) > 4 else ''}")
    if unseen:
        warnings.append(f"no agent senses {', '.join(unseen[:8])}{', ...' if len(unseen) > 8 else ''}")
    witness = "; ".join(warnings) or (f"{len(links)} links connect {len(team.agents)} agents; every target is sensed")
    name = "G_q is connected and every target is sensed"
    return _assumption(
        5, name, "fails" if warnings else "holds", float(len(parts)), "part" if len(parts) == 1 else "parts", witness
    )


def _couples(edge: Edge) -> bool:
    """Whether an edge couples its ends: F_i^T K F_j is not zero."""
    return bool(np.any(edge.F_tail.T @ edge.weight @ edge.F_head))


def _cohomology(cohomology: RelativeCohomology) -> Assumption:
    free = [direction.description for direction in cohomology.basis]
    witness = "; ".join(free[:4]) + ("; ..." if len(free) > 4 else "") if free else "no agent is free to drift"
    verdict: Verdict = "fails" if free else "holds"
    return _assumption(6, "H^0(G, G_p; F) = 0", verdict, float(cohomology.dimension), "", witness)


def _bounded_difference(region: Region, constants: Constants, smooth: Assumption, free: bool) -> Assumption:
    """The paper asks for it over all p; its proof uses only the path that the targets take, as here."""
    name = "bounded difference of target and agent dynamics, along the targets' path"
    value = constants.difference.bound
    if smooth.verdict == "fails":
        return _assumption(
            7, name, "fails", None, "m/s", "a field is unbounded inside the region: a core radius is 0 there"
        )
    if region.path.warning:
        return _assumption(7, name, "undecided", None, "m/s", f"the path is not known: {region.path.warning}")
    if free:
        return _assumption(7, name, "undecided", value, "m/s", "q* is not unique, so that f_q(q*) is not defined")
    if not np.isfinite(value):
        return _assumption(7, name, "undecided", None, "m/s", "q* or a target comes near a singular kernel of the flow")
    where = f"largest about t = {constants.difference.time:.4g} s"
    return _assumption(7, name, "holds", value, "m/s", f"{where}; the path is followed to {region.path.error:.1g} m")
