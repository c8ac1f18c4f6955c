"""Terms that users write and register, compiled into the law that runs.

A term is a function of one agent's local data. It is called for every agent once a control period, after the shipped
terms. It reads the agent's disagreement eta and adds to the agent's command. It may store numbers for each agent; they
are zero before the first sample and part of the state of a run:

    @mjsheaf.register(parameters=["gain", "forgetting"], memory=3)
    def leaky_integral(residual, command, memory, parameters, period):
        for i in range(3):
            memory[i] += period * (residual[i] - parameters[1] * memory[i])
            command[i] -= parameters[0] * memory[i]

In compiled code each term is a named tuple with a type of its own. The name of the type contains a digest of the file
that defines the term and of the values that it refers to, because compiled code contains those values. The law holds
the terms of a team in a tuple. Their types determine which functions numba calls, so another team with the same terms
compiles nothing more. The cache on disk identifies a term by its type, and a changed source gives a new type.
"""

import hashlib
import inspect
import marshal
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from mjsheaf.arrays import Array, Take
from mjsheaf.compile.jit import INTERPRETED, NumbaError, for_each, inline_jit, types, user_jit
from mjsheaf.errors import InputError, expected, in_field
from mjsheaf.files import describe, digest_of, execute_file
from mjsheaf.law.terms import Terms
from mjsheaf.section import Section
from mjsheaf.team import Team

_PREFIX = "Term_"
_MAX_MEMORY = 1000  # numbers that a term may store for each agent
SHIPPED = tuple(Terms.model_fields)
"""Names of the terms that come with mjsheaf."""

Term = Callable[[Array, Array, Array, Array, float], None]
"""Called with (residual (3,), m; command (3,), m/s; memory (m,); parameters (p,); period, s), to write to command and
memory."""


class CustomTerm(Section):
    """A compiled term of the user's own; see `mjsheaf.register`."""

    file: str | None = Field(
        None,
        description="Python file that registers the term, from this file's directory; not needed if the term is "
        "registered before the scenario is read",
    )
    parameters: dict[str, float] = Field({}, description="values of the term's parameters, by name [-]")


@dataclass(frozen=True)
class Registered:
    """A term that has been registered.

    Attributes:
        evaluate: Compiled function that evaluates the term for all agents; see `_for_each_agent`.
        parameters: Names of its parameters.
        memory: Number of values that it stores for each agent.
        kind: Type of its named tuple.
        source: SHA-256 of the file that defines it, hexadecimal; of no bytes if there is no file.
    """

    evaluate: Any
    parameters: tuple[str, ...]
    memory: int
    kind: type
    source: str


_registered: dict[str, Registered] = {}
_of_kind: dict[str, Registered] = {}


def register(*, parameters: Sequence[str] = (), memory: int = 0) -> Callable[[Term], Term]:
    """Register a compiled term of the law under its function's name: a decorator.

    Args:
        parameters: Names of the numbers that a scenario sets, in the order in which the term receives them.
        memory: Number of values that the term stores for each agent.

    Returns:
        A decorator of a function `term(residual, command, memory, parameters, period)`. numba must be able to compile
        the function without allocating arrays. `residual` is the agent's eta, shape (3,), m. The term adds to
        `command`, the agent's velocity from the terms before it, shape (3,), m/s. It may write to `memory`, shape
        (memory,), which persists between samples. `period` is the control period, s.

    Raises:
        InputError: A term of mjsheaf has this name, a parameter's name is invalid or repeated, or the function does not
            compile, or writes to residual or parameters.
    """
    names = tuple(parameters) if isinstance(parameters, list | tuple) else ("",)
    if len(set(names)) != len(names) or not all(map(_is_name, names)):
        raise InputError(f"register: parameters are {parameters!r}; expected a list of different names")
    if isinstance(memory, bool) or not (isinstance(memory, int) and 0 <= memory <= _MAX_MEMORY):
        raise InputError(f"register: memory is {memory!r}; expected a whole number from 0 to {_MAX_MEMORY}")

    def decorate(function: Term) -> Term:
        name = function.__name__
        if not _is_name(name) or name in SHIPPED:
            raise InputError(f"register: a term cannot be named {name!r}; expected a name that mjsheaf does not use")
        file = _file_of(function)
        digest = _digest(repr(memory).encode(), file, *_meaning(function, set()))
        kind = _kind(f"{_PREFIX}{name}_{digest[:16]}")
        evaluate = _for_each_agent(_compiled(function))
        known = Registered(evaluate, names, memory, kind, _digest(file))
        _registered[name] = _of_kind[kind.__name__] = known
        return function

    return decorate


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and name.isidentifier() and name.isascii()


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def _file_of(function: Term) -> bytes:
    """Return the contents of the file that defines a function; empty if there is none."""
    try:
        return Path(inspect.getsourcefile(function) or "").read_bytes()
    except (OSError, TypeError):
        return b""


