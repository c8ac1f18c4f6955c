"""Linear model of a law, obtained by running its compiled stages.

A team of one agent whose edges have the total weight lambda has H = lambda I. So in an eigenvector of H, the law of any
team is the law of that agent. Its compiled stages are run once for every state of the law and for every input, with
only that one changed from rest. The differences are the columns of

    x_{k+1} = A x_k + B w_k,    u_k = C x_k + D w_k,

with u the command, x the state of the law, and w its inputs (see `INPUTS`). No formula of a term is written here: the
model contains whatever the stages do. It is computed along one axis. The law is undecided if its responses to motions
of many sizes, along all axes at once and over many samples, differ from those of the model along each axis. It is also
undecided if registered terms keep changing at rest, if their memory is not proportional to the motion, or if it stores
only initial values, which no later input changes.

The agent has two edges to points at rest, each with half of the weight. Feedforward uses only the first to measure
velocities. So the responses to measurement errors on the two edges differ by the contribution of feedforward.
"""

from dataclasses import dataclass
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order

from mjsheaf.arrays import Array, IntArray
from mjsheaf.compile.jit import jit
from mjsheaf.compile.remember import remember_last
from mjsheaf.compile.tiers import tiered
from mjsheaf.errors import UndecidedError, listed, select_true
from mjsheaf.law.custom import names_of
from mjsheaf.law.edges import LinkArrays
from mjsheaf.law.law import ControlArrays, EdgeArrays, LawArrays, evaluate_law, new_memory
from mjsheaf.law.paths import MotionArrays
from mjsheaf.law.terms import RoundArrays
from mjsheaf.loop.system import System

INPUTS = ("position", "eta", "sensed", "sensed_motion", "own_motion")
"""Inputs of the model: the agent's position, m; errors of eta, of the sum of F^T K y over sensing edges, and of the
displacement that is added to this sum (each in units of eta, m); and errors of the displacement that other terms use,
m."""

_MOTION = 2.0**-20  # m, from rest: a power of two, so that a linear law scales without rounding
_OTHER_MOTIONS = (2.0**-34, -(2.0**-20), 2.0**-12, -(2.0**-6), 1.0, -(2.0**5), 2.0**10)  # m, to test linearity
_LINEAR = 1e-9  # relative difference of two responses of a linear law
_NEGLIGIBLE = 1e-11  # relative size below which a new direction is rounding
_GENERIC_GAIN = 0.7390851332  # 1/s; terms do not cancel -k1 eta by chance at this gain
_GENERIC = np.array([[0.685, 0.685]])  # weights of the two edges at which it is
_STILL = np.zeros((1, 3, 3))
_MOVED_POINTS = _MOTION * np.eye(9).reshape(3, 3, 3, 3).swapaxes(0, 1)  # along an axis: agent, first point, second


class LinearController(NamedTuple):
    """A linear law from k inputs w to commands, u = C x + D w with x+ = A x + B w, with one matrix each or L of them.

    Attributes:
        A: Shape (..., r, r).
        B: Shape (..., r, k).
        C: Shape (..., n, r).
        D: Shape (..., n, k).
    """

    A: Array
    B: Array
    C: Array
    D: Array


def without_memory(D: Array) -> LinearController:
    """Return the law u = D q, with D of shape (n, k), 1/s."""
    return LinearController(np.zeros((0, 0)), np.zeros((0, D.shape[1])), np.zeros((len(D), 0)), D)


