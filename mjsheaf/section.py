"""Sections of files: strict models, the types of their fields, and one clear line for every error.

A section defines the fields of a part of a file. Consistency with the rest of the file is checked when the section
builds its part of a system.

Errors of a team have two norms, m:

    per_agent_rms   root mean square over the agents, sqrt(|e|^2 / N): headlines, and errors of runs
    team_norm       |e|, the norm over the whole team: bounds of certificates

A bound R on |e| bounds the RMS over N agents by R / sqrt(N).
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from mjsheaf.errors import InputError, and_more, shortened, suggestion, visible

LARGEST = 1e9
"""Maximum size of numbers in a file; larger values count as a blow-up, and their products would overflow."""

Id = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=100, description="letters, digits, _ and -")]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Duration = Annotated[float, Field(ge=1e-9, le=LARGEST)]
Point = Annotated[list[Number], Field(min_length=2, max_length=3)]
Matrix = Annotated[list[Annotated[list[Number], Field(min_length=1)]], Field(min_length=1)]


MAX_DEPTH = 50
"""Maximum depth of nested collections in a value; a scenario has six."""

MAX_PATH_LENGTH = 200
"""Maximum number of characters in the path of a field; valid paths are much shorter."""

MAX_PROBLEMS = 10
"""Maximum number of mistakes in a file that an error lists."""


def plain(value: Any, depth: int = 0) -> Any:
    """Convert mappings, tuples and NumPy values to the dicts, lists and numbers that YAML would give.

    Raises:
        InputError: The value is nested too deeply.
    """
    if depth > MAX_DEPTH:
        raise InputError(f"a value is nested more than {MAX_DEPTH} deep; expected fewer nested collections")
    if isinstance(value, Mapping):
        return {key: plain(item, depth + 1) for key, item in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist(), depth + 1)
    if isinstance(value, list | tuple):
        return [plain(item, depth + 1) for item in value]
    return value


def split_path(path: str) -> list[str]:
    """Split the path of a field, such as controller.gain or agents.A1.heading, into names.

    Raises:
        InputError: The path is too long, or a name in it is empty.
    """
    if len(path) > MAX_PATH_LENGTH:
        raise InputError(f"{path[:40]}...: has {len(path)} characters; expected at most {MAX_PATH_LENGTH}")
    names = path.split(".")
    if "" in names:
        raise InputError(f"{path!r}: a name in it is empty; expected names with one dot between them")
    return names


class Section(BaseModel):
    """Base of every section of a file: frozen; unknown keys, wrong types, NaN and infinity are errors.

    A section created in Python is validated like one from a file, and raises InputError. There, tuples are accepted as
    lists, and NumPy arrays and numbers as Python's. A copy does not share cached properties.
    """

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**plain(fields))
        except ValidationError as error:
            raise InputError(*validation_problems(error, type(self))).within(type(self).__name__) from None

    # Pydantic then reads files without calling it for each section.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def _fields(self) -> dict[str, Any]:
        return {name: self.__dict__[name] for name in type(self).model_fields}

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with some fields changed, which are not validated."""
        copied = super().model_copy(update=update, deep=deep)
        copied.__setstate__(copied.__getstate__())
        return copied

    def __getstate__(self) -> dict[Any, Any]:
        return {**super().__getstate__(), "__dict__": self._fields()}

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._fields() == other._fields()


def _require_tag(schema: dict[str, Any]) -> None:
    """Require the field that says which kind of section this is, although it has a default in Python."""
    fields = schema["properties"]
    tag = next(name for name in ("kind", "shape") if name in fields)
    del fields[tag]["default"]
    schema["required"] = [name for name in fields if name in (tag, *schema.get("required", ()))]


class Tagged(Section):
    """Base of sections of several kinds; a file must name the kind in a field `kind` or `shape`, Python need not."""

    model_config = ConfigDict(json_schema_extra=_require_tag)


