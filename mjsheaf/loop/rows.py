"""Runs of one team, the worlds, side by side in memory.

Worlds share their parameters. What a world has of its own (see `mjsheaf.arrays.Own`) is a row of one array. The Loop of
all is that of a world, but its own arrays have a first axis more, which counts worlds. `Rows.loop_of` takes the Loop of
one world out of it, so that worlds go through the very functions of the fused engine: each ends bit for bit as it does
alone.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from mjsheaf.arrays import OWN, Array
from mjsheaf.errors import InputError
from mjsheaf.loop.fused import Fused
from mjsheaf.loop.loop import Loop, Params


class Leaf(NamedTuple):
    """Value in a tree of tuples.

    Attributes:
        path: Names of the fields that lead to it, after a root.
        value: An array or a number.
        own: True if every world has its own. Arrays of other types than float64 say where to look, and are shared.
    """

    path: str
    value: Any
    own: bool


def mapped(function: Callable[[Leaf], Any], tree: Any, path: str = "loop", own: bool = False) -> Any:
    """Return a tree of tuples with another value in the place of each leaf."""
    if not isinstance(tree, tuple):
        fixed = isinstance(tree, np.ndarray) and tree.dtype != np.float64
        return function(Leaf(path, tree, own and not fixed))
    make = getattr(type(tree), "_make", tuple)
    return make(mapped(function, part, place, own or mark) for place, part, mark in _parts(tree, path))


def _parts(tree: tuple[Any, ...], path: str) -> Iterator[tuple[str, Any, bool]]:
    """Yield the path of each part of a tuple, the part, and True if worlds have it for themselves."""
    if not hasattr(tree, "_fields"):
        yield from ((f"{path}[{k}]", part, False) for k, part in enumerate(tree))
        return
    marks = _own_fields(type(tree))
    for name, part in zip(tree._fields, tree, strict=True):
        yield f"{path}.{name}", part, name in marks


@cache
def _own_fields(kind: type) -> frozenset[str]:
    """Return the names of the fields of a NamedTuple that are `Own`."""
    hints = get_type_hints(kind, include_extras=True)
    return frozenset(name for name, hint in hints.items() if OWN in getattr(hint, "__metadata__", ()))


def leaves_of(tree: Any) -> list[Leaf]:
    """Return the leaves of a tree in order."""
    leaves: list[Leaf] = []
    mapped(leaves.append, tree)
    return leaves


class Rows:
    """Runs of one team at their start, as rows of arrays.

    Attributes:
        loop: Loop of all worlds.
        motion: A MOTION for each kind of vehicle.
        values: Numbers that differ between worlds, shape (W, n); `loop` has views of them.
    """

    def __init__(self, runs: Sequence[Fused]) -> None:
        """Lay out copies of the runs.

        Raises:
            InputError: There is no run, one has begun, or one differs from the first in data that worlds share.
        """
        if not runs:
            raise InputError("no run; expected one or more")
        leaves = [leaves_of(run.compiled[0]) for run in runs]
        _require_one_team(runs, leaves)
        whole, self.motion = runs[0].compiled
        self._is_own = [leaf.own for leaf in leaves[0]]
        self._own = _own_arrays(leaves[0])
        own = [leaves[0][k].value for k in self._own]
        self._places = list(zip(own, np.cumsum([0, *(part.size for part in own)]).tolist(), strict=False))
        self.values = np.array([self._row_of(each) for each in leaves])
        columns = iter(np.array([[leaf.value for leaf in each if is_seed(leaf)] for each in leaves], np.int64).T)

        def laid_out(leaf: Leaf) -> Any:
            if not leaf.own:
                return leaf.value
            return self._view(leaf.value) if isinstance(leaf.value, np.ndarray) else next(columns)

        self.loop: Loop = mapped(laid_out, whole)
        constants = [leaf for leaf in leaves[0] if leaf.path.startswith("loop.params.")]
        self._shared = {leaf.path: leaf.value for leaf in constants if not leaf.own}
        self._read_shared = _reader(self._shared)
        self._read_own = _reader([leaf.path for leaf in constants if leaf.own])
        self._constants = self._read_own(self.loop)

    def _row_of(self, leaves: list[Leaf]) -> Array:
        return np.concatenate([leaves[k].value.ravel() for k in self._own])

    def row_of(self, loop: Loop) -> Array:
        """Return the row of a world with this loop, shape (n,)."""
        return self._row_of(leaves_of(loop))

    def put(self, w: int, params: Params) -> None:
        """Write the constants of a run over those of world w.

        Raises:
            InputError: They differ in what worlds share.
        """
        loop = Loop(params, self.loop.state)
        for (path, ours), other in zip(self._shared.items(), self._read_shared(loop), strict=True):
            if not (ours is other or _same(ours, other)):
                raise InputError(f"{path}: run {w} has another than the others; expected runs of one team")
        for ours, other in zip(self._constants, self._read_own(loop), strict=True):
            ours[w] = other

    def loop_of(self, w: int) -> Loop:
        """Return the Loop of world w."""
        own = iter(self._is_own)
        loop: Loop = mapped(lambda leaf: leaf.value[w] if next(own) else leaf.value, self.loop)
        return loop

    def _view(self, part: Array) -> Array:
        """Return what an own array of the first run is in all rows, shape (W, ...)."""
        W = len(self.values)
        if not part.size:
            return self.values[:, :0].reshape(W, *part.shape)
        behind = ((part.ctypes.data - whole.ctypes.data, whole, begin) for whole, begin in self._places)
        begin = next(begin + n // whole.itemsize for n, whole, begin in behind if 0 <= n < whole.nbytes)
        return self.values[:, begin : begin + part.size].reshape(W, *part.shape)


def _reader(paths: Iterable[str]) -> Callable[[Loop], tuple[Any, ...]]:
    """Return the function that reads the leaves of these paths from a loop."""
    reader: Callable[[Loop], tuple[Any, ...]] = eval(f"lambda loop: ({''.join(f'{path}, ' for path in paths)})")
    return reader


def is_seed(leaf: Leaf) -> bool:
    """Return True for a number that a world has of its own."""
    return leaf.own and not isinstance(leaf.value, np.ndarray)


def _own_arrays(leaves: Sequence[Leaf]) -> list[int]:
    """Return the numbers of the arrays that a world has of its own, without those that are parts of an earlier one."""
    found = dict[tuple[int, int], int]()  # by the addresses where they begin and end
    for k, leaf in enumerate(leaves):
        if leaf.own and isinstance(leaf.value, np.ndarray):
            begin = leaf.value.ctypes.data
            if not any(first <= begin < end for first, end in found):
                found[begin, begin + leaf.value.nbytes] = k
    return list(found.values())


def _shared(run: Fused, leaves: Sequence[Leaf]) -> dict[str, Any]:
    """Return what worlds share, by name, and the shapes of what they do not; the leaves are those of the run's loop."""
    shared = {leaf.path: np.shape(leaf.value) if leaf.own else leaf.value for leaf in leaves}
    return shared | {"motion": run.compiled[1], "team": run.system.team.members, "time": run.system.grid}


def _require_one_team(runs: Sequence[Fused], leaves: Sequence[Sequence[Leaf]]) -> None:
    """Refuse runs that have begun, or differ in what worlds share.

    Raises:
        InputError: naming the run, and where it differs from the first.
    """
    common = _shared(runs[0], leaves[0])
    for w, (run, found) in enumerate(zip(runs, leaves, strict=True)):
        if run.time != run.system.grid.start:
            raise InputError(f"run {w} is at {run.time:g} s; expected one at its start")
        other = _shared(run, found)
        for name in common | other:
            if not _same(common.get(name), other.get(name)):
                raise InputError(f"{name}: run {w} has another than run 0; expected runs of one team")


def _same(one: Any, other: Any) -> bool:
    """Return True if two leaves are equal, to the bit."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one.shape == other.shape and one.tobytes() == other.tobytes()
    return type(one) is type(other) and bool(one == other)