@dataclass(frozen=True)
class LinearLaw:
    """Linear model of the law in L eigenvectors of H, with n states and m inputs; see the module.

    Attributes:
        A: Shape (L, n, n).
        B: Shape (L, n, m).
        C: Shape (L, n).
        D: Shape (L, m).
        integral: The integral of eta as a row on x, shape (n,), m s.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    integral: Array

    @property
    def basis(self) -> Array:
        """Basis of the states that a position excites and a command depends on in any eigenvector, shape (n, r)."""
        excited = _invariant_basis(self.A, self.B[:, :, 0], np.abs(self.B[:, :, 0]))
        inner = excited.T @ self.A @ excited
        return np.asarray(
            excited @ _invariant_basis(inner.swapaxes(1, 2), self.C @ excited, np.abs(self.C) @ np.abs(excited))
        )

    def feedback(self, basis: Array) -> "LinearLaw":
        """Return the model from position to command alone, on coordinates in a `basis` (n, r) of the states."""
        return LinearLaw(
            basis.T @ self.A @ basis,
            basis.T @ self.B[:, :, :1],
            self.C @ basis,
            self.D[:, :1].copy(),
            self.integral @ basis,
        )

    def alike(self, axes: int) -> LinearController:
        """Return the law of one vehicle, the same along `axes` axes, for each eigenvalue; shapes start with L."""
        return LinearController(
            *(
                (part[:, :, None, :, None] * np.eye(axes)[:, None]).reshape(
                    len(part), part.shape[1] * axes, part.shape[2] * axes
                )
                for part in (self.A, self.B, self.C[:, None], self.D[:, None])
            )
        )

    def of_team(self, vectors: Array) -> LinearController:
        """Return the law of a whole team, with n times L states.

        Args:
            vectors: Eigenvectors of H, shape (N, L). Each of the m inputs has N coordinates, one input after the other.
        """
        L, n, m = self.B.shape
        N = len(vectors)
        A = np.zeros((n, L, n, L))
        A[:, range(L), :, range(L)] = self.A
        return LinearController(
            A.reshape(n * L, n * L),
            np.einsum("lnm,kl->nlmk", self.B, vectors).reshape(n * L, m * N),
            np.einsum("kl,ln->knl", vectors, self.C).reshape(N, n * L),
            (vectors * self.D.T[:, None] @ vectors.T).swapaxes(0, 1).reshape(N, m * N),
        )


def _invariant_basis(A: Array, b: Array, size: Array) -> Array:
    """Return an orthonormal basis of the smallest space with all b (L, n) that is invariant under all A (L, n, n).

    A value counts as rounding if it is small relative to its summands; those of b have `size` (L, n).
    """
    n = b.shape[1]
    basis = np.zeros((n, 0))
    pending = b
    while len(pending) and basis.shape[1] < n:
        length = np.linalg.norm(pending, axis=1)
        counts = length > _NEGLIGIBLE * np.linalg.norm(size, axis=1)
        pending = pending[counts] / length[counts, None]
        rest = pending - pending @ basis @ basis.T
        _, sizes, rows = np.linalg.svd(rest, full_matrices=False)
        found = rows[sizes > _NEGLIGIBLE * np.sqrt(max(len(rest), 1))]
        found = np.linalg.qr((found - found @ basis @ basis.T).T)[0].T  # twice, for orthogonality
        basis = np.column_stack([basis, found.T])
        pending = (A @ found.T).swapaxes(1, 2).reshape(-1, n)
        size = (np.abs(A) @ np.abs(found.T)).swapaxes(1, 2).reshape(-1, n)
    return basis


def _model_key(law: LawArrays, period: float) -> tuple[Any, ...]:
    """Return everything on which the model of a law depends."""
    alone = _one_agent(law)
    return (*alone.law.terms, alone.law.custom, alone.law.edges.F_tail, period)


@remember_last(_model_key, most=200)
def model_of(law: LawArrays, period: float) -> "LawModel":
    """Return the linear model of a team's law with a control period, s; teams with the same terms share it.

    Raises:
        UndecidedError: The law is not linear.
    """
    return LawModel(_one_agent(law), period)


class LawModel:
    """Linear model of a team's law for any gain, in any eigenvectors of H.

    Args:
        alone: Law of one agent, without noise, losses and limits.
        period: Control period, s.

    Attributes:
        plain: True if the law is that of the paper, u = -k1 eta.

    Raises:
        UndecidedError: The law is not linear.
    """

    def __init__(self, alone: ControlArrays, period: float) -> None:
        self.plain = not alone.law.extended
        if self.plain:
            return
        self._control = alone
        terms = alone.law.terms._replace(bias=_MOTION / period)
        self._led_astray = alone._replace(law=alone.law._replace(terms=terms))  # odometry has an error of _MOTION
        self._period = period
        self._bases: dict[bytes, Array] = {}
        self._memory = new_memory(self._control.law, 3)
        self._numbers = new_memory(self._control.law, 3)
        self._numbers.flat[:] = np.arange(len(self._memory.flat))
        self._registered = np.concatenate([np.zeros(0), *(own[0] for own in self._numbers.custom)]).astype(np.int64)
        self._lock = Lock()
        alone.law.gain[0] = _GENERIC_GAIN
        self._settle()
        self._cells = self._cells_in_loop()
        self._require_linear()

    def at(self, gain: float, values: Array) -> LinearLaw:
        """Return the model at a gain, 1/s, for eigenvalues of H above zero, shape (L,)."""
        if self.plain:
            return _papers_law(gain, values)
        half = np.column_stack([0.5 * values, 0.5 * values])
        n = len(self._cells)
        with self._lock:
            self._control.law.gain[0] = gain
            moved = self._columns(_MOVED_POINTS[0], half)
            both = self._led_astray_by(half)
            own = self._led_astray_by(half, sensing=(0, 0))
        position, sensed, heard = moved[:, n], moved[:, n + 1], moved[:, n + 2]
        each = half[:, :1]
        inputs = np.stack([position, -heard / each, (sensed - heard) / each, (both - own) / each, own], axis=2)
        return LinearLaw(
            A=moved[:, :n, :n].swapaxes(1, 2),
            B=inputs[:, :n],
            C=moved[:, :n, n],
            D=inputs[:, n],
            integral=np.isin(self._cells, self._numbers.terms.z[:1, :1]).astype(np.float64),
        )

    def feedback(self, gain: float, values: NDArray[Any]) -> LinearLaw:
        """Return the model from position to command at a gain, 1/s, for eigenvalues of H, shape (L,).

        Eigenvalues are above zero, or complex if H is not symmetric.

        Raises:
            UndecidedError: Eigenvalues are complex, and the law is not affine in them.
        """
        if self.plain:
            return _papers_law(gain, values).feedback(np.zeros((0, 0)))
        if np.iscomplexobj(values):  # without rounds, which directed teams do not have, H enters through eta alone
            probed = np.array([1.0, 2.0, 3.0])
            probes = self.feedback(gain, probed)
            largest = max(float(np.abs(getattr(probes, name)).max(initial=0.0)) for name in "ABCD")
            parts = {}
            for name in "ABCD":
                probe = getattr(probes, name)
                slopes = np.diff(probe, axis=0)
                if not np.allclose(slopes[0], slopes[1], rtol=_LINEAR, atol=_LINEAR * largest):
                    raise UndecidedError("the law is not affine in the eigenvalues of H")
                parts[name] = probe[0] + np.multiply.outer(values - probed[0], slopes[0])
            return LinearLaw(**parts, integral=probes.integral)
        key = values.tobytes()
        basis = self._bases.get(key)
        if basis is None:
            # What is affine in the gain keeps a space at every gain if it does at two.
            one, two = (self.at(k, values) for k in (_GENERIC_GAIN, 2.0 * _GENERIC_GAIN))
            A, B, C, D = (np.concatenate([getattr(one, name), getattr(two, name)]) for name in "ABCD")
            basis = LinearLaw(A, B, C, D, one.integral).basis
            self._bases = {key: basis}
        return self.at(gain, values).feedback(basis)

    def _settle(
        self,
        *,
        settling: int = 4,  # samples after which counters of samples no longer matter
        most: int = 1000,  # samples, for the memory of registered terms
    ) -> None:
        """Find the state of the law at rest, and a sample later.

        Raises:
            UndecidedError: Registered terms keep changing.
        """
        none = np.zeros(0, dtype=np.int64)
        end = np.zeros_like(self._memory.flat)
        for sample in range(most):
            rest = end
            end = self._answers(self._control, none, _STILL, _GENERIC, rest, sample)[0][0, 0]
            if sample >= settling and np.array_equal(rest[self._registered], end[self._registered]):
                self._rest = rest
                self._end = end
                self._sample = sample
                return
        raise UndecidedError(f"the law changes with time ({self._terms})")

    @property
    def _terms(self) -> str:
        return listed([f"term {name}" for name in self._control.law.term_names])

    def _answers(
        self, control: ControlArrays, cells: IntArray, points: Array, weights: Array, start: Array, sample: int
    ) -> tuple[Array, Array]:
        """Evaluate the law once with each of n numbers of its memory changed, then K times with agent and points moved.

        Args:
            control: The law.
            cells: Indices of these numbers in the memory, shape (n,).
            points: Positions of the agent and of the points, shape (K, 3, 3), m.
            weights: Weights of the two edges, shape (L, 2).
            start: Memory before, shape (m,).
            sample: Number of the sample.

        Returns:
            Memories, shape (L, n + K, m), and commands, shape (L, n + K, 3), m/s.

        Raises:
            UndecidedError: A registered term raises an exception.
        """
        cases = len(cells) + len(points)
        ends = np.empty((len(weights), cases, len(start)))
        commands = np.empty((len(weights), cases, 3))
        time = sample * self._period
        still = _STILL[0]
        try:
            _answer(control, time, start, cells, _MOTION, points, weights, still, self._memory, ends, commands)
        except Exception as error:  # of a registered term
            raise UndecidedError(f"the law cannot be evaluated ({self._terms}): {error}") from error
        return ends, commands

    def _columns(self, points: Array, weights: Array) -> Array:
        """Return the response of the state and, last, the command to a unit of each motion, shape (L, n + K, n + 1)."""
        ends, commands = self._answers(self._control, self._cells, points, weights, self._rest, self._sample)
        return np.dstack([(ends - self._end)[:, :, self._cells], commands[:, :, 0]]) / _MOTION

    def _led_astray_by(self, weights: Array, sensing: tuple[int, int] = (0, 1)) -> Array:
        """Return the response of the state and, last, the command to a unit error of odometry, shape (L, n + 1).

        The agent senses the velocity of targets on the edges from first to last.
        """
        law = self._led_astray.law
        control = self._led_astray._replace(law=law._replace(terms=law.terms._replace(sensing=sensing)))
        ends, commands = self._answers(control, self._cells[:0], _STILL, weights, self._rest, self._sample)
        return np.column_stack([(ends - self._end)[:, 0, self._cells], commands[:, 0, 0]]) / _MOTION

    def _cells_in_loop(self) -> IntArray:
        """Find the states that depend on an input and on which the command along the first axis depends.

        Raises:
            UndecidedError: Registered terms store initial values that no later input changes.
        """
        self._cells = np.flatnonzero(self._rest == 0.0)  # the others count samples
        n = len(self._cells)
        answers = self._columns(_MOVED_POINTS.reshape(9, 3, 3), _GENERIC)[0]
        wrong = self._led_astray_by(_GENERIC)
        acts = np.zeros((n + 2, n + 2), dtype=np.bool_)  # row on column: the state, the inputs, the command
        acts[:n, :n] = answers[:n, :n] != 0.0
        acts[:n, n + 1] = answers[:n, n] != 0.0
        acts[n, :n] = (answers[n:, :n] != 0.0).any(axis=0) | (wrong[0, :n] != 0.0)
        graph = sparse.csr_array(acts)
        excited = breadth_first_order(graph, n, return_predecessors=False)
        seen = breadth_first_order(sparse.csr_array(graph.T), n + 1, return_predecessors=False)
        excited = excited[excited < n]
        kept = np.setdiff1d(self._registered, self._cells[excited])
        # State of the law if the agent and both points have been displaced since the start.
        points = _MOTION * np.random.default_rng(1).uniform(-1.0, 1.0, (1, 3, 3))
        state = np.zeros_like(self._rest)
        for sample in range(self._sample + 1):
            state = self._answers(self._control, self._cells[:0], points, _GENERIC, state, sample)[0][0, 0]
        if (state[kept] != self._end[kept]).any():
            raise UndecidedError(f"the law keeps what it met at the start ({self._terms})")
        return np.asarray(self._cells[np.intersect1d(excited, seen)])

    def _require_linear(
        self,
        *,
        tested_custom: int = 40,  # samples over which the model is compared with the law, with registered terms
        tested_shipped: int = 8,  # the same with shipped terms alone, whose counters end earlier
    ) -> None:
        """Raise an UndecidedError unless the law responds as its model does, in motions of several sizes."""
        model = self.at(_GENERIC_GAIN, _GENERIC.sum(axis=1))
        weight = _GENERIC[0, 0]
        measured = self._control.law.edges.F_tail.diagonal()[:, None]
        tested = tested_custom if len(self._registered) else tested_shipped
        agent, first, second = points = np.random.default_rng(0).uniform(-1.0, 1.0, (3, tested, 3))
        memories = []
        for size in (_MOTION, *_OTHER_MOTIONS):
            astray = size == _MOTION
            odometry = np.full((tested, 3), float(astray))
            errors = (agent, -weight * (first + second), weight * first, weight * odometry, odometry)
            state = np.zeros((3, len(self._cells)))
            expected = np.zeros((tested, 3))
            for k, inputs in enumerate(measured * np.stack(errors, axis=-1)):
                expected[k] = state @ model.C[0] + inputs @ model.D[0]
                state = state @ model.A[0].T + inputs @ model.B[0].T
            found, memory = self._follow(self._led_astray if astray else self._control, size * points)
            memories.append(memory / size)
            if not _alike(found / size, expected):
                raise UndecidedError(f"the law is not linear about its equilibrium ({self._terms})")
        if not all(_alike(memory, memories[1]) for memory in memories[2:]):
            raise UndecidedError(f"what the law remembers is not in proportion to motion ({self._terms})")

    def _follow(self, control: ControlArrays, points: Array) -> tuple[Array, Array]:
        """Follow motions (3, T, 3), m, from rest; return commands (T, 3), m/s, and changes of custom terms' memory."""
        state = self._rest
        commands = np.zeros(points.shape[1:])
        memories = np.zeros((len(commands), len(self._registered)))
        for k, moved in enumerate(np.ascontiguousarray(points.swapaxes(0, 1))):  # the layout that other calls have
            ends, command = self._answers(control, self._cells[:0], moved[None], _GENERIC, state, self._sample + k)
            state = ends[0, 0]
            commands[k] = command[0, 0]
            memories[k] = (state - self._rest)[self._registered]
        return commands, memories


