"""Compiled functions: decorators, linking, and loops over tuples of parts.

Machine code is kept on disk: see `mjsheaf.compile.machine_code`.

numba optimises every function, with all that it calls, translates it to machine code, and wraps it for calls from
Python, even where it is only ever called by another compiled function, whose code has a copy of it. Where functions
call each other through several levels, that is most of the time of compilation. Here a function that is called by
compiled code keeps its intermediate code, and the function that Python calls is optimised and translated as a whole.
The extension point is numba's `pipeline_class`.

Tuples may have parts of unlike kinds, whose types alone tell which functions to call. A loop compiles for the parts
that are there, so that what a run has not costs nothing.
"""

import contextlib
import ctypes
import gc
import logging
import os
from collections.abc import Callable
from functools import cache, cached_property
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from mjsheaf.errors import InputError

try:
    from numba import config, njit, typeof
    from numba import types as types
    from numba._dispatcher import compute_fingerprint
    from numba.core import event
    from numba.core.caching import CompileResultCacheImpl
    from numba.core.cgutils import alloca_once_value, gep_inbounds
    from numba.core.codegen import JITCodeLibrary, get_host_cpu_features
    from numba.core.compiler import Compiler, CompileResult
    from numba.core.datamodel.models import PrimitiveModel
    from numba.core.datamodel.registry import register_default as register_model
    from numba.core.dispatcher import Dispatcher as Dispatcher
    from numba.core.errors import NumbaError as NumbaError
    from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
    from numba.core.registry import cpu_target
    from numba.core.typing.templates import AttributeTemplate, infer_getattr
    from numba.extending import NativeValue, intrinsic, lower_builtin, type_callable, unbox
    from numba.extending import overload as overload
    from numba.np.numpy_support import as_dtype

    from mjsheaf.compile.machine_code import StoredCode, keep_code
    from mjsheaf.compile.machine_code import is_waiting as is_waiting
except ValueError:  # numba reads its environment variables as it is imported
    raise InputError(
        f"NUMBA_NUM_THREADS: {os.environ.get('NUMBA_NUM_THREADS', '')[:40]!r}; expected a whole number from 1 on"
    ) from None

# Vectors of 256 bits, as LLVM itself prefers on most processors with AVX-512: a loop over 4 lanes has no remainder, and
# code that reads several numbers right after it wrote them one by one does not wait for them. Gathers and scatters take
# longer than the loads and stores that they stand for.
_features = get_host_cpu_features()
if config.CPU_FEATURES is None and "+avx2" in _features:  # type: ignore[attr-defined]
    config.CPU_FEATURES = f"{_features},+prefer-256-bit,+prefer-no-gather,+prefer-no-scatter"  # type: ignore[attr-defined]

_logger = logging.getLogger("mjsheaf")


