"""Reading files that people write: YAML without surprises, strict sections, one clear line for every error."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mjsheaf.errors import ScenarioError, suggestion

_LARGEST_FILE = 20_000_000  # bytes
_DEEPEST = 50  # collections within one another; a scenario has six
_SURROGATE = re.compile("[\\ud800-\\udfff]")  # "\ud800" in YAML; no file can hold it
_LONGEST_INTEGER = 3_000  # digits; Python does not print what has more than 4300 decimal ones


class Section(BaseModel):
    """Base of every section of a file: unknown keys, wrong types, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class _Loader(yaml.SafeLoader):
    """YAML's safe loader, which executes nothing, with plain values read as in YAML 1.2.

    In YAML 1.1, which is PyYAML's own, 010 is eight, 1:30 is ninety, `no` is false, 1e-3 is text. Refused are
    duplicate keys, tags, anchors and aliases (which let a short file stand for an endless one), and deep nesting.
    """

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0

    def fetch_tag(self) -> None:
        self._refuse("a tag")

    def fetch_anchor(self) -> None:
        self._refuse("an anchor")

    def fetch_alias(self) -> None:
        self._refuse("an alias")

    def _refuse(self, what: str) -> None:
        problem = f"{what} is not allowed; write the value out"
        raise yaml.scanner.ScannerError(None, None, problem, self.get_mark())

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self._depth > _DEEPEST:
            mark = self.peek_event().start_mark
            raise yaml.composer.ComposerError(None, None, f"nested more than {_DEEPEST} deep", mark)
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is not text", key_node.start_mark)
            if key in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key {key!r} is given twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        value = super().construct_scalar(node)
        if isinstance(value, str) and not value.isascii() and _SURROGATE.search(value):
            problem = "half of a surrogate pair, which is no text; write the character itself"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return value

    def construct_integer(self, node: yaml.ScalarNode) -> int:
        """Read an integer of YAML 1.2; the one of 1.1 takes a leading 0 for octal."""
        if len(node.value) > _LONGEST_INTEGER:
            problem = f"a number of {len(node.value)} digits; expected up to {_LONGEST_INTEGER}"
            raise yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
        return int(node.value, {"0o": 8, "0x": 16}.get(node.value[:2], 10))


class _Dumper(yaml.SafeDumper):
    """YAML's safe dumper, quoting text that YAML 1.1 or 1.2 would take for something else."""


# The core schema of YAML 1.2.2, section 10.3.2: kind, pattern, and the characters with which it may begin.
_PLAIN_VALUES = (
    ("null", r"(~|null|Null|NULL|)", ["~", "n", "N", ""]),
    ("bool", r"(true|True|TRUE|false|False|FALSE)", list("tTfF")),
    ("int", r"([-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)", list("-+0123456789")),
    ("float", r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?", list("-+0123456789.")),
    ("float", r"([-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN))", list("-+.")),
)
_Loader.yaml_implicit_resolvers = {}
for _kind, _pattern, _first in _PLAIN_VALUES:
    for _side in (_Loader, _Dumper):
        _side.add_implicit_resolver(f"tag:yaml.org,2002:{_kind}", re.compile(f"^{_pattern}$"), _first)
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_integer)


