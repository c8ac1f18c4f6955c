"""Reading files that people write: YAML without surprises, strict sections, one clear line for every error."""

import re
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from mjsheaf.errors import ScenarioError

_LARGEST_FILE = 20_000_000  # bytes


class Section(BaseModel):
    """Base of every section of a file: unknown keys, wrong types, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class _Loader(yaml.SafeLoader):
    """YAML's safe loader, with duplicate keys refused and 1e-3 read as a number, as in YAML 1.2."""

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


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?([0-9][0-9_]*(\.[0-9_]*)?|\.[0-9_]+)[eE][-+]?[0-9]+$"),
    list("-+0123456789."),
)


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
        raise ScenarioError(f"{path}: larger than {_LARGEST_FILE // 10**6} MB; legal is a file that a person wrote")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: not a text file in UTF-8") from None
    raw = parse_yaml(text, str(path))
    if raw is None:
        raise ScenarioError(f"{path}: empty; legal is a mapping of fields to values")
    if not isinstance(raw, dict):
        raise ScenarioError(f"{path}: holds a {type(raw).__name__}; legal is a mapping of fields to values")
    return raw


def parse_yaml(text: str, source: str) -> Any:
    """Parse YAML text; errors name the source and the line."""
    try:
        for token in yaml.scan(text, Loader=_Loader):
            if isinstance(token, yaml.TagToken | yaml.AliasToken | yaml.AnchorToken):
                what = "a tag" if isinstance(token, yaml.TagToken) else "an anchor or alias"
                line = token.start_mark.line + 1
                raise ScenarioError(f"{source}: line {line}: {what} is not allowed; write the value out")
        return yaml.load(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not YAML"
        raise ScenarioError(f"{source}: {where}{' '.join(str(problem).split())}") from None
    except RecursionError:
        raise ScenarioError(f"{source}: nested too deeply") from None
    except ScenarioError:
        raise
    except ValueError as error:  # an impossible date or number
        raise ScenarioError(f"{source}: {' '.join(str(error).split())}") from None


def describe_validation_error(error: ValidationError, model: type[BaseModel]) -> str:
    """The first thing that is wrong, as 'field: what is wrong', and how many more there are."""
    problems = error.errors(include_url=False)
    first = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    where = ".".join(str(part) for part in first["loc"]) or "file"
    text = " ".join(str(first["msg"]).removeprefix("Value error, ").split())
    if first["type"] == "extra_forbidden":
        text = f"unknown field; legal are {', '.join(_legal_fields(model, first['loc'][:-1]))}"
    elif first["type"] not in ("missing", "value_error"):
        shown = repr(first["input"])
        text += f", not {shown if len(shown) <= 60 else shown[:57] + '...'}"
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    return f"{where}: {text[:1].lower() + text[1:]}{more}"


def _legal_fields(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Names of the fields that are legal at a place of a model's schema."""
    schema = model.model_json_schema()
    nodes = [schema]
    for part in location:
        below = []
        for node in _variants(nodes, schema):
            if isinstance(part, int):
                below.append(node.get("items", {}))
            elif part in node.get("properties", {}):
                below.append(node["properties"][part])
            elif part in _tags(node):
                below.append(node)  # pydantic names the chosen branch of a union in the location
        nodes = below or nodes
    return sorted({name for node in _variants(nodes, schema) for name in node.get("properties", {})})


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
    """The names by which pydantic may call this branch of a union: its class, or its discriminator's values."""
    values = {node.get("title", "")}
    for field in node.get("properties", {}).values():
        values.update(field.get("enum", [field["const"]] if "const" in field else []))
    return {str(v) for v in values}
