"""Worlds of a batch on a CUDA GPU: `batch.run_world` as a kernel, one source for both.

numba-cuda compiles the functions that the CPU runs, from the law to the step, as device functions. Neighbouring threads
of a block take neighbouring worlds (32 of them, a warp) at the same vehicle. So they do not diverge as long as worlds
take the same branches, and they load neighbouring numbers. The members of a world are the block's second dimension. The
state of the worlds stays on the GPU; only their scores are copied back.

A GPU contracts a product and a sum into one rounding and has its own sine. Its results agree with those of a processor
to within rounding, not bit for bit.
"""

import functools
import importlib.util
from collections.abc import Callable, Generator
from importlib import import_module
from types import FunctionType, SimpleNamespace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mjsheaf.errors import InputError
from mjsheaf.jit import inline_jit
from mjsheaf.simulation.batch import Batch, run_world
from mjsheaf.simulation.fused import advance_each
from mjsheaf.simulation.rows import Leaf, Taker, mapped

WORLDS = 32
"""Worlds of a block: a warp."""

_MOST_MEMBERS = 4  # of a world: with 128 registers a thread, four blocks fit on a multiprocessor
_LIBDEVICE = {
    np.ceil: ("ceil", 1),
    np.copysign: ("copysign", 2),
    np.exp: ("exp", 1),
    np.fabs: ("fabs", 1),
    np.floor: ("floor", 1),
    np.rint: ("rint", 1),
    np.sqrt: ("sqrt", 1),
}
"""Functions of numpy that numba-cuda lacks: libdevice's name and how many arguments."""


def require_card() -> None:
    """Require a CUDA GPU.

    Raises:
        InputError: numba-cuda is not installed, or finds no GPU.
    """
    if importlib.util.find_spec("numba_cuda") is None:
        raise InputError("device gpu: numba-cuda is not installed; expected pip install 'mjsheaf[cuda]', or device cpu")
    if not import_module("numba.cuda").is_available():
        raise InputError("device gpu: no CUDA GPU is found; expected one with its driver, or device cpu")


def _add_functions() -> None:
    """Give numba-cuda the functions of numpy that compiled code calls and that it lacks."""
    from llvmlite import ir
    from numba.core import cgutils

    known = import_module("numba.cuda.ufuncs").ufunc_db()

    def calling(name: str) -> Callable[..., Any]:
        def generate(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
            kind = arguments[0].type
            own = f"__nv_{name}{'f' * isinstance(kind, ir.FloatType)}"
            function = ir.FunctionType(kind, [kind] * len(arguments))
            return builder.call(cgutils.get_or_insert_function(builder.module, function, own), arguments)

        return generate

    for function, (name, count) in _LIBDEVICE.items():
        if function not in known:
            known[function] = {f"{kind * count}->{kind}": calling(name) for kind in "fd"}


@inline_jit
def advance_one_by_one(loop, motion, k, nothing, bad, member, members):
    """Move a member's share of the vehicles of a world; as `batch.advance_share`."""
    for v in range(member, loop.params.fleet.bodies.shape[0], members):
        advance_each(loop, motion, v, v + 1, k, loop.params.per_law, nothing, -1, bad)


@functools.cache
def kernel_function(take_world: Taker) -> Callable[..., None]:
    """Return the kernel as a function that numba-cuda compiles: of `arguments`, and samples from `begin` to `end`.

    It is `run_world` with the GPU's barrier in the place of the gate: no thread leaves before the last meeting. Each
    thread moves one vehicle at a time: the GPU's own threads are its lanes.
    """
    cuda = import_module("numba.cuda")
    _add_functions()

    @cuda.jit(device=True)
    def meet(gate, meetings, members):
        cuda.syncthreads()
        return True

    on_processor = run_world.py_func
    names = {**on_processor.__globals__, "meet": meet, "advance_share": advance_one_by_one}
    advance = njit(error_model="numpy")(FunctionType(on_processor.__code__, names, on_processor.__name__))
    take = cuda.jit(device=True)(take_world)

    def run_worlds(loop, motion, goal, scores, nothing, begin, end):
        w, W = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x, scores.bound.shape[0]
        there, w = w < W, min(w, W - 1)
        member, members = cuda.threadIdx.y, cuda.blockDim.y
        advance(take(loop, w), motion, goal, scores, nothing, w, there, begin, end, member, members, None)

    return run_worlds


@functools.cache
def _kernel(take_world: Taker) -> Any:
    return import_module("numba.cuda").jit(launch_bounds=WORLDS * _MOST_MEMBERS)(kernel_function(take_world))


def arguments(batch: Batch) -> tuple[Any, ...]:
    """Return what the kernel takes before the samples: trees of arrays on this machine."""
    return batch.rows.loop, batch.rows.motion, batch.goal, batch.scores, batch.nothing


def place_of(values: NDArray[Any], rows: NDArray[Any], begin: int) -> dict[str, Any]:
    """Return the array interface of a view of rows, where a copy of these begins at an address."""
    offset = values.ctypes.data - rows.ctypes.data if values.size else 0
    described = {"shape": values.shape, "strides": values.strides, "typestr": values.dtype.str, "version": 3}
    return {**described, "data": (begin + offset, False)}


def run_on_card(batch: Batch) -> Generator[int]:
    """Run all worlds of a batch once, like `Batch.each`; all worlds end together.

    Args:
        batch: Batch laid out with order="F".

    Yields:
        The number of each world.

    Raises:
        InputError: There is no GPU.
    """
    require_card()
    cuda = import_module("numba.cuda")
    here = batch.rows.values
    rows = cuda.to_device(here)
    begin = rows.__cuda_array_interface__["data"][0]

    def sent(leaf: Leaf) -> Any:
        if not isinstance(leaf.value, np.ndarray):
            return leaf.value
        if leaf.value.base is here:
            return cuda.as_cuda_array(SimpleNamespace(__cuda_array_interface__=place_of(leaf.value, here, begin)))
        return cuda.to_device(leaf.value)

    given = [mapped(sent, tree) for tree in arguments(batch)]
    scores = given[3]
    T, V, chunk = batch.goal.samples, len(batch.rows.loop.params.fleet.bodies), batch.chunk
    launch = _kernel(batch.rows.take)[-(-len(batch) // WORLDS), (WORLDS, min(_MOST_MEMBERS, V))]
    for sample in range(0, T, chunk):
        launch(*given, sample, min(sample + chunk, T))
        cuda.synchronize()
    rows.copy_to_host(here)
    for on_card, own in zip(scores, batch.scores, strict=True):
        on_card.copy_to_host(own)
    yield from range(len(batch))
