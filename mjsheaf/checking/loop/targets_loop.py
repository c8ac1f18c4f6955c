"""The targets' own law, consensus and pull, held over a period: does it decay?

With p the stacked positions of the targets, k_T the gain of their consensus, L_T its Laplacian and P = diag(pull), the
law commands v(t) + P (r(t) - p) - k_T (L_T p - c_T). Held over a period h on ideal kinematics, where a flow and a
disturbance only add to what drives it,

    p_{k+1} = (I - h S) p_k + ...,    S = k_T L_T + P,

and S is symmetric and positive semidefinite. In an eigenvector of S with the eigenvalue mu > 0 the factor is 1 - h mu:
it decays exactly if h mu < 2. Where mu = 0 nothing acts on the targets, and nothing of the law can diverge. So the law
is stable exactly if h lambda_max(S) < 2. The continuous law, p' = -S p + ..., always is.

On bodies the same commands go to vehicles with inertia: see `body_loop`.
"""

import numpy as np
from pydantic import Field
from scipy import sparse
from scipy.sparse.linalg import eigsh

from mjsheaf.arrays import Array
from mjsheaf.errors import listed
from mjsheaf.section import Finite, Record
from mjsheaf.system import System

_DENSE = 600  # rows of S whose eigenvalues are all computed
_LIMIT = 2.0 - 1e-9  # of h lambda_max(S): what decays stays below it
_INVOLVED = 0.5  # of the largest motion in the fastest mode: a target that moves as much is named


class TargetsOnBodies(Record):
    """The targets' law closed through the vehicles that carry targets, for small motions."""

    stable: bool | None = Field(description="whether every mode that the law acts on decays; null: see reason")
    spectral_radius: Finite = Field(
        description="largest factor of a mode that moves a position, over a control period; null where undecided"
    )
    reason: str = Field(description="why it is undecided, or empty")


class TargetsLoop(Record):
    """The targets' own law, consensus and pull, as it is held over a control period."""

    stable: bool = Field(description="on ideal kinematics; the continuous law always is")
    rate: float = Field(description="lambda_max(k_T L_T + pull), 1/s; 0 where targets follow neither path nor others")
    product: Finite = Field(description="control period times rate: stable below 2; null where the law is continuous")
    spectral_radius: Finite = Field(
        description="largest |1 - h mu| over the rates mu > 0 of its modes; null where there are none, or the law is "
        "continuous"
    )
    parts: list[str] = Field(description="what acts on targets: pull, consensus")
    targets: list[str] = Field(description="targets that move most in the fastest mode, where it does not decay")
    largest_period: Finite = Field(description="2 / rate: control periods below it are stable, s; null where rate is 0")
    bodies: TargetsOnBodies | None = Field(
        None, description="the same law on the targets' vehicles; null where it was not looked at, or rate is 0"
    )

    def verdict(self) -> str:
        """The loop in a sentence, with the fix where it is unstable."""
        if not self.stable:
            fixes = {"pull": "motion.pull", "consensus": "target_formation.gain"}
            lower = " or ".join(fixes[part] for part in self.parts)
            return (
                f"{self.failure}; choose controller.control_period below {self.largest_period:.4g} s, "
                f"or a lower {lower}"
            )
        if self.bodies is not None and self.bodies.stable is False:
            return (
                "the targets' own law is unstable on their vehicles (spectral radius "
                f"{self.bodies.spectral_radius:.4g}); choose a lower motion.pull or target_formation.gain"
            )
        return "the targets' own law is stable"

    @property
    def failure(self) -> str:
        """Why the law diverges on ideal kinematics; empty where it does not."""
        if self.stable:
            return ""
        return (
            f"the targets' own held law diverges: {' and '.join(self.parts)} of {listed(self.targets)} at "
            f"{self.rate:.4g} 1/s times the control period is {self.product:.4g}, expected below 2"
        )

    @property
    def unstable(self) -> bool:
        """Return True if it diverges, on ideal kinematics or on bodies."""
        return not self.stable or (self.bodies is not None and self.bodies.stable is False)


def targets_loop(system: System) -> TargetsLoop:
    """Decide whether the targets' own law decays on ideal kinematics."""
    S = stiffness(system)
    rate, vector = _largest(S)
    h = system.grid.period
    held = rate > 0.0 and not system.grid.continuous
    stable = not held or h * rate < _LIMIT
    return TargetsLoop(
        stable=stable,
        rate=rate,
        product=None if system.grid.continuous else h * rate,
        spectral_radius=_radius(S, h, rate) if held else None,
        parts=_parts(system),
        targets=[] if stable else _involved(system, vector),
        largest_period=2.0 / rate if rate > 0.0 else None,
    )


def stiffness(system: System) -> sparse.csr_array:
    """S = k_T L_T + P on the stacked positions of the targets, shape (n_p, n_p), 1/s.

    Rows and columns of targets without consensus, such as fixed ones, are 0: they move no other target's poles.
    """
    team, N = system.team, len(system.team.agents)
    if not team.targets:
        return sparse.csr_array((0, 0))
    pull = np.repeat(system.motion.pull[N:], [target.dimension for target in team.targets])
    gain = float(system.law.gain[N:].max(initial=0.0))
    acts = sparse.diags_array(np.repeat(system.law.gain[N:] > 0.0, [target.dimension for target in team.targets]) * 1.0)
    return sparse.csr_array(gain * (acts @ team.target_sheaf.laplacian() @ acts) + sparse.diags_array(pull))


def _largest(S: sparse.csr_array) -> tuple[float, Array]:
    """The largest eigenvalue of S, 1/s, and its eigenvector."""
    if not S.nnz or not abs(S).max() > 0.0:
        return 0.0, np.zeros(S.shape[0])
    if S.shape[0] <= _DENSE:
        values, vectors = np.linalg.eigh(S.toarray())
        return max(float(values[-1]), 0.0), vectors[:, -1]
    top, vector = eigsh(S, k=1, which="LA", v0=np.ones(S.shape[0]))
    return float(top[0]), vector[:, 0]


def _radius(S: sparse.csr_array, h: float, rate: float) -> float:
    """The largest |1 - h mu| over the eigenvalues mu > 0 of S; of many targets that of the largest alone."""
    if S.shape[0] > _DENSE:
        return abs(1.0 - h * rate)
    values = np.linalg.eigvalsh(S.toarray())
    return float(np.abs(1.0 - h * values[values > 1e-12 * rate]).max())


def _parts(system: System) -> list[str]:
    """Return the parts that the targets' law has."""
    N = len(system.team.agents)
    acts = {
        "pull": bool(system.motion.pull[N:].any()),
        "consensus": bool(system.law.gain[N:].any() and system.team.target_edges),
    }
    return [name for name, on in acts.items() if on]


def _involved(system: System, vector: Array) -> list[str]:
    """The targets that move most in a mode."""
    ends = np.cumsum([target.dimension for target in system.team.targets])
    moved = np.array([np.linalg.norm(part) for part in np.split(vector, ends[:-1])])
    return [system.team.target_ids[k] for k in np.flatnonzero(moved >= _INVOLVED * moved.max())]