class _Compilations(event.Listener):
    """Total time that numba takes to compile: seconds that later runs do not need.

    Attributes:
        seconds: Time that compiling took, s.
        begun: Times at which the compilations that are under way began, s.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.begun: list[float] = []  # one within the other
        self._announced = False

    def on_start(self, event: Any) -> None:
        if not self.begun:
            self._usual = gc.get_threshold()
            # numba makes millions of objects, few of them garbage: with Python's own thresholds, looking for it took a
            # tenth of the time.
            gc.set_threshold(50_000, 20, 20)
        self.begun.append(perf_counter())
        if not self._announced and str(event.data["dispatcher"].py_func.__module__).startswith("mjsheaf."):
            self._announced = True
            _logger.info("compiling the loops for this machine, once")

    def on_end(self, event: Any) -> None:
        begun = self.begun.pop()
        if not self.begun:
            self.seconds += perf_counter() - begun
            gc.set_threshold(*self._usual)


_compilations = _Compilations()
event.register("numba:compile", _compilations)


def compilation_time() -> float:
    """Return how long this process has compiled, s."""
    return _compilations.seconds


def is_compiling() -> bool:
    """Return True if a function is being compiled."""
    return bool(_compilations.begun)


def working_time() -> float:
    """Return a time in s, for differences, from a clock that stops during compilation."""
    return perf_counter() - _compilations.seconds


def jit(function: Callable[..., Any]) -> Any:
    """Compile a function: cached on disk, without the interpreter's lock, division as in C.

    It makes no arrays, and counts no references to those it is handed. numba counts one, by an atomic instruction, at
    every slice, row and field that is taken: that took a third of the time of closing the loop about a physics step.
    Its option for that is not a public one; a numba without it refuses to compile, and does not go wrong silently.
    """
    return _compile(function, _nrt=False)


def allocating_jit(function: Callable[..., Any]) -> Any:
    """Compile a function that makes arrays; otherwise as `jit`."""
    return _compile(function)


def inline_jit(function: Callable[..., Any]) -> Any:
    """Compile as `jit` does, and always inline, so that a call costs nothing.

    A call copies every number of its arguments, and the loop of a run has over a thousand: shapes and strides of its
    arrays. That took 12 to 40 % of the fused engine's time.
    """
    return _compile(function, _nrt=False, forceinline=True)


def apart_jit(function: Callable[..., Any]) -> Any:
    """Compile as `jit` does, and never inline, so that what rarely happens does not lengthen what often does."""
    return _compile(function, apart=True, _nrt=False, forceinline=False)


def user_jit(function: Callable[..., Any]) -> Any:
    """Compile a function of a user's as `jit` does, but for the cache, which has it as a part of what calls it.

    An index out of range raises an IndexError: it would read and write the numbers of others.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "boundscheck": True, "_nrt": False}
    return function if INTERPRETED else njit(**options)(function)


INTERPRETED = bool(config.DISABLE_JIT)  # type: ignore[attr-defined]  # NUMBA_DISABLE_JIT of the environment
"""True if nothing is compiled, so that a debugger can stop in any loop."""


def as_records(values: NDArray[np.void]) -> NDArray[np.void]:
    """Return records whose fields are attributes, as compiled code reads them."""
    return values.view(np.recarray) if INTERPRETED else values


def external(library: Path, name: str) -> Any:
    """Return a function of a shared library that compiled code can call with two addresses; it returns nothing.

    Args:
        library: File of the library.
        name: Symbol of the function.
    """
    if INTERPRETED:
        function = getattr(ctypes.CDLL(str(library)), name)
        function.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        return function
    llvm.load_library_permanently(str(library))
    return types.ExternalFunction(name, types.void(types.voidptr, types.voidptr))