def _alike(found: Array, expected: Array) -> bool:
    """Return True if responses are equal up to rounding."""
    return np.allclose(found, expected, rtol=_LINEAR, atol=_LINEAR * np.abs(expected).max(initial=0.0))


def _papers_law(gain: float, values: NDArray[Any]) -> LinearLaw:
    """Return the model of u = -k1 eta, which has no state."""
    L = len(values)
    D = np.zeros((L, len(INPUTS)), dtype=values.dtype)
    D[:, 0] = -gain * values
    D[:, 1] = -gain
    return LinearLaw(np.zeros((L, 0, 0)), np.zeros((L, 0, len(INPUTS))), np.zeros((L, 0)), D, np.zeros(0))


def _one_agent(law: LawArrays) -> ControlArrays:
    """Return the law for one agent that measures two points, without limits, noise and losses."""
    solid = bool(law.edges.F_tail[:, 2].any() or law.edges.F_head[:, 2].any())
    F = np.tile(np.diag([1.0, 1.0, float(solid)]), (2, 1))
    edges = EdgeArrays(
        tail=np.zeros(2, dtype=np.int64),
        head=np.array([1, 2], dtype=np.int64),
        listens=np.array([[True, False], [True, False]]),
        first=np.array([0, 3, 6], dtype=np.int64),
        F_tail=F,
        F_head=F,
        P_tail=F.copy(),
        P_head=F.copy(),
        b=np.zeros(6),
    )
    motion = MotionArrays(
        pull=np.zeros(3),
        origin=np.zeros((3, 3)),
        amplitude=np.zeros((3, 3)),
        rate=np.zeros((3, 3)),
        phase=np.zeros((3, 3)),
        path=np.zeros((3, 2), dtype=np.int64),
        period=np.zeros(3),
        knots=np.zeros(0),
        coefficients=np.zeros((0, 6, 3)),
    )
    terms = law.terms._replace(sensing=(0, 0))
    if terms.agents:
        terms = terms._replace(
            agents=1,
            dimension=np.full(1, 3 if solid else 2, dtype=np.int64),
            sensing=(0, 1),
            lead=terms.lead[:1].copy(),
            settled=0,
            largest=np.inf,
            noise=0.0,
            bias=0.0,
            streams=np.zeros((1, 2), dtype=np.int64),
            rounds=RoundArrays(),
        )
    return ControlArrays(
        LawArrays(
            edges,
            np.array([1.0, 0.0, 0.0]),
            np.full(3, np.inf),
            0,
            terms,
            LinkArrays(),
            tuple(term._replace(agents=1) for term in law.custom),
        ),
        motion,
    )


