"""References, as Markdown: a file's fields, by its JSON Schema and with examples out of real files, and variables."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from mjsheaf.files import list_studies, read_yaml
from mjsheaf.results import dataset
from mjsheaf.scenario import Scenario, list_scenarios
from mjsheaf.scenario.load import read_scenario
from mjsheaf.scenario.scenario import Swarm
from mjsheaf.studies.plan import StudyFile
from mjsheaf.vehicles.loading import list_vehicles
from mjsheaf.vehicles.vehicle import VehicleDescription

EXPLAINING = Path(__file__).resolve().parents[1] / "reference"
"""Directory of files that have the fields which those that ship leave alone."""

UNIT = re.compile(r"\s*\[([^\[\]]+)\]$")
"""The unit at the end of a description; `-` where there is none."""

_UNBOUNDED = 1e9
_LONGEST_EXAMPLE = 90  # characters

Schema = Mapping[str, Any]
Examples = dict[tuple[str, str], str]


@dataclass
class Section:
    """A section of a file.

    Attributes:
        name: Name of its class.
        schema: JSON Schema of the section.
        paths: Paths in a file at which it may appear.
    """

    name: str
    schema: Schema
    paths: list[str] = field(default_factory=list)


def is_number(node: Schema) -> bool:
    """Return True if the value of a field is a number or a list of numbers."""
    if node.get("type") in ("number", "integer"):
        return True
    below = [*node.get("anyOf", []), *node.get("oneOf", []), *([node["items"]] if "items" in node else [])]
    below += [node["additionalProperties"]] if isinstance(node.get("additionalProperties"), Mapping) else []
    return any(is_number(n) for n in below)


def unit_of(node: Schema) -> str | None:
    """The unit that a field's description ends with; None where it names none."""
    found = UNIT.search(node.get("description", ""))
    return found[1] if found else None


def sections_of(model: type[BaseModel]) -> list[Section]:
    """All sections of a file, each after one that holds it."""
    schema = model.model_json_schema()
    sections = {model.__name__: Section(model.__name__, schema, [""])}
    queue = [model.__name__]
    while queue:
        name = queue.pop(0)
        here = sections[name]
        for key, node in here.schema.get("properties", {}).items():
            for suffix, below in references(node):
                path = f"{here.paths[0]}.{key}{suffix}".lstrip(".")
                if below not in sections:
                    sections[below] = Section(below, schema["$defs"][below])
                    queue.append(below)
                if path not in sections[below].paths:
                    sections[below].paths.append(path)
    return list(sections.values())


def references(node: Schema) -> Iterator[tuple[str, str]]:
    """The sections that a value may be, with what its path has after the field's name."""
    if "$ref" in node:
        yield "", node["$ref"].rsplit("/", 1)[1]
    for below in (*node.get("anyOf", []), *node.get("oneOf", [])):
        yield from references(below)
    if "items" in node:
        yield from ((f"[]{suffix}", name) for suffix, name in references(node["items"]))
    if isinstance(node.get("additionalProperties"), Mapping):
        yield from ((f".NAME{suffix}", name) for suffix, name in references(node["additionalProperties"]))