def validation_problems(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """Describe every problem in a line 'field: problem', unknown fields first.

    Fields are written as in overrides. For a value with several possible kinds, pydantic reports problems for each of
    them. Only the best matching kind is reported, which is the one with the deepest error. After `MAX_PROBLEMS` lines,
    the last line counts the others. A list of valid field names appears only in the first line that it applies to.
    """
    schema = _schema(model)
    rivals: dict[tuple[int | str, ...], list[_Problem]] = {}
    for detail in error.errors(include_url=False):
        problem = _Problem.of(dict(detail), schema)
        rivals.setdefault(problem.path if problem.union is None else problem.union, []).append(problem)
    problems = sorted(map(_foremost, rivals.values()), key=lambda p: p.kind != "extra_forbidden")
    lines: dict[str, None] = {}
    listed: set[str] = set()
    for p in problems:
        expectation = f"; expected {p.legal}" if p.legal and p.legal not in listed else ""
        listed.add(p.legal)
        lines[f"{'.'.join(map(visible, p.path)) or 'file'}: {p.text}{expectation}{p.close}"] = None
    more = len(lines) - MAX_PROBLEMS
    shown = list(lines)[:MAX_PROBLEMS]
    return shown if more <= 0 else [*shown, and_more(more, "error")]


def _foremost(rivals: "list[_Problem]") -> "_Problem":
    """Choose the problem that is reported for one value."""
    unknown = next((p for p in rivals if p.kind == "extra_forbidden"), None)
    return unknown or max(rivals, key=lambda p: (len(p.path), not p.kind.endswith("_type")))


@cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


class _Problem(NamedTuple):
    """One of pydantic's errors.

    Attributes:
        kind: Pydantic's name of the error.
        path: Path of the field, written as in overrides.
        union: Path of the value with several possible kinds if the error is about one of them; else None.
        text: Problem and, unless `legal` has it, the expectation.
        legal: Names of valid fields, for an unknown field.
        close: Sentence about the closest of these.
    """

    kind: str
    path: tuple[int | str, ...]
    union: tuple[int | str, ...] | None
    text: str
    legal: str = ""
    close: str = ""

    @classmethod
    def of(cls, detail: dict[str, Any], schema: dict[str, Any]) -> "_Problem":
        """Read an error; the JSON Schema distinguishes fields from pydantic's names for the branches of a union."""
        kind = detail["type"]
        if kind == "extra_forbidden":
            *above, name = detail["loc"]
            place = _follow(schema, above)
            known = sorted({field for fields in place.fields(schema) for field in fields})
            legal = ", ".join(known) or "none"
            return cls(kind, (*place.path, name), place.union, "unknown field", legal, suggestion(str(name), known))
        place = _follow(schema, detail["loc"])
        context = detail.get("ctx", {})
        tag = context.get("discriminator", "").strip("'")
        known = sorted({value for fields in place.fields(schema) for value in _constants(fields.get(tag, {}))})
        tags = ", ".join(known)  # the kinds of a tagged union
        text = " ".join(str(detail["msg"]).removeprefix("Value error, ").split())
        complete = {
            "value_error": text,
            "missing": "missing; expected a value",
            "union_tag_not_found": f"missing; expected {tags}",
            "union_tag_invalid": f"unknown {shortened(repr(context.get('tag')))}; expected {tags}",
        }
        if kind in _EXPECTATIONS:
            text = f"expected {_EXPECTATIONS[kind].format(**context)}"
        text = complete.get(kind) or f"{text}, not {shortened(repr(detail['input']))}"
        path = (*place.path, tag) if tag else place.path
        return cls(kind, path, place.union, text[:1].lower() + text[1:])


_EXPECTATIONS = {
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "at most {le:g}",
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "list_type": "a list",
    "dict_type": "a mapping of fields to values",
    "model_type": "a mapping of fields to values",
    "model_attributes_type": "a mapping of fields to values",
    "literal_error": "{expected}",
    "multiple_of": "a multiple of {multiple_of:g}",
    "too_short": "a list of at least {min_length}",
    "too_long": "a list of at most {max_length}",
    "string_too_long": "at most {max_length} characters",
    "string_pattern_mismatch": "a letter, then letters, digits, _ and -",
}
"""Expectations by pydantic's name of an error, with its numbers."""


class _Place(NamedTuple):
    """A place in a file, as pydantic locates it.

    Attributes:
        path: Fields and items that lead to it.
        union: The same down to the first plain union on the way; None without one.
        nodes: Nodes of the JSON Schema there.
    """

    path: tuple[int | str, ...]
    union: tuple[int | str, ...] | None
    nodes: list[dict[str, Any]]

    def fields(self, schema: dict[str, Any]) -> list[dict[str, Any]]:
        """List the fields that each kind of value may have here."""
        return [node.get("properties", {}) for node in _variants(self.nodes, schema)]


def _follow(schema: dict[str, Any], location: Iterable[int | str]) -> _Place:
    """Follow a location of pydantic's, which also names the branches of unions."""
    path: tuple[int | str, ...] = ()
    union: tuple[int | str, ...] | None = None
    nodes = [schema]
    for part in location:
        variants = list(_variants(nodes, schema))
        below = _below(variants, part)
        if below:
            path = (*path, part)
            nodes = below
            continue
        tagged = [node for node in variants if part in _tags(node)]
        titled = [node for node in variants if part == node.get("title")]
        if union is None and not tagged:
            union = path
        nodes = tagged + titled or nodes
    return _Place(path, union, nodes)


def _below(nodes: list[dict[str, Any]], part: int | str) -> list[dict[str, Any]]:
    """Return the nodes of an item or a field; if no node has the field, those of mappings with any keys."""
    name = "items" if isinstance(part, int) else part
    tables = nodes if isinstance(part, int) else [node.get("properties", {}) for node in nodes]
    below = [table[name] for table in tables if name in table]
    of_any_key = [node.get("additionalProperties") for node in nodes]
    return below or [node for node in of_any_key if isinstance(node, dict)]


def _variants(nodes: Iterable[dict[str, Any]], schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Follow references and unions to plain nodes."""
    for node in nodes:
        if "$ref" in node:
            yield from _variants([schema["$defs"][node["$ref"].rsplit("/", 1)[1]]], schema)
        elif "oneOf" in node or "anyOf" in node:
            yield from _variants(node.get("oneOf", node.get("anyOf", [])), schema)
        else:
            yield node


def _tags(node: dict[str, Any]) -> set[str]:
    """Return the values of the field that select this branch of a tagged union."""
    return {value for field in node.get("properties", {}).values() for value in _constants(field)}


def _constants(field: dict[str, Any]) -> set[str]:
    """Return the values of a field that may only have certain ones."""
    return {str(value) for value in field.get("enum", [field["const"]] if "const" in field else [])}


class Record(BaseModel):
    """Base of results that JSON files and `--json` contain: frozen, without unknown fields."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_by_name=True, serialize_by_alias=True)


class FiniteRecord(Record):
    """A `Record` whose numbers are finite; fields of type `Finite` may be null."""

    model_config = ConfigDict(allow_inf_nan=False)


def finite(x: float | None) -> float | None:
    """Convert a number for JSON: None if it is infinite or NaN."""
    return None if x is None or not math.isfinite(x) else float(x)


Finite = Annotated[float | None, BeforeValidator(finite)]
"""A number, or null; see `finite`."""


Norm = Literal["per_agent_rms", "team_norm"]

PER_AGENT_RMS: Literal["per_agent_rms"] = "per_agent_rms"
TEAM_NORM: Literal["team_norm"] = "team_norm"

OF_TEAM = "which norm the errors of this record are, but for fields `..._per_agent`, which are the RMS over agents"
"""Description of the field `norm` of a record of certificates."""

OF_NONE = "none of the errors is a norm over the whole team: the tracking error is the RMS over agents"
"""Description of the field `norm` of a record of measured errors."""


def per_agent(size: float | None, agents: int) -> float | None:
    """Return the RMS over agents of errors whose norm over the whole team is given, m; None stays None."""
    return None if size is None else size / math.sqrt(agents)