@intrinsic
def _two_to_by_bits(_: Any, exponent: Any) -> Any:
    def generate(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        # 1.5 * 2^52 plus a whole number ends with the bits of that number, here with those of a double's exponent.
        bits, real = ir.IntType(64), ir.DoubleType()
        biased = builder.fadd(arguments[0], ir.Constant(real, 1.5 * 2.0**52 + 1023.0))
        return builder.bitcast(builder.shl(builder.bitcast(biased, bits), ir.Constant(bits, 52)), real)

    return types.float64(types.float64), generate


two_to_by_bits: Any = _two_to_by_bits
"""Return 2 to the power of a whole number from -1022 to 1023, given as a float, by arithmetic on lanes."""


def on_stack(dtype: np.dtype[np.void]) -> Any:
    """Return a record on the stack of the compiled function that calls this; its values are undefined.

    No other memory overlaps it, and LLVM can prove so: loops over its lanes become vector instructions. It must not
    outlive the function. In lanes it must not be handed to a function that is not inlined.
    """
    assert dtype.fields is not None
    return SimpleNamespace(**{name: np.empty(field.shape, object) for name, (field, *_) in dtype.fields.items()})


@type_callable(on_stack)
def _type_on_stack(_: Any) -> Any:
    return lambda dtype: dtype.dtype


@lower_builtin(on_stack, types.DType)
def _lower_on_stack(context: Any, builder: Any, signature: Any, _: Any) -> Any:
    # Not a function that returns it: a record is returned by its value.
    record = signature.return_type
    with builder.goto_entry_block():
        place = builder.alloca(ir.ArrayType(ir.IntType(8), record.size))
        place.align = 64
    return builder.bitcast(place, context.get_value_type(record))


def lanes_for(count: int) -> int:
    """Return the number of lanes that `count` vehicles need, a multiple of 4 whose size is hidden from LLVM.

    It makes vector instructions of a loop over this number of lanes, with no remainder. It would unroll a short loop
    over a number that it knows before it tries.
    """
    return (count + 3) // 4 * 4


@type_callable(lanes_for)
def _type_lanes_for(_: Any) -> Any:
    return lambda count: types.int64


@lower_builtin(lanes_for, types.Integer)
def _lower_lanes_for(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
    number = ir.IntType(64)
    registers = builder.sdiv(builder.add(arguments[0], ir.Constant(number, 3)), ir.Constant(number, 4))
    hidden = builder.asm(ir.FunctionType(number, [number]), "", "=r,0", [registers], False)
    return builder.mul(hidden, ir.Constant(number, 4))


class _Pinned(types.Type):
    """A named tuple in memory, handed on by its address."""

    def __init__(self, content: Any) -> None:
        super().__init__(f"pinned({content})")
        self.content = content


@register_model(_Pinned)
class _PinnedModel(PrimitiveModel):
    def __init__(self, models: Any, pinned: Any) -> None:
        super().__init__(models, pinned, models.lookup(pinned.content).get_value_type().as_pointer())


def pinned(value: Any) -> Any:
    """Return a named tuple that functions hand on by its address, and those in it likewise; in Python, itself.

    Compiled code hands on every number of a tuple by itself, and numba and LLVM take most of their time for that: the
    loop of a run has over a thousand. The tuple is an argument of the function that calls this, and does not outlive
    the call.
    """
    return value


@type_callable(pinned)
def _type_pinned(_: Any) -> Any:
    return lambda value: value if isinstance(value, _Pinned) else _Pinned(value)


@lower_builtin(pinned, types.BaseNamedTuple)
def _lower_pinned(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
    return alloca_once_value(builder, arguments[0])


@lower_builtin(pinned, _Pinned)
def _lower_pinned_again(_: Any, __: Any, ___: Any, arguments: Any) -> Any:
    return arguments[0]


def _member(pinned: Any, name: str) -> tuple[int, Any]:
    """Return the index of a field of a pinned tuple, and its type there: named tuples are pinned too."""
    index = pinned.content.fields.index(name)
    held = pinned.content.types[index]
    return index, _Pinned(held) if isinstance(held, types.BaseNamedTuple) else held


@infer_getattr
class _PinnedFields(AttributeTemplate):
    key = _Pinned

    def generic_resolve(self, pinned: Any, name: str) -> Any:  # type: ignore[override]
        """Return the type of a field."""
        return _member(pinned, name)[1] if name in pinned.content.fields else None


@lower_getattr_generic(_Pinned)
def _lower_field(context: Any, builder: Any, pinned: Any, place: Any, name: str) -> Any:
    index, member = _member(pinned, name)
    within = gep_inbounds(builder, place, 0, index)
    return within if isinstance(member, _Pinned) else impl_ret_borrowed(context, builder, member, builder.load(within))


class Held:
    """A named tuple, with those in it, that is passed to compiled code by its address; its arrays are never replaced.

    Otherwise, functions that Python calls would contain code that unpacks every number from Python's objects. It takes
    a third to a half of their compile time, and 20 us of each call with the loop of a run.

    Attributes:
        value: The named tuple.
    """

    def __init__(self, value: Any) -> None:
        self.value = value

    @cached_property
    def _numba_type_(self) -> Any:
        try:
            mark = compute_fingerprint(self.value)
        except NotImplementedError:  # of some values numba has none
            return _Pinned(typeof(self.value))
        if mark not in _TYPES:
            _TYPES[mark] = _Pinned(typeof(self.value))
        return _TYPES[mark]

    @cached_property
    def _numbers(self) -> NDArray[np.void]:
        numbers = np.zeros((), _layout(self._numba_type_.content))
        numbers[()] = _numbers_of(self.value)
        return numbers

    @cached_property
    def address(self) -> int:
        """Address of its numbers, laid out as compiled code has them."""
        return self._numbers.ctypes.data


_TYPES: dict[bytes, Any] = {}
"""Types by numba's fingerprints of values: finding the type of a run's loop takes 2 ms, its fingerprint 0.06 ms."""


def kinds_of(tree: Any) -> Any:
    """Return the types of arguments as numba compiles for them; layouts of arrays do not count."""
    if isinstance(tree, tuple):
        return type(tree), *map(kinds_of, tree)
    return (tree.dtype, tree.ndim) if isinstance(tree, np.ndarray) else type(tree)


def held(value: Any) -> Any:
    """Return a named tuple as Held, where anything is compiled."""
    return value if INTERPRETED else Held(value)


@cache
def _layout(kind: Any) -> np.dtype[Any]:
    """Return the layout of values of a type in memory."""
    if isinstance(kind, types.Array):
        words = [(name, "i8") for name in ("counts", "parent", "size", "item", "data")]
        return np.dtype([*words, ("shape", "i8", (kind.ndim,)), ("strides", "i8", (kind.ndim,))], align=True)
    if isinstance(kind, types.BaseTuple):
        layout = np.dtype([(f"f{k}", _layout(held)) for k, held in enumerate(kind.types)], align=True)  # type: ignore[attr-defined]
        target = cpu_target.target_context
        assert layout.itemsize == target.get_abi_sizeof(target.get_value_type(kind)), kind
        return layout
    return as_dtype(kind)


def _numbers_of(value: Any) -> Any:
    """Return the numbers of a value in its layout."""
    if isinstance(value, np.ndarray):
        return 0, 0, value.size, value.itemsize, value.ctypes.data, value.shape, value.strides
    return tuple(map(_numbers_of, value)) if isinstance(value, tuple) else value


@unbox(_Pinned)
def _unbox_held(pinned: Any, held: Any, c: Any) -> Any:
    number = c.pyapi.object_getattr_string(held, "address")
    address = c.pyapi.long_as_ulonglong(number)
    c.pyapi.decref(number)
    return NativeValue(c.builder.inttoptr(address, c.context.get_value_type(pinned)))


@overload(len)
def _len(value):
    if isinstance(value, _Pinned):
        count = len(value.content.fields)
        return lambda value: count
    return None


def _compile(function: Callable[..., Any], apart: bool = False, **options: Any) -> Any:
    if INTERPRETED:
        return function
    options |= {"nogil": True, "error_model": "numpy"}
    own: dict[str, Any] = {**options, "no_cfunc_wrapper": True}
    compiled: Any = njit(pipeline_class=EntryCompiler, **own)(function)
    with contextlib.suppress(RuntimeError):  # no directory can be written: compile anew in each process
        keep_code(compiled, StoredCode(function))

    @cache
    def for_callers() -> Any:
        return linked(compiled.py_func, apart, **options)

    def get_call_template(args: Any, kws: Any) -> Any:  # code for integers serves literal integers too
        return for_callers().get_call_template(tuple(types.unliteral(argument) for argument in args), kws)

    compiled.get_call_template = get_call_template
    compiled.get_overload = lambda signature: for_callers().get_overload(signature)
    return compiled


class _EntryLibrary(JITCodeLibrary):
    """Code of a function that Python calls, optimised once all that it calls is linked in.

    Most of its own is what takes the arguments' numbers out of Python's objects. Not optimising that by itself first
    saves a tenth to a fifth of the time that the function takes.
    """

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout


class LinkedLibrary(JITCodeLibrary):
    """Intermediate code of a function and of all that it calls, without machine code."""

    def finalize(self) -> None:
        """Link the code of all that the function calls, so that a caller links this library alone."""
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        # Level 1: the function that Python calls is optimised as a whole. Loops that were unrolled or turned into
        # vector code before they are inlined take longer to compile, and 3 to 5 % longer to run.
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager(opt=1)
                passes.run(function, builder)

    def get_pointer_to_function(self, name: str) -> int:
        """Return the null pointer: there is no machine code that Python could call."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> "LinkedLibrary":
        """The library itself, because it is here that numba sets the environment of machine code."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Set nothing: environments belong to machine code."""

    def serialize_using_object_code(self) -> tuple[str, bytes]:
        """Return the name and the intermediate code, for the cache on disk."""
        return self.name, self._get_module_for_linking().as_bitcode()

    @classmethod
    def from_bitcode(cls, codegen: Any, name: str, bitcode: bytes) -> "LinkedLibrary":
        """Return the library of which the cache has the intermediate code."""
        library = cls(codegen, name)
        library._final_module = library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalized = True
        return library


class _ApartLibrary(LinkedLibrary):
    """Intermediate code of a function that callers do not inline."""

    def _optimize_functions(self, ll_module: Any) -> None:
        super()._optimize_functions(ll_module)
        for function in ll_module.functions:
            if not function.is_declaration:
                function.add_function_attribute("noinline")


class EntryCompiler(Compiler):
    """Compiler of the functions that Python calls."""

    library: type[JITCodeLibrary] = _EntryLibrary

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, with a library of this compiler's kind."""
        self.state.library = self.library(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        return super().compile_extra(func)


class _LinkedCompiler(EntryCompiler):
    library = LinkedLibrary


class _ApartCompiler(EntryCompiler):
    library = _ApartLibrary


class _LinkedCacheImpl(CompileResultCacheImpl):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return super().get_filename_base(fullname, abiflags) + ".linked"

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        libdata, fndesc, environment, signature, objectmode, lifted, annotation, reload_init, _ = payload
        library = LinkedLibrary.from_bitcode(target_context.codegen(), *libdata)
        fields: dict[str, Any] = {
            "typing_context": target_context.typing_context,
            "target_context": target_context,
            "entry_point": target_context.get_executable(library, fndesc, environment),
            "typing_error": None,
            "type_annotation": annotation,
            "signature": signature,
            "objectmode": objectmode,
            "lifted": lifted,
            "fndesc": fndesc,
            "library": library,
            "call_helper": None,
            "environment": environment,
            "metadata": None,
            "reload_init": reload_init,
            "referenced_envs": [],
        }
        return CompileResult(**fields)


class _LinkedCache(StoredCode):
    _impl_class = _LinkedCacheImpl


def linked(function: Any, apart: bool, **options: Any) -> Any:
    """Return the dispatcher of a function for calls by compiled code, which do not inline it if it is `apart`."""
    without: dict[str, Any] = {**options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    dispatcher: Any = njit(pipeline_class=_ApartCompiler if apart else _LinkedCompiler, **without)(function)
    with contextlib.suppress(RuntimeError):  # no directory can be written
        keep_code(dispatcher, _LinkedCache(function), "linked")
    return dispatcher


FunctionOf = Callable[[type], Any]
"""Called with the type of a part; returns the compiled function for it, or None if there is nothing to do."""


def for_each(function_of: FunctionOf, add: Any = None) -> Any:
    """Return a function that calls the function of each part, one after the other.

    Args:
        function_of: Functions of the parts, which are called with (part, its state, *arguments).
        add: Compiled function that adds what they return to a total; None if they return nothing.

    Returns:
        A function of (parts, states, total, *arguments), which returns the total.
    """

    @cache
    def written(kinds: tuple[type, ...]) -> Any:
        def calls(parts, states, total, *arguments):
            return total

        for k, kind in enumerate(kinds):
            function = function_of(kind)
            if function is not None:
                calls = _then(inline_jit(calls), k, function, add or _keep)
        return calls

    def call(parts, states, total, *arguments):
        return written(tuple(map(type, parts)))(parts, states, total, *arguments)

    @overload(call)
    def _compiled(parts, states, total, *arguments):
        return written(_kinds(parts))

    return call


def _then(before: Any, k: int, function: Any, add: Any) -> Any:
    """Return a function that calls `before`, and then the function of part k."""

    def calls(parts, states, total, *arguments):
        total = before(parts, states, total, *arguments)
        return add(total, function(parts[k], states[k], *arguments))

    return calls


@inline_jit
def _keep(total, _):
    return total


def has_any(function_of: FunctionOf) -> Any:
    """Return a function of parts that returns True if one of them has a function, a constant in compiled code."""

    def call(parts):
        return any(function_of(type(part)) is not None for part in parts)

    @overload(call)
    def _compiled(parts):
        found = any(function_of(kind) is not None for kind in _kinds(parts))
        return lambda parts: found

    return call


def _kinds(parts: Any) -> tuple[type, ...]:
    """Return the types of parts from numba's type of their tuple."""
    return tuple(kind.instance_class for kind in parts)