def type_of(node: Schema, anchor: str) -> str:
    """Describe the values that a field accepts."""
    if "$ref" in node:
        name = node["$ref"].rsplit("/", 1)[1]
        return f"[{name}](#{anchor}-{name.lower()})"
    if "anyOf" in node or "oneOf" in node:
        kinds = [type_of(n, anchor) for n in node.get("anyOf", node.get("oneOf", [])) if n.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    if "const" in node:
        return f"`{node['const']}`"
    if "enum" in node:
        return "one of " + ", ".join(f"`{value}`" for value in node["enum"])
    kind = node.get("type")
    if kind == "array":
        return _list(node, anchor)
    if kind == "object":
        below = node.get("additionalProperties")
        return f"names to {type_of(below, anchor)}" if isinstance(below, Mapping) else "names to values"
    words = {"number": "number", "integer": "whole number", "boolean": "true or false", "string": "text"}
    return words.get(kind, "any value") + _range(node)


def _list(node: Schema, anchor: str) -> str:
    low, high = node.get("minItems"), node.get("maxItems")
    count = f"{low} " if low is not None and low == high else f"{low} to {high} " if low and high else ""
    item = type_of(node["items"], anchor)
    if re.match(r"(whole )?number|text", item):
        item = re.sub(r"^((?:whole )?number)", r"\1s", item).replace("text", "texts", 1)
    more = f", at least {low}" if low and high is None and low > 1 else ""
    return f"list of {count}{item}{more}"


def _range(node: Schema) -> str:
    least, above = node.get("minimum"), node.get("exclusiveMinimum")
    most, below = node.get("maximum"), node.get("exclusiveMaximum")
    words = []
    if above is not None and above > -_UNBOUNDED:
        words.append(f"above {above:g}")
    if least is not None and least > -_UNBOUNDED:
        words.append(f"at least {least:g}")
    if most is not None and most < _UNBOUNDED:
        words.append(f"at most {most:g}")
    if below is not None and below < _UNBOUNDED:
        words.append(f"below {below:g}")
    if node.get("multipleOf") == 2:
        words.append("even")
    return (" " if words else "") + ", ".join(words)


def default_of(name: str, node: Schema, section: Schema) -> str:
    """Return the default of a field as text."""
    if name in section.get("required", []):
        return "**required**"
    value = node.get("default")
    if value is None or value in ("", [], {}) or isinstance(value, dict):
        return "optional"
    shown = str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else value
    return f"default `{shown}`"


def collect(examples: Examples, section: BaseModel) -> None:
    """Add what a section of a real file has to the examples of its fields, the first and short ones."""
    for name in section.model_fields_set:
        value = getattr(section, name)
        for below in (
            value if isinstance(value, list | tuple) else value.values() if isinstance(value, dict) else [value]
        ):
            if isinstance(below, BaseModel):
                collect(examples, below)
        dumped = section.model_dump(mode="json", exclude_unset=True, include={name})[name]
        if isinstance(dumped, list) and len(dumped) > 3 and isinstance(dumped[0], dict | list):
            dumped = dumped[:2]
        text = f"{name}: {_flow(dumped)}"
        for owner in type(section).__mro__:
            if owner is BaseModel:
                break
            known = examples.get((owner.__name__, name))
            if len(text) <= _LONGEST_EXAMPLE and known is None:
                examples[owner.__name__, name] = text


def _flow(value: Any) -> str:
    text = yaml.safe_dump(_as_written(value), default_flow_style=True, width=10_000, sort_keys=False)
    return text.removesuffix("\n").removesuffix("\n...")


def _as_written(value: Any) -> Any:
    """A value as somebody would write it: whole numbers without a point, edges without other fields as pairs."""
    if isinstance(value, dict):
        return value["between"] if set(value) == {"between"} else {k: _as_written(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_as_written(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e9 else value


def known_examples() -> Examples:
    """Examples of every field, out of the files that ship and one that has what these leave out."""
    found: Examples = {}
    for file in file_sections():
        collect(found, file)
    return found


def file_sections() -> list[BaseModel]:
    """The files that examples come from, as sections; those that were written to explain first."""
    sections: list[BaseModel] = []
    for path in sorted(EXPLAINING.glob("*.yaml")):
        raw = read_yaml(path)
        sections.append(_model_of(raw).model_validate(raw))
        sections += [Swarm.model_validate(raw["swarm"])] if "swarm" in raw else []  # a scenario has it written out
    for name in list_scenarios():
        sections.append(Scenario.model_validate(read_scenario(name)))
    sections += [VehicleDescription.model_validate(read_yaml(path)) for path in list_vehicles().values()]
    sections += [StudyFile.model_validate(read_yaml(path)) for path in list_studies().values()]
    return sections


def _model_of(raw: dict[str, Any]) -> type[BaseModel]:
    return VehicleDescription if "mjcf" in raw else StudyFile if "scenario" in raw else Scenario


def reference(model: type[BaseModel], anchor: str, examples: Examples) -> str:
    """Markdown of all sections of a file, each field with kind, range, unit, default, meaning and example."""
    return "\n".join(line for section in sections_of(model) for line in _section(section, anchor, examples))


def _section(section: Section, anchor: str, examples: Examples) -> Iterable[str]:
    yield f"({anchor}-{section.name.lower()})="
    yield f"## {section.name}\n"
    places = [f"`{path}`" for path in section.paths if path]
    if places:
        shown = ", ".join(places[:4]) + (", ..." if len(places) > 4 else "")
        yield f"At {shown}.\n"
    yield prose(section.schema.get("description", "")) + "\n"
    for name, node in section.schema.get("properties", {}).items():
        unit, kind = unit_of(node), type_of(node, anchor)
        facts = [kind, *([f"**{unit}**"] if unit and unit != "-" else []), default_of(name, node, section.schema)]
        meaning = UNIT.sub("", node.get("description", ""))
        yield f"`{name}`"
        yield f": {' · '.join(facts)}\n"
        if meaning:
            yield f"  {prose(meaning[:1].upper() + meaning[1:])}.\n"
        example = examples.get((section.name, name))
        if example:
            yield f"  Example: `{example}`\n"


def prose(text: str) -> str:
    """A docstring as Markdown: nothing in it is markup but code between backquotes."""
    return re.sub(r"(?<!`)([*_|<>])(?!`)", r"\\\1", text) if "`" not in text else text


def variables() -> str:
    """Return the table of all variables of result.nc, in Markdown."""
    lines = ["| Variable | Dimensions | Unit | Meaning |", "|---|---|---|---|"]
    for entry in dataset.VARIABLES:
        unit = entry.unit if isinstance(entry.unit, str) else "N or 1"
        meaning = entry.long_name.replace("|", r"\|") + (f" ({entry.present})" if entry.present else "")
        lines.append(f"| `{entry.name}` | {', '.join(entry.dimensions)} | {unit} | {meaning} |")
    return "\n".join(lines) + "\n"
