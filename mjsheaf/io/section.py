"""Sections of files: strict models, the types of their fields, and one clear line for every error.

A section says field by field what a file may hold. How its fields fit together with the rest of a file is checked where
it builds its part of a system.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from mjsheaf.errors import InputError, shortened, suggestion

LARGEST = 1e9
"""Largest size of every number in a file: a blow-up begins here, and products of larger numbers would overflow."""

Id = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=100, description="letters, digits, _ and -")]
Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Duration = Annotated[float, Field(ge=1e-9, le=LARGEST)]
Point = Annotated[list[Number], Field(min_length=2, max_length=3)]
Matrix = Annotated[list[Annotated[list[Number], Field(min_length=1)]], Field(min_length=1)]


def plain(value: Any) -> Any:
    """Mappings, tuples and numpy's values as the dicts, lists and numbers that YAML would give."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


class Section(BaseModel):
    """Base of every section of a file: frozen; unknown keys, wrong types, NaN and infinity are errors.

    A section made in Python is validated as one from a file is, and raises InputError; there tuples stand for lists,
    and numpy's arrays and numbers for Python's. Cached properties belong to one object: a copy has none of them.
    """

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    def __init__(self, /, **fields: Any) -> None:
        try:
            super().__init__(**plain(fields))
        except ValidationError as error:
            raise InputError(f"{type(self).__name__}: {describe_validation_error(error, type(self))}") from None

    # Files are read without a call of it for each section.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    def _fields(self) -> dict[str, Any]:
        return {name: self.__dict__[name] for name in type(self).model_fields}

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with some fields changed, which are not validated."""
        copied = super().model_copy(update=update, deep=deep)
        copied.__setstate__(copied.__getstate__())
        return copied

    def __getstate__(self) -> dict[Any, Any]:
        return {**super().__getstate__(), "__dict__": self._fields()}

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._fields() == other._fields()


def tagged(name: str) -> Callable[[dict[str, Any]], None]:
    """For `json_schema_extra`: a file must name a section's kind, which has a default in Python."""

    def require(schema: dict[str, Any]) -> None:
        del schema["properties"][name]["default"]
        schema["required"] = [field for field in schema["properties"] if field in (name, *schema.get("required", ()))]

    return require


def describe_validation_error(error: ValidationError, model: type[BaseModel]) -> str:
    """The first thing that is wrong, as 'field: what is wrong', and how many more there are.

    The field is written as an override takes it. Where a value may be of several kinds pydantic tells for each why it
    is not of that kind: the kind that fits it best, which is the one whose error lies deepest, is spoken of.
    """
    schema = _schema(model)
    problems = [_Problem.of(dict(detail), schema) for detail in error.errors(include_url=False)]
    rivals = [p for p in problems if p.value == problems[0].value]
    deepest = max(rivals, key=lambda p: (len(p.path), not p.kind.endswith("_type")))
    first = next((p for p in problems if p.kind == "extra_forbidden"), deepest)
    others = len({p.value for p in problems}) - 1
    more = f" ({others} more error{'s' * (others > 1)})" if others else ""
    return f"{'.'.join(map(_visible, first.path)) or 'file'}: {first.text}{more}"


@cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _visible(part: int | str) -> str:
    """A key as it may be printed: short, and without characters that a terminal obeys."""
    text = str(part)
    return shortened(text if text.isprintable() else repr(text)[1:-1])


class _Problem(NamedTuple):
    """One of pydantic's errors.

    Attributes:
        kind: pydantic's name of it.
        path: of the field, as an override takes it.
        value: path of the value that may be of several kinds, of which this error is about one; else `path`.
        text: what is wrong and what is expected.
    """

    kind: str
    path: tuple[int | str, ...]
    value: tuple[int | str, ...]
    text: str

    @classmethod
    def of(cls, detail: dict[str, Any], schema: dict[str, Any]) -> "_Problem":
        """Read an error; the JSON Schema tells fields from pydantic's names for the branches of a union."""
        kind, location, context = detail["type"], detail["loc"], detail.get("ctx", {})
        text = " ".join(str(detail["msg"]).removeprefix("Value error, ").split())
        unknown = location[-1:] if kind == "extra_forbidden" else ()
        path, value, nodes = _follow(schema, location[: len(location) - len(unknown)])
        path += unknown
        shown = shortened(repr(detail["input"]))
        if unknown:
            known = sorted({name for node in _variants(nodes, schema) for name in node.get("properties", {})})
            text = f"unknown field; expected {', '.join(known)}{suggestion(str(unknown[0]), known)}"
        elif kind in ("union_tag_invalid", "union_tag_not_found"):
            path += (context["discriminator"].strip("'"),)
            missing = kind == "union_tag_not_found"
            given = "missing" if missing else f"unknown {shortened(repr(context['tag']))}"
            branches = [node.get("properties", {}).get(path[-1], {}) for node in _variants(nodes, schema)]
            tags = sorted({tag for node in branches for tag in _tags({"properties": {"": node}})})
            text = f"{given}; expected {', '.join(tags)}"
        elif kind == "missing":
            text = "missing; expected a value"
        elif kind != "value_error":
            text = f"{_expectation(kind, context, text)}, not {shown}"
        return cls(kind, path, path if value is None else value, text[:1].lower() + text[1:])


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
"""What is expected, by pydantic's name of an error and its numbers."""


def _expectation(kind: str, context: dict[str, Any], text: str) -> str:
    """A sentence of what is expected in place of a value; pydantic's own where none is known."""
    return f"expected {_EXPECTATIONS[kind].format(**context)}" if kind in _EXPECTATIONS else text


def _follow(
    schema: dict[str, Any], location: tuple[int | str, ...]
) -> tuple[tuple[int | str, ...], tuple[int | str, ...] | None, list[dict[str, Any]]]:
    """The fields of a location, those of them above its first plain union, and the schema's nodes at its end."""
    path: tuple[int | str, ...] = ()
    union: tuple[int | str, ...] | None = None
    nodes = [schema]
    for part in location:
        variants = list(_variants(nodes, schema))
        if isinstance(part, int):
            below = [node["items"] for node in variants if "items" in node]
        else:
            below = [node["properties"][part] for node in variants if part in node.get("properties", {})]
        of_any_key = [node.get("additionalProperties") for node in variants]
        below = below or [node for node in of_any_key if isinstance(node, dict)]
        if below:
            path, nodes = (*path, part), below
            continue
        if not any(part in _tags(node) for node in variants) and union is None:
            union = path
        nodes = [node for node in variants if part in _tags(node) or part == node.get("title")] or nodes
    return path, union, nodes


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
    """The values of the field that chooses this branch of a tagged union."""
    fields = node.get("properties", {}).values()
    return {str(v) for field in fields for v in field.get("enum", [field["const"]] if "const" in field else [])}


class Record(BaseModel):
    """Base of a result that a JSON file or `--json` holds as it is: frozen, and of known fields only."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_by_name=True, serialize_by_alias=True)


class FiniteRecord(Record):
    """A `Record` whose numbers are finite; those that need not be are `Finite`."""

    model_config = ConfigDict(allow_inf_nan=False)


def finite(x: float | None) -> float | None:
    """A number as JSON can hold it: None where it is infinite or not a number."""
    return None if x is None or not math.isfinite(x) else float(x)


Finite = Annotated[float | None, BeforeValidator(finite)]
"""A number, or null: see `finite`."""