def read_yaml(path: Path) -> dict[str, Any]:
    """Read a YAML file that holds a mapping.

    Raises:
        ScenarioError: the file is missing, too large, not text, not YAML, empty, not a mapping, or carries tags,
            anchors or duplicate keys.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(data) > _LARGEST_FILE:
        raise ScenarioError(f"{path}: larger than {_LARGEST_FILE // 10**6} MB; expected a file that a person wrote")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: not a text file in UTF-8") from None
    raw = parse_yaml(text, str(path))
    if raw is None:
        raise ScenarioError(f"{path}: empty; expected a mapping of fields to values")
    if not isinstance(raw, dict):
        raise ScenarioError(f"{path}: holds a {type(raw).__name__}; expected a mapping of fields to values")
    return raw


def parse_yaml(text: str, source: str) -> Any:
    """Parse YAML text; errors name the source and the line."""
    with _told(source):
        return yaml.load(text, Loader=_Loader)


def compose_yaml(text: str, source: str) -> yaml.Node | None:
    """The nodes of YAML text, which know their places in it; errors as `parse_yaml`."""
    with _told(source):
        return yaml.compose(text, Loader=_Loader)


@contextmanager
def _told(source: str) -> Iterator[None]:
    """Tell errors of YAML in one line."""
    try:
        yield
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not YAML"
        raise ScenarioError(f"{source}: {where}{' '.join(str(problem).split())}") from None


def dump_yaml(value: dict[str, Any], *, flow: bool | None = None, width: float = 120) -> str:
    """Write a mapping as YAML that `read_yaml` reads to the same values, whether as YAML 1.1 or 1.2.

    Args:
        value: the mapping.
        flow: whether all of it stands in braces; None puts only what is innermost there.
        width: of a line.
    """
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, default_flow_style=flow, width=width)


def describe_validation_error(error: ValidationError, model: type[BaseModel]) -> str:
    """The first thing that is wrong, as 'field: what is wrong', and how many more there are.

    The field is written as an override takes it. Where a value may be of several kinds pydantic tells for each why it
    is not of that kind: the kind that fits it best, which is the one whose error lies deepest, is spoken of.
    """
    schema = _schema(model)
    problems = [_Problem.of(dict(detail), schema) for detail in error.errors(include_url=False)]
    first = next((p for p in problems if p.kind == "extra_forbidden"), problems[0])
    if first.kind != "extra_forbidden":
        rivals = [p for p in problems if p.value == first.value]
        first = max(rivals, key=lambda p: (len(p.path), not p.kind.endswith("_type")))
    others = len({p.value for p in problems}) - 1
    more = f" (and {others} more)" if others else ""
    return f"{'.'.join(map(_visible, first.path)) or 'file'}: {first.text}{more}"


@cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _visible(part: int | str) -> str:
    """A key as it may be printed: short, and without characters that a terminal obeys."""
    text = str(part)
    text = text if text.isprintable() else repr(text)[1:-1]
    return text if len(text) <= 60 else text[:57] + "..."


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
        shown = repr(detail["input"])
        shown = shown if len(shown) <= 60 else shown[:57] + "..."
        if unknown:
            known = sorted({name for node in _variants(nodes, schema) for name in node.get("properties", {})})
            text = f"unknown field; expected {', '.join(known)}{suggestion(str(unknown[0]), known)}"
        elif kind in ("union_tag_invalid", "union_tag_not_found"):
            path += (context["discriminator"].strip("'"),)
            missing = kind == "union_tag_not_found"
            text = "field required" if missing else f"{context['tag']!r} is none of {context['expected_tags']}"
        elif kind in ("model_type", "model_attributes_type", "dict_type"):
            text = f"should be a mapping of fields to values, not {shown}"
        elif kind not in ("missing", "value_error"):
            text += f", not {shown}"
        return cls(kind, path, path if value is None else value, text[:1].lower() + text[1:])


def _follow(
    schema: dict[str, Any], location: tuple[int | str, ...]
) -> tuple[tuple[int | str, ...], tuple[int | str, ...] | None, list[dict[str, Any]]]:
    """The fields of a location, those of them above its first plain union, and the schema's nodes at its end."""
    path: tuple[int | str, ...] = ()
    union: tuple[int | str, ...] | None = None
    nodes = [schema]
    for part in location:
        variants = _variants(nodes, schema)
        if isinstance(part, int):
            below = [node["items"] for node in variants if "items" in node]
        else:
            below = [node["properties"][part] for node in variants if part in node.get("properties", {})]
        below = below or [node["additionalProperties"] for node in variants if _is_open(node)]
        if below:
            path, nodes = (*path, part), below
            continue
        if not any(part in _tags(node) for node in variants) and union is None:
            union = path
        nodes = [node for node in variants if part in _tags(node) or part == node.get("title")] or nodes
    return path, union, nodes


def _is_open(node: dict[str, Any]) -> bool:
    """Whether a mapping may have any keys, with values of one kind."""
    return isinstance(node.get("additionalProperties"), dict)


def _variants(nodes: list[dict[str, Any]], schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Follow references and unions to plain nodes."""
    plain, waiting = [], list(nodes)
    while waiting:
        node = waiting.pop(0)
        if "$ref" in node:
            waiting.append(schema["$defs"][node["$ref"].rsplit("/", 1)[1]])
        elif "oneOf" in node or "anyOf" in node:
            waiting.extend(node.get("oneOf", node.get("anyOf", [])))
        else:
            plain.append(node)
    return plain


def _tags(node: dict[str, Any]) -> set[str]:
    """The values of the field that chooses this branch of a tagged union."""
    fields = node.get("properties", {}).values()
    return {str(v) for field in fields for v in field.get("enum", [field["const"]] if "const" in field else [])}


Id = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=100, description="letters, digits, _ and -")]
LARGEST = 1e9
"""Of every number in a file: a blow-up begins here, and products of what is larger would overflow."""

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST)]
Duration = Annotated[float, Field(ge=1e-9, le=LARGEST)]
Point = Annotated[list[Number], Field(min_length=2, max_length=3)]
Matrix = Annotated[list[Annotated[list[Number], Field(min_length=1)]], Field(min_length=1)]