@tiered(seconds=2.0, numbers=np.inf)
@jit
def _answer(control, t, start, cells, size, points, weights, still, memory, ends, commands):
    """Write memories (L, n + K, m) and commands (L, n + K, 3) of one evaluation of the law each.

    For each pair of `weights` (L, 2), the law begins with `start` (m,), with one of the `cells` (n,) changed by
    `size`, at positions `still` (3, 3); then with `start` itself at the positions in each of `points` (K, 3, 3).
    """
    edges = control.law.edges
    n = cells.shape[0]
    for one in range(weights.shape[0]):
        for r in range(edges.b.shape[0]):
            for i in range(3):
                edges.P_tail[r, i] = weights[one, r // 3] * edges.F_tail[r, i]
                edges.P_head[r, i] = weights[one, r // 3] * edges.F_head[r, i]
        for case in range(n + points.shape[0]):
            for i in range(start.shape[0]):
                memory.flat[i] = start[i]
            if case < n:
                memory.flat[cells[case]] += size
            evaluate_law(control, t, points[case - n] if case >= n else still, still, memory)
            for i in range(3):
                commands[one, case, i] = memory.command[0, i]
            for i in range(start.shape[0]):
                ends[one, case, i] = memory.flat[i]


# -- parts of a law that check has no model of -------------------------------------------------------------------------
#
# The response of the law's stages to their measurements is computed by running them, so a new term needs no code here.
# Edges, links and gains are modelled in the rest of the analysis. A test lists all fields of these structures: a new
# field is either modelled by `check`, or added to `unmodelled_parts`.


def unmodelled_parts(system: System) -> list[str]:
    """Return the parts of a system's law that `check` cannot model, such as "law in Python"; empty without any."""
    law = system.law
    others = {
        "sensor of a link": not np.isin(law.links.table["bearing"], (0, 1)).all(),
        "range and bearing edges, unless linearised": law.edges.kinds,
        "law in Python": law.supplied,
        "gains that differ between agents": (law.gain[: len(system.team.agents)] != system.gain).any(),
    }
    new = terms_without_bound(law)
    if law.extended and not system.grid.continuous:
        try:
            model_of(law, system.grid.period)
            new = []
        except UndecidedError:
            new = new or [f"term {name}" for name in law.term_names]
    return select_true(others) + new


def terms_without_bound(law: LawArrays) -> list[str]:
    """Return the terms of a law for which no bound along the targets' path is derived."""
    return [f"term {name}" for name in names_of(law.custom)]


def because_of(parts: list[str]) -> str:
    """Return the reason why a law is undecided, from `unmodelled_parts`."""
    return f"because of {listed(parts)}, which check has no model of"


def require_model(system: System) -> None:
    """Raise an UndecidedError that names the parts of a system's law that `check` cannot model, if there are any."""
    if parts := unmodelled_parts(system):
        raise UndecidedError(because_of(parts))
