"""YAML 1.2 without surprises: values are read as they look, or refused in one line that names their place.

Single fields of a file can be edited in place, and every other byte of the file stays the same.
"""

import json
import math
import re
from collections.abc import Callable
from contextlib import suppress
from functools import partialmethod
from pathlib import Path
from typing import Any

import yaml

from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.io.files import read_bytes

SUFFIXES = (".yaml", ".yml")
_LARGEST_FILE = 20_000_000  # bytes
_DEEPEST = 50  # maximum depth of nested collections; a scenario has six
_SURROGATE = re.compile("[\\ud800-\\udfff]")  # "\ud800" in YAML; files in UTF-8 cannot contain it
_LONGEST_INTEGER = 3_000  # maximum number of digits; Python prints at most 4300 decimal digits


def _fault(problem: str, mark: yaml.Mark) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


class _Loader(yaml.SafeLoader):
    """YAML's safe loader, which executes nothing, with plain values read as in YAML 1.2.

    PyYAML implements YAML 1.1, in which 010 is eight, 1:30 is ninety, `no` is false, and 1e-3 is text. This loader
    refuses duplicate keys, tags, anchors and aliases (which let a short file expand without limit), and deep nesting.
    """

    _depth = 0

    def _refuse(self, what: str) -> None:
        raise _fault(f"{what} is not allowed; write the value out", self.get_mark())

    fetch_tag = partialmethod(_refuse, "a tag")
    fetch_anchor = partialmethod(_refuse, "an anchor")
    fetch_alias = partialmethod(_refuse, "an alias")

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self._depth > _DEEPEST:
            raise _fault(f"nested more than {_DEEPEST} deep", self.peek_event().start_mark)
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
                raise _fault(f"key {key!r} is not text", key_node.start_mark)
            if key in seen:
                raise _fault(f"key {key!r} is given twice", key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> Any:
        value = super().construct_scalar(node)
        if isinstance(value, str) and not value.isascii() and _SURROGATE.search(value):
            raise _fault("half of a surrogate pair, which is not text; write the character itself", node.start_mark)
        return value

    def construct_integer(self, node: yaml.ScalarNode) -> int:
        """Read an integer of YAML 1.2; in YAML 1.1, a leading 0 would mean octal."""
        if len(node.value) > _LONGEST_INTEGER:
            digits = len(node.value)
            raise _fault(f"a number of {digits} digits; expected up to {_LONGEST_INTEGER}", node.start_mark)
        return int(node.value, {"0o": 8, "0x": 16}.get(node.value[:2], 10))


class _Dumper(yaml.SafeDumper):
    """YAML's safe dumper, which quotes text that YAML 1.1 or 1.2 would read as another type."""


# The core schema of YAML 1.2.2, section 10.3.2: kind, pattern, and possible first characters.
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
        ScenarioError: The file is missing, too large, not text, not YAML, empty or not a mapping, or it contains tags,
            anchors or duplicate keys.
    """
    try:
        text = read_bytes(path, _LARGEST_FILE).decode("utf-8")
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: not a text file in UTF-8") from None
    except InputError as error:
        raise ScenarioError(str(error)) from None
    raw = parse_yaml(text, str(path))
    if not isinstance(raw, dict):
        holds = "empty" if raw is None else f"holds a {type(raw).__name__}"
        raise ScenarioError(f"{path}: {holds}; expected a mapping of fields to values")
    return raw


def parse_yaml(text: str, source: str, read: Callable[..., Any] = yaml.load) -> Any:
    """Parse YAML text into values or, with `yaml.compose`, into nodes; errors name the source and the line."""
    try:
        return read(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "not YAML"
        raise ScenarioError(f"{source}: {where}{' '.join(str(problem).split())}") from None


def dump_yaml(value: dict[str, Any], *, flow: bool | None = None, width: float = 120) -> str:
    """Write a mapping as YAML that has the same values in YAML 1.1 and 1.2.

    `flow` puts the whole mapping in braces; None puts only the innermost collections in braces.
    """
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, default_flow_style=flow, width=width)


def with_field(text: str, key: str, value: dict[str, Any], source: str, comment: str = "") -> str:
    """Replace one field in the text of a YAML mapping, or add it at the end.

    Comments before and after the field stay; those inside its old value are removed with it. The field follows the
    style of the file: in lines if the file uses lines, in braces if the file or the field does.

    Args:
        text: Text of the file.
        source: Name of the file in errors.
        key: Key of a field at the top level.
        value: New value of the field.
        comment: Comment next to the key if the field is new.

    Raises:
        ScenarioError: The text is not valid YAML, or has a form that cannot be edited in place.
    """
    old, root = parse_yaml(text, source), parse_yaml(text, source, yaml.compose)
    if not isinstance(root, yaml.MappingNode) or not isinstance(old, dict):
        raise ScenarioError(f"{source}: expected a mapping of fields to values")
    newline = "\r\n" if "\r\n" in text else "\n"
    nodes = {name.value: node for name, node in root.value}
    if key in nodes:
        edited = _with_value(text, root, nodes[key], value, newline)
    elif root.flow_style:
        edited = _with_field_in_braces(text, root, key, value)
    else:
        column = root.start_mark.column
        head = " " * column + key + ":" + (f"  # {comment}" if comment else "")
        body = " " * (column + 2) + _lines(value, column + 2, newline)
        gap = "" if text.endswith(("\n", "\r")) else newline
        edited = text + gap + newline.join((head, body, ""))
    with suppress(ScenarioError):
        if parse_yaml(edited, source) == {**old, key: value}:
            return edited
    raise ScenarioError(f"{source}: {key}: cannot be written in its place; write {key}: {_braces(value, root)}")


def _with_value(text: str, root: yaml.MappingNode, node: yaml.Node, value: dict[str, Any], newline: str) -> str:
    """Replace the value of a field, which stands at `node`, in the text of a mapping."""
    begin = node.start_mark.index
    end = begin + len(text[begin : _end(node)].rstrip())
    braces = root.flow_style or not isinstance(node, yaml.MappingNode) or node.flow_style
    new = _braces(value, root) if braces else _lines(value, node.start_mark.column, newline)
    gap = " " if begin == end else ""  # the value was empty
    return text[:begin] + gap + new + text[end:]


def _with_field_in_braces(text: str, root: yaml.MappingNode, key: str, value: dict[str, Any]) -> str:
    """Add a field to the text of a mapping in braces."""
    at = _end(root.value[-1][1]) if root.value else root.start_mark.index + 1
    comma = ", " if root.value else ""
    return f"{text[:at]}{comma}{json.dumps(key)}: {_braces(value, root)}{text[at:]}"


def _end(node: yaml.Node) -> int:
    """Return the end of a node's text; PyYAML's end mark of a block lies after the comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(node, yaml.MappingNode) else last)
    return int(node.end_mark.index)