def _meaning(value: Any, met: set[int]) -> Iterator[bytes]:
    """Yield the bytes that identify a value in compiled code; for functions, include everything they refer to."""
    value = getattr(value, "py_func", value)
    if id(value) in met:
        return
    met.add(id(value))
    if isinstance(value, FunctionType):
        yield marshal.dumps(value.__code__, 2)  # without references, which depend on what else a process has
        inside = inspect.getclosurevars(value)
        for names in (inside.nonlocals, inside.globals):
            for name in sorted(names):
                yield name.encode()
                yield from _meaning(names[name], met)
    elif isinstance(value, ModuleType):
        yield _file_of(value)  # type: ignore[arg-type]
    elif isinstance(value, np.ndarray):
        yield str((value.dtype, value.shape)).encode() + value.tobytes()
    else:
        yield repr(value).encode()


def _compiled(function: Term) -> Any:
    """Compile a term for the shapes of its arguments, so that errors are reported when it is registered."""
    compiled = user_jit(function)
    if not INTERPRETED:
        numbers = types.float64[::1]
        given = types.Array(types.float64, 1, "C", readonly=True)
        try:
            compiled.compile((given, numbers, numbers, given, types.float64))
        except NumbaError as error:
            lines = [line for line in str(error).splitlines() if line.strip()]
            raise InputError(f"register: {function.__name__} does not compile: {' '.join(lines[:3])}") from None
    return compiled


