"""The files that a vehicle is made of, none of which may lie outside its description's directory.

A description names an MJCF file, which may include others and name meshes, textures and height fields. They are looked
through before MuJoCo or PyMJCF open any of them. MuJoCo loads no code by MJCF, but a plugin that it has already loaded
may do anything: plugins are refused. So is what MuJoCo would not survive: copies of copies without end, pictures larger
than any memory, and numbers that are none, with which it goes on after a warning.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

from mjsheaf.confining import confined
from mjsheaf.errors import InputError

_LARGEST_FILE = 20_000_000  # bytes, of one XML file
_DEEPEST = 100  # elements within one another
_MOST_COPIES = 1000  # that one element asks for, by elements within one another
_LARGEST_GRID = 4096**2  # pixels of a texture, points of a height field
_LARGEST_NUMBER = 1e12
_COPYING = ("replicate", "composite", "flexcomp")
_GRIDS = {"texture": ("width", "height"), "hfield": ("nrow", "ncol")}
_WORDS = ("name", "class", "childclass")  # attributes that are words, whatever they look like
_DIRECTORIES = ("meshdir", "texturedir", "assetdir")
_IN_MESHDIR = ("mesh", "hfield", "skin")


class _Reference(NamedTuple):
    """A file that an element of an MJCF file names."""

    tag: str
    name: str
    within: Path  # the directory of the file in which it stands


class _Names(NamedTuple):
    """What the elements of an MJCF file and of those that it includes name."""

    references: list[_Reference]
    directories: dict[str, set[str]]


def files_of(description: Path, mjcf: str) -> list[Path]:
    """The files of a vehicle.

    Args:
        description: its description's file.
        mjcf: what that says of the MJCF file, relative to its directory.

    Returns:
        The MJCF file first, then all that exist of those that it leads to; absolute, links resolved.

    Raises:
        InputError: one lies outside the directory of the description, an MJCF file is none, or has a plugin.
    """
    root = description.parent.resolve()
    try:
        main = confined(mjcf, root)
    except InputError as error:
        raise InputError(f"{description}: mjcf: {error}") from None
    names = _Names([], {name: set() for name in _DIRECTORIES})
    files, waiting = {main: None}, [main]
    while waiting:
        path = waiting.pop()
        first = len(names.references)
        _read(path, names)
        for reference in names.references[first:]:
            if reference.tag in ("include", "model"):
                inner = [f for f in _places(reference, main, names, root) if f not in files]
                files |= dict.fromkeys(inner)
                waiting += inner
    for reference in names.references:  # the directories of meshes are known when every file is read
        files |= dict.fromkeys(_places(reference, main, names, root))
    return list(files)


def _places(reference: _Reference, main: Path, names: _Names, root: Path) -> list[Path]:
    """Every file that MuJoCo or PyMJCF may take a reference for, where it exists.

    Raises:
        InputError: one is outside the root, or is no file.
    """
    tag, name, within = reference
    own = "texturedir" if tag == "texture" else "meshdir"
    directories = names.directories[own] | names.directories["assetdir"] or {""}
    if tag not in ("texture", *_IN_MESHDIR):
        directories = directories | {""}
    found = []
    for base in sorted({main.parent, within}):
        for directory in sorted(directories):
            for file in sorted({name, Path(name).name}):  # the latter by <compiler strippath="true"/>
                try:
                    path = confined(file, base / directory, root)
                except InputError as error:
                    raise InputError(f"{main}: <{tag}>: {error}") from None
                if path.is_file():
                    found.append(path)
                elif path.exists() and not path.is_dir():
                    raise InputError(f"{main}: <{tag}>: {name!r} is no regular file")
    return found


def _read(path: Path, names: _Names) -> None:
    """Note what the elements of one MJCF file name.

    Raises:
        InputError: it cannot be read, is not MJCF, declares a document type, or has a plugin.
    """
    parser = expat.ParserCreate("utf-8")
    depth, copies = 0, [1.0]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        numbers = {key: _numbers(value) for key, value in attributes.items() if key not in _WORDS}
        for key, found in numbers.items():
            if not all(abs(x) <= _LARGEST_NUMBER for x in found):
                where = f"{path}: line {parser.CurrentLineNumber}: <{tag}>: {key}"
                raise InputError(f"{where} is {attributes[key][:50]}; expected numbers of at most {_LARGEST_NUMBER:g}")
        copies.append(copies[-1] * math.prod(numbers.get("count", [1.0]) if tag in _COPYING else [1.0]))
        if copies[-1] > _MOST_COPIES:
            what = f"{path}: line {parser.CurrentLineNumber}: <{tag}>"
            raise InputError(f"{what} asks for {copies[-1]:g} copies; expected at most {_MOST_COPIES}")
        size = math.prod(numbers.get(key, [1.0])[0] for key in _GRIDS.get(tag, ()) if numbers.get(key, [1.0]))
        if size > _LARGEST_GRID:
            what = f"{path}: line {parser.CurrentLineNumber}: <{tag}>"
            raise InputError(f"{what} has {size:g} points; expected at most {_LARGEST_GRID}")
        if depth == 0 and tag not in ("mujoco", "mujocoinclude"):
            raise InputError(f"{path}: its root is <{tag}>; expected <mujoco>")
        depth += 1
        if depth > _DEEPEST:
            raise InputError(f"{path}: line {parser.CurrentLineNumber}: nested more than {_DEEPEST} deep")
        if tag in ("extension", "plugin"):
            raise InputError(f"{path}: line {parser.CurrentLineNumber}: <{tag}> is not allowed: plugins are code")
        for key, value in attributes.items():
            if key.startswith("file"):
                names.references.append(_Reference(tag, value, path.parent))
            elif tag == "compiler" and key in _DIRECTORIES:
                names.directories[key].add(value)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        copies.pop()

    def doctype(*_: Any) -> None:
        raise InputError(f"{path}: a document type is not allowed; leave <!DOCTYPE out")

    parser.StartElementHandler, parser.EndElementHandler, parser.StartDoctypeDeclHandler = begin, end, doctype
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no regular file")
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST_FILE + 1)
        if len(data) > _LARGEST_FILE:
            raise InputError(f"{path}: larger than {_LARGEST_FILE // 10**6} MB")
        parser.Parse(data, True)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except expat.ExpatError as error:
        raise InputError(f"{path}: not XML: {error}") from None


def _numbers(value: str) -> list[float]:
    """The numbers of which an attribute is made, or none where one of its words is no number."""
    try:
        return [float(word) for word in value.split()]
    except ValueError:
        return []