def _lines(value: dict[str, Any], column: int, newline: str) -> str:
    """Write a mapping in lines, all except the first one indented.

    Mappings inside it are in braces, except those with a list of mappings, which get one line per entry.
    """

    def dump(item: dict[str, Any], flow: bool) -> str:
        return dump_yaml(item, flow=flow, width=math.inf).rstrip("\n")

    lines = []
    for k, v in value.items():
        if not isinstance(v, dict):
            lines.append(dump({k: v}, False))
        elif not any(_of_mappings(item) for item in v.values()):
            lines.append(f"{k}: {dump(v, True)}")
        else:
            lines.append(f"{k}:")
            for name, item in v.items():
                if _of_mappings(item):
                    lines += [f"  {name}:", *(f"    - {dump(each, True)}" for each in item)]
                else:
                    lines.append(f"  {dump({name: item}, False)}")
    return (newline + " " * column).join(lines)


def _of_mappings(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(item, dict) for item in value)


def _braces(value: dict[str, Any], root: yaml.Node) -> str:
    """Write a mapping in braces; as JSON if the whole file is in braces, because it may be JSON."""
    if isinstance(root, yaml.MappingNode) and root.flow_style:
        return json.dumps(value)
    return dump_yaml(value, flow=True, width=math.inf).strip()
