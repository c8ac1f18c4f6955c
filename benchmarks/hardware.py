"""Compare the fused engine's step with the limits of this processor: its arithmetic and its memory."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from time import thread_time

import numpy as np

from benchmarks import counting
from benchmarks.measuring import Row, best, informs, swarm
from mjsheaf.errors import MjsheafError
from mjsheaf.loop.fused import Fused
from mjsheaf.loop.system import on_engine
from mjsheaf.threads import one_thread

_SIZE, _FEW, _SETTLE = 1000, 8, 400  # vehicles timed and counted, and physics steps before that


@one_thread
def hardware(short: bool = False) -> list[Row]:
    """Measure a vehicle's step on one core, next to the time that arithmetic or memory alone would take.

    Operations are counted as they are written, by running the step's functions on numbers that count: sums, products,
    quotients, roots and library functions, each as one. The core's best rate is that of a product of large matrices,
    which fills its vectors with fused multiply-adds; the step has none of these, and its quotients and roots take
    several times as long. The memory's is that of a copy far larger than the caches, which hold a thousand vehicles.
    """
    repetitions, (bodies, few) = 10 if short else 40, [_settled(size) for size in (_SIZE, _FEW)]
    steps = 100
    ours = 1e9 / (steps * _SIZE) * best(lambda: bodies.step(steps), repetitions, thread_time)
    found = operations(few)
    number = sum(sum(kinds.values()) for kinds in found.values())
    slow = sum(kinds.get(kind, 0.0) for kinds in found.values() for kind in ("quotients", "roots", "functions"))
    arithmetic, bandwidth, moved = (
        _arithmetic(repetitions),
        _bandwidth(repetitions),
        counting.touched(bodies.compiled[0]),
    )
    what = f"{_SIZE} tilted hexarotors"
    return [
        informs("hardware", f"{what}, operations a vehicle and step", number, note=f"{slow:.0f} no sum or product"),
        informs("hardware", f"{what}, GFLOP/s", number / ours, arithmetic, "a product of matrices"),
        informs("hardware", f"{what}, a vehicle and step, ns", ours, number / arithmetic, "arithmetic alone"),
        informs("hardware", "the same, ns", ours, moved / bandwidth, f"memory alone, {moved} bytes"),
    ]


def _settled(size: int) -> Fused:
    bodies = Fused(on_engine(swarm(size - 1).phases, "fused"))
    bodies.step(_SETTLE)
    return bodies


def operations(bodies: Fused) -> dict[str, dict[str, float]]:
    """Count the operations of a fused run in its present state; see `counting.count`.

    Raises:
        MjsheafError: The process that counts failed.
    """
    done = subprocess.run(
        [sys.executable, str(Path(counting.__file__))],
        input=pickle.dumps(bodies.compiled),
        capture_output=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        check=False,
    )
    if done.returncode:
        raise MjsheafError(f"counting operations failed: {done.stderr.decode().strip()[-300:]}")
    found: dict[str, dict[str, float]] = json.loads(done.stdout)
    return found


def _arithmetic(repetitions: int, n: int = 800) -> float:
    """Operations of doubles on one core, 1/ns."""
    a = np.random.default_rng(0).random((n, n))
    out = np.empty_like(a)
    return 2e-9 * n**3 / best(lambda: np.matmul(a, a, out=out), repetitions, thread_time)


def _bandwidth(repetitions: int, size: int = 2**25) -> float:
    """Of a copy on one core, read and written, bytes/ns."""
    source, target = np.ones(size), np.zeros(size)
    return 1e-9 * 2 * source.nbytes / best(lambda: np.copyto(target, source), repetitions, thread_time)