def __getattr__(name: str) -> Any:
    """Return the type of a term by name. The cache of compiled code looks it up before the term is registered."""
    if re.fullmatch(rf"{_PREFIX}\w+_[0-9a-f]{{16}}", name):
        return _kind(name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


@cache
def _kind(name: str) -> type:
    """Return the type of the named tuples of a term: see `TermOfLaw` for its fields."""
    kind = type(name, (TermOfLaw,), {"__slots__": (), "__module__": __name__})
    globals()[name] = kind
    return kind


class TermOfLaw(NamedTuple):
    """A registered term in the law of a team: the fields that the type of each has.

    Attributes:
        number: Number of the term.
        agents: Number of vehicles with the term; they are the first ones.
        parameters: Values of its parameters.
        period: Control period, s.
    """

    number: int
    agents: int
    parameters: Array
    period: float


def pack_custom(terms: Mapping[str, CustomTerm], agents: int, period: float) -> tuple[Any, ...]:
    """Return the registered terms of a law for compiled code, in the order of their names.

    Raises:
        InputError: A term is not registered, its file cannot be read or does not register it, or parameters are
            missing or unknown; the message begins with the field.
    """
    packed = list[Any]()
    for number, name in enumerate(sorted(terms)):
        section = terms[name]
        with in_field(f"controller.custom.{name}"):
            if section.file is not None:
                _execute(section.file, name)
            if name not in _registered:
                hint = "" if section.file else "; give the file that registers it as `file`"
                raise InputError(f"no term of this name is registered; {expected(name, list(_registered))}{hint}")
            term = _registered[name]
            for given in section.parameters:
                if given not in term.parameters:
                    raise InputError(f"parameters.{given}: unknown; {expected(given, term.parameters)}")
            if missing := [needed for needed in term.parameters if needed not in section.parameters]:
                raise InputError(f"parameters: {', '.join(missing)} missing")
        make: Any = term.kind
        packed.append(
            make(number, agents, np.array([section.parameters[one] for one in term.parameters], np.float64), period)
        )
    return tuple(packed)


def _execute(file: str, name: str) -> None:
    """Execute a file that registers terms, unless they are registered and the file has not changed since."""
    path = Path(file)
    if not file.endswith(".py"):
        raise InputError(f"file: {file!r}; expected a Python file, NAME.py")
    with in_field("file"):
        digest = digest_of(path)
    if name in _registered and _registered[name].source == digest:
        return
    _registered.pop(name, None)
    try:
        execute_file(path, "mjsheaf_terms")
    except (KeyboardInterrupt, InputError):
        raise
    except BaseException as error:
        raise InputError(f"file: {describe(error)}") from error


def names_of(terms: Sequence[Any]) -> tuple[str, ...]:
    """Return the names of the registered terms of a law."""
    return tuple(type(term).__name__[len(_PREFIX) : -17] for term in terms)


def new_custom_memory(terms: Sequence[Any], V: int, take: Take) -> tuple[Array, ...]:
    """Return the memory of each term for V vehicles before the first sample, shape (V, m) each."""
    return tuple(take((V, _of_kind[type(term).__name__].memory)) for term in terms)


def carry_custom(old: Sequence[Any], kept: Sequence[Array], new: Sequence[Any], memory: Sequence[Array]) -> None:
    """Copy the memory of the terms that two laws share from the old law to the new one."""
    before = {type(term): own for term, own in zip(old, kept, strict=True)}
    for term, own in zip(new, memory, strict=True):
        if type(term) in before:
            own[:] = before[type(term)]


@contextmanager
def naming_terms(terms: Sequence[Any], team: Team, evaluated: Array) -> Iterator[None]:
    """Turn an exception of a registered term into an InputError with term, agent and time.

    Args:
        terms: Registered terms of the law that is evaluated inside.
        team: The team.
        evaluated: Numbers of the term and the vehicle that were evaluated last, and the time, s, shape (3,).
    """
    try:
        yield
    except Exception as error:
        if not terms:
            raise
        k, v, t = evaluated
        what = str(error) if isinstance(error, InputError) else describe(error)
        name, agent = names_of(terms)[int(k)], team.agent_ids[int(v)]
        raise InputError(f"controller.custom.{name}: {agent} at t = {t:.6g} s: {what}") from error


@inline_jit
def is_finite(velocity):
    """Return True if a velocity (3,) is finite."""
    return abs(velocity[0]) + abs(velocity[1]) + abs(velocity[2]) < np.inf


def _for_each_agent(function: Any) -> Any:
    """Return a compiled function that evaluates a term for each of its agents."""

    @inline_jit
    def evaluate(term, memory, t, residual, command, evaluated):
        for v in range(term.agents):
            evaluated[0], evaluated[1], evaluated[2] = term.number, v, t
            was_finite = is_finite(command[v]) and is_finite(residual[v])
            function(residual[v], command[v], memory[v], term.parameters, term.period)
            if was_finite and not is_finite(command[v]):
                raise InputError("the velocity that it commands is not finite")

    return evaluate


add_custom = for_each(lambda kind: _of_kind[kind.__name__].evaluate)
"""Add registered terms to the commands: called with (terms, what they remember, None, t, residual, command, evaluated).

`residual` is eta (V, 3), m, and `command` (V, 3), m/s. Before each call of a term, `evaluated` (3,) gets the numbers of
the term and of the vehicle, and the time t, s.
"""
