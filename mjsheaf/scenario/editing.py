"""Writing one field of a scenario file in its place; every other byte of the file stays as it is."""

import json
import math
import os
from pathlib import Path
from typing import Any

import yaml

from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.io.files import whole_file
from mjsheaf.io.yaml import compose_yaml, dump_yaml, parse_yaml


def with_field(text: str, key: str, value: dict[str, Any], source: str, comment: str = "") -> str:
    """A YAML mapping with one of its fields replaced, or added at its end.

    Comments before and after the field stay; those inside its old value go with that. The field is written as the
    file is: in lines where it stands in lines, in braces where the file or the field does.

    Args:
        text: of the file.
        key: of a field at the top.
        value: its new value.
        source: what errors call the file.
        comment: stands beside the key where the field is new.

    Raises:
        ScenarioError: the text is not valid YAML, or of a form that cannot be edited in its place.
    """
    old = parse_yaml(text, source)
    root = compose_yaml(text, source)
    if not isinstance(root, yaml.MappingNode) or not isinstance(old, dict):
        raise ScenarioError(f"{source}: expected a mapping of fields to values")
    newline = "\r\n" if "\r\n" in text else "\n"
    nodes = {name.value: node for name, node in root.value}
    if key in nodes:
        node = nodes[key]
        begin = node.start_mark.index
        end = begin + len(text[begin : _end(node)].rstrip())
        braces = root.flow_style or not isinstance(node, yaml.MappingNode) or node.flow_style
        new = _braces(value, root) if braces else _lines(value, node.start_mark.column, newline)
        gap = " " if begin == end else ""  # the value was nothing at all
        edited = text[:begin] + gap + new + text[end:]
    elif root.flow_style:
        at = _end(root.value[-1][1]) if root.value else root.start_mark.index + 1
        edited = f"{text[:at]}{', ' * bool(root.value)}{json.dumps(key)}: {_braces(value, root)}{text[at:]}"
    else:
        column = root.start_mark.column
        head = " " * column + key + ":" + (f"  # {comment}" if comment else "")
        body = " " * (column + 2) + _lines(value, column + 2, newline)
        gap = "" if text.endswith(("\n", "\r")) else newline
        edited = text + gap + newline.join((head, body, ""))
    try:
        done = parse_yaml(edited, source) == {**old, key: value}
    except ScenarioError:
        done = False
    if not done:
        raise ScenarioError(f"{source}: {key}: cannot be written in its place; write {key}: {_braces(value, root)}")
    return edited


def replace_file(path: Path, data: bytes, *, expected: bytes) -> None:
    """Put new bytes in the place of a file's, whole or not at all; its mode stays, a link to it stays a link.

    Args:
        path: of the file.
        data: what it shall hold.
        expected: what it should still hold.

    Raises:
        InputError: the file has changed meanwhile, or cannot be written.
    """
    real = path.resolve()
    require_writable(path)
    try:
        if real.read_bytes() != expected:
            raise InputError(f"{path}: has changed meanwhile; nothing is written")
        with whole_file(real) as part:
            with part.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            part.chmod(real.stat().st_mode & 0o7777)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def require_writable(path: Path) -> None:
    """Refuse a file that may not be written, or whose directory may not.

    Raises:
        InputError: naming it.
    """
    real = path.resolve()
    for place in (real, real.parent):
        if not os.access(place, os.W_OK):
            raise InputError(f"{path}: cannot be written: {place} is read-only; copy the scenario and update the copy")


def _end(node: yaml.Node) -> int:
    """Where the text of a node ends; PyYAML's own mark of a block lies after the comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(node, yaml.MappingNode) else last)
    return int(node.end_mark.index)


def _lines(value: dict[str, Any], column: int, newline: str) -> str:
    """A mapping in lines, of which all but the first are indented; mappings inside it are in braces."""
    lines = [dump_yaml({k: v}, flow=None if isinstance(v, dict) else False, width=math.inf) for k, v in value.items()]
    return (newline + " " * column).join(line.rstrip("\n") for line in lines)


def _braces(value: dict[str, Any], root: yaml.Node) -> str:
    """A mapping in braces; in a file that is in braces itself, and perhaps JSON, as JSON."""
    if isinstance(root, yaml.MappingNode) and root.flow_style:
        return json.dumps(value)
    return dump_yaml(value, flow=True, width=math.inf).strip()
