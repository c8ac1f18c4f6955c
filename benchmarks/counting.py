"""Count the operations of the fused engine's step, by running its own functions on numbers that count.

With NUMBA_DISABLE_JIT=1 in the environment the interpreter runs what is otherwise compiled. As a program this reads a
pickled loop and its RIGIDs, and prints what `count` returns, as JSON.
"""

import json
import pickle
import sys
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mjsheaf.loop.engine import Log
from mjsheaf.loop.fused import advance_block
from mjsheaf.loop.loop import Loop, run_law

_STEPS = 20  # physics steps while operations are counted

counted: Counter[str] = Counter()


class Number:
    """A number whose operations are counted: sums and differences, products, quotients, roots and other functions."""

    def __init__(self, value: Any) -> None:
        self.value = float(value)

    def _by(self, kind: str, other: Any, made: float) -> "Number":
        counted[kind] += 1
        return Number(made)

    def __add__(self, other: Any) -> "Number":
        return self._by("sums", other, self.value + float(other))

    def __sub__(self, other: Any) -> "Number":
        return self._by("sums", other, self.value - float(other))

    def __rsub__(self, other: Any) -> "Number":
        return self._by("sums", other, float(other) - self.value)

    def __mul__(self, other: Any) -> "Number":
        return self._by("products", other, self.value * float(other))

    def __truediv__(self, other: Any) -> "Number":
        return self._by("quotients", other, self.value / float(other))

    def __rtruediv__(self, other: Any) -> "Number":
        return self._by("quotients", other, float(other) / self.value)

    def __pow__(self, power: int) -> "Number":
        counted["products"] += power - 1
        return Number(self.value**power)

    __radd__, __rmul__ = __add__, __mul__

    def __neg__(self) -> "Number":
        return Number(-self.value)

    def __abs__(self) -> "Number":
        return Number(abs(self.value))

    def __float__(self) -> float:
        return self.value

    def __lt__(self, other: Any) -> bool:
        return self.value < float(other)

    def __le__(self, other: Any) -> bool:
        return self.value <= float(other)

    def __gt__(self, other: Any) -> bool:
        return self.value > float(other)

    def __ge__(self, other: Any) -> bool:
        return self.value >= float(other)

    def rint(self) -> "Number":
        """As numpy calls it, as the others."""
        return Number(np.rint(self.value))

    def sqrt(self) -> "Number":
        """A root."""
        return self._by("roots", None, float(np.sqrt(self.value)))

    def exp(self) -> "Number":
        """A function that a library computes."""
        return self._by("functions", None, float(np.exp(self.value)))

    def sin(self) -> "Number":
        """Likewise."""
        return self._by("functions", None, float(np.sin(self.value)))

    def cos(self) -> "Number":
        """Likewise."""
        return self._by("functions", None, float(np.cos(self.value)))


_number = np.frompyfunc(Number, 1, 1)


def counting(value: Any) -> Any:
    """Return floats, or arrays, records and tuples of them, as numbers that count."""
    if isinstance(value, tuple):
        return getattr(value, "_make", type(value))(map(counting, value))
    if isinstance(value, float):
        return Number(value)
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fV":
        return value
    return _number(value) if value.dtype.kind == "f" else _records(value)


def _records(values: NDArray[np.void]) -> Any:
    """Return records of numbers that count, whose fields are attributes too, as in compiled code."""
    fields: Any = values.dtype.fields
    types = {name: ("O" if of[0].base.kind == "f" else of[0].base, of[0].shape) for name, of in fields.items()}
    made = np.zeros(len(values), [(name, *of) for name, of in types.items()])
    for name in types:
        made[name] = _number(values[name]) if types[name][0] == "O" else values[name]
    return made.view(np.recarray)


def touched(loop: Loop) -> int:
    """Return the bytes of a vehicle that a step would read and write without a cache."""
    params, state = loop
    medium, bodies = params.medium, params.fleet.bodies
    read = [*medium.harmonics, bodies, state.memory.command, params.helm, medium.planar, medium.rows]
    changed = [state.qpos, state.qvel, state.ctrl, state.act, state.medium.sines]
    return int(sum(x.nbytes for x in read) + 2 * sum(x.nbytes for x in changed)) // len(bodies)


def count(loop: Loop, motion: NDArray[np.void]) -> dict[str, dict[str, float]]:
    """Count the operations of a vehicle and step by kind: those of the step itself, and of its share of the law."""
    V, nothing = len(loop.params.fleet.bodies), Log(*[np.empty((0, 0, 0))] * (len(Log._fields) - 1))
    ours, moved, found = counting(loop), counting(motion), {}
    counted.clear()
    advance_block(ours, moved, 0, V, 0, _STEPS, nothing, -1, np.zeros(V, dtype=np.int64))
    found["step"] = {kind: number / (_STEPS * V) for kind, number in counted.items()}
    counted.clear()
    run_law(ours, loop.params.start + _STEPS * loop.params.timestep)
    found["law"] = {kind: number / (loop.params.per_law * V) for kind, number in counted.items()}
    return found


if __name__ == "__main__":
    print(json.dumps(count(*pickle.load(sys.stdin.buffer))))
