"""Files: written atomically, YAML of users, and their Python.

Files and directories are written completely or not at all. Each is written next to its destination, because a rename is
atomic only within one file system. Its temporary name is for example `.summary.json.3f0a90ab.part`, and it is locked
while its process lives. The kernel releases the lock when the process ends, for whatever reason. Files of a killed
process are therefore unlocked, and the next process removes them.

Paths in files are confined. A user may give any path on the command line or in Python. A file may come from anywhere,
so paths in it must lie in or below its own directory, after links are resolved.

Models, scenarios and studies are inside an installed package, or at the top of the repository.

YAML is 1.2 without surprises: values are read as they look, or refused in one line that names their place. Single
fields of a file can be edited in place, and every other byte of the file stays the same.
"""

import ctypes
import errno
import fcntl
import hashlib
import importlib.util
import json
import math
import os
import re
import shutil
import stat
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partialmethod
from io import BufferedReader
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml

from mjsheaf.errors import InputError, ScenarioError, shortened, visible

FIGURE_FORMATS = ("png", "svg", "pdf")
"""Formats of figures, as suffixes of their files."""

_RANDOM = "[a-z0-9_]{8}"  # all characters that any version uses
_AT_FDCWD, _RENAME_EXCHANGE = -100, 2  # constants of Linux: fcntl.h, linux/fs.h


@contextmanager
def naming(place: object, hint: str = "", kind: type[InputError] = InputError, verb: str = "written") -> Iterator[None]:
    """Turn an error of the file system into one that names the path and says what to do."""
    try:
        yield
    except OSError as error:
        raise kind(f"{place}: cannot be {verb}: {error.strerror or error}{hint and '; '}{hint}") from None


@contextmanager
def whole_file(path: Path, *, tidy: bool = True) -> Iterator[Path]:
    """Yield the path of a new, empty file that replaces `path` when the block ends without an exception.

    Args:
        path: Path of the file.
        tidy: True to first remove files of killed processes, which reads the whole directory.

    Raises:
        OSError: The file cannot be written. Nothing changes then.
    """
    with _part(path, directory=False, tidy=tidy) as part:
        yield part
        part.replace(path)


def write_whole(path: Path, content: bytes, *, tidy: bool = True) -> None:
    """Write a file atomically; see `whole_file`.

    Raises:
        OSError: The file cannot be written.
    """
    with whole_file(path, tidy=tidy) as part:
        part.write_bytes(content)


@contextmanager
def whole_directory(path: Path) -> Iterator[Path]:
    """Yield a new directory that replaces `path` when the block ends without an exception.

    An existing directory is exchanged with it atomically if the file system supports that.

    Raises:
        OSError: The directory cannot be created or renamed. The existing one stays then.
    """
    with _part(path, directory=True) as fresh:
        yield fresh
        if not path.exists() or not _exchange(fresh, path):
            old = fresh.with_suffix(".old")
            try:
                if path.exists():
                    path.rename(old)
                fresh.rename(path)
            finally:
                _restore(old, path)


def replace_file(path: Path, data: bytes, *, expected: bytes) -> None:
    """Replace a file's `expected` bytes with `data` atomically; its mode and links to it stay.

    Raises:
        InputError: The file has changed meanwhile, or cannot be written.
    """
    require_writable(path)
    real = path.resolve()
    with naming(path):
        if real.read_bytes() != expected:
            raise InputError(f"{path}: has changed meanwhile; nothing is written")
        with whole_file(real) as part:
            with part.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            part.chmod(real.stat().st_mode & 0o7777)


def figure_files(names: Iterable[str]) -> list[str]:
    """List all possible file names of figures, which are given without suffix."""
    return [f"{name}.{form}" for name in names for form in FIGURE_FORMATS]


def require_writable(path: Path) -> None:
    """Refuse a file that may not be written, or whose directory may not.

    Raises:
        InputError: The message names it.
    """
    real = path.resolve()
    for place in (real, real.parent):
        if not os.access(place, os.W_OK):
            raise InputError(f"{path}: cannot be written: {place} is read-only; copy the scenario and update the copy")


def remove_stale(path: Path) -> None:
    """Remove the remains that killed processes left next to a file or directory that they were writing."""
    pattern = re.compile(rf"\.{re.escape(path.name)}\.{_RANDOM}\.(part|old)")
    with suppress(OSError):
        for name in filter(pattern.fullmatch, os.listdir(path.parent)):
            part = path.parent / name
            with suppress(OSError), _locked(part, wait=False):
                if part.suffix == ".old":
                    _restore(part, path)
                else:
                    _remove(part)


def remove_empty(places: Iterable[Path]) -> None:
    """Remove those directories that are empty; the others stay."""
    for place in places:
        with suppress(OSError):
            place.rmdir()


def is_part_of(name: str, names: Iterable[str]) -> bool:
    """Return True if a name is the temporary name of one of these files."""
    return any(re.fullmatch(rf"\.{re.escape(of)}\.{_RANDOM}\.part", name) for of in names)


def _restore(old: Path, path: Path) -> None:
    """Move a directory back after a rename, unless its path exists again."""
    if old.exists() and not path.exists():
        old.rename(path)
    shutil.rmtree(old, ignore_errors=True)


@contextmanager
def _part(path: Path, *, directory: bool, tidy: bool = True) -> Iterator[Path]:
    """Yield a new file or directory next to a path, locked; remove it at the end if it still exists."""
    if tidy:
        remove_stale(path)
    while True:
        part = path.with_name(f".{path.name}.{os.urandom(4).hex()}.part")
        make = part.mkdir if directory else part.touch
        make(exist_ok=False)
        try:
            with _locked(part, wait=True):
                if not part.exists():  # another command removed it as stale before it was locked
                    continue
                yield part
                return
        finally:
            _remove(part)


@contextmanager
def _locked(path: Path, *, wait: bool) -> Iterator[None]:
    """Lock a file for the block; with `wait`, continue without a lock if the file system has none."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if not wait:
                raise
        yield
    finally:
        os.close(descriptor)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink(missing_ok=True)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two names atomically; return False if this system or file system cannot."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    if rename(_AT_FDCWD, os.fsencode(one), _AT_FDCWD, os.fsencode(other), _RENAME_EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.ENOENT):
        return False
    raise OSError(number, os.strerror(number), str(other))


def read_bytes(path: Path, largest: int) -> bytes:
    """Read a file of at most `largest` bytes.

    Raises:
        InputError: The file cannot be read, or is larger.
    """
    try:
        with path.open("rb") as file:
            data = file.read(largest + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(data) > largest:
        raise InputError(f"{path}: larger than {largest // 10**6} MB")
    return data


@contextmanager
def open_regular(path: str | Path) -> Iterator[BufferedReader]:
    """Open a file to read; what is no regular file, such as a pipe, is refused and not waited for.

    Raises:
        InputError: It does not exist, is no regular file, or cannot be read.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except FileNotFoundError:
        raise InputError(f"there is no file {path}") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise InputError(f"{path} is no regular file")
    with os.fdopen(descriptor, "rb") as file:
        yield file


def digest_of(path: str | Path) -> str:
    """Return the SHA-256 of a file's content, hexadecimal.

    Raises:
        InputError: It cannot be read; see `open_regular`.
    """
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest(path: Path) -> str:
    """Return the SHA-256 of a file as `digest_of`; empty if it cannot be read, such as a broken link."""
    try:
        return digest_of(path)
    except InputError:
        return ""


def confined(name: str, directory: Path, root: Path | None = None) -> Path:
    """Resolve a path in a file to an absolute path without links; the result need not exist.

    Args:
        name: Name as written; relative to `directory`, or absolute.
        directory: Directory of the file that contains the name.
        root: Directory that must contain the result; None takes `directory`.

    Raises:
        InputError: The path lies outside, or is not a valid path.
    """
    try:
        within, path = (root or directory).resolve(), (directory / name).resolve()
        path.exists()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, a name that is too long, a cycle of links
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{shortened(name, 100)!r} is no path: {reason}") from None
    if not path.is_relative_to(within):
        raise InputError(
            f"{shortened(name, 100)!r} lies outside {root or directory}; expected a file in that directory or below it"
        )
    return path


_PACKAGE = Path(__file__).resolve().parent
_INSTALLED = {"studies": "studies/shipped"}  # mjsheaf/studies is a package of its own


def resource_directory(name: str) -> Path:
    """Return the directory of the 'models', 'scenarios' or 'studies' that come with mjsheaf."""
    installed = _PACKAGE / _INSTALLED.get(name, name)
    return installed if installed.is_dir() else _PACKAGE.parent / name


def list_studies() -> dict[str, Path]:
    """List the study files that come with mjsheaf by name."""
    return {path.stem: path for path in sorted(resource_directory("studies").glob("*.yaml"))}


SUFFIXES = (".yaml", ".yml")
_DEEPEST = 50  # maximum depth of nested collections; a scenario has six
_SURROGATE = re.compile("[\\ud800-\\udfff]")  # "\ud800" in YAML; files in UTF-8 cannot contain it
_LONGEST_INTEGER = 3_000  # maximum number of digits; Python prints at most 4300 decimal digits


def _fault(problem: str, mark: yaml.Mark) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


class _Loader(yaml.SafeLoader):
    """YAML's safe loader, which executes nothing, with plain values read as in YAML 1.2.

    PyYAML implements YAML 1.1, where 010 is eight, 1:30 is ninety, `no` is false, and 1e-3 is text. This loader
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
            raise _fault(f"a number of {len(node.value)} digits; expected up to {_LONGEST_INTEGER}", node.start_mark)
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
    """Read a YAML file of up to 20 MB that holds a mapping.

    Raises:
        ScenarioError: The file is missing, too large, not text, not YAML, empty or not a mapping, or it contains tags,
            anchors or duplicate keys.
    """
    try:
        text = read_bytes(path, 20_000_000).decode("utf-8")
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


def dump_yaml(value: dict[str, Any], *, width: float = 120) -> str:
    """Write a mapping as YAML that has the same values in YAML 1.1 and 1.2, the innermost collections in braces."""
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=width)


def with_field(text: str, key: str, value: dict[str, Any], source: str, comment: str = "") -> str:
    """Replace one field in the text of a YAML mapping, or add it at the end, in lines of its own.

    Comments before and after the field stay; those inside its old value are removed with it.

    Args:
        text: Text of the file.
        source: Name of the file in errors.
        key: Key of a field at the top level.
        value: New value of the field.
        comment: Comment next to the key if the field is new.

    Raises:
        ScenarioError: The text is not valid YAML, or has a form that cannot be edited in place, such as JSON.
    """
    old, root = parse_yaml(text, source), parse_yaml(text, source, yaml.compose)
    if not isinstance(root, yaml.MappingNode) or not isinstance(old, dict):
        raise ScenarioError(f"{source}: expected a mapping of fields to values")
    newline = "\r\n" if "\r\n" in text else "\n"
    margin = " " * root.start_mark.column
    indent = margin + "  "
    node = next((node for name, node in root.value if name.value == key), None)
    if node is None:
        gap = "" if text.endswith(("\n", "\r")) else newline
        before = text + gap + margin + key + ":" + (f"  # {comment}" if comment else "")
        after = newline
    else:
        begin = node.start_mark.index
        before = text[:begin].rstrip()
        if isinstance(node, yaml.MappingNode) and not node.flow_style:
            indent = " " * node.start_mark.column
        after = text[begin + len(text[begin : _end(node)].rstrip()) :]
    lines = dump_yaml({**value, "_": {}}, width=math.inf).splitlines()[:-1]  # a mapping with a mapping is in lines
    edited = before + "".join(newline + indent + line for line in lines) + after
    with suppress(ScenarioError):
        if parse_yaml(edited, source) == {**old, key: value}:
            return edited
    raise ScenarioError(
        f"{source}: {key}: cannot be written into a file of this form, such as JSON, which has no lines of its own for "
        f"it; write {json.dumps({key: value})[1:-1]}"
    )


def _end(node: yaml.Node) -> int:
    """Return the end of a node's text; PyYAML's end mark of a block lies after the comments that follow it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(node, yaml.MappingNode) else last)
    return int(node.end_mark.index)


@contextmanager
def in_this_directory() -> Iterator[None]:
    """Restore the working directory at the end, because paths of results and files are relative to it."""
    place = _working_directory()
    try:
        yield
    finally:
        if place is not None and _working_directory() != place:
            with suppress(OSError):
                os.chdir(place)


def _working_directory() -> str | None:
    """Return the working directory; None if it no longer exists."""
    with suppress(OSError):
        return os.getcwd()
    return None


def describe(error: BaseException) -> str:
    """Describe an exception of the user's code and its location in one line; compiled code may not know the latter."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if not Path(frame.filename).is_relative_to(Path(__file__).parent)][-1:]
    place = "".join(f" ({visible(Path(frame.filename).name)}, line {frame.lineno})" for frame in own)
    try:
        text = str(error)
    except (Exception, SystemExit):
        text = "an exception that cannot be printed, because its __str__ raises another"
    return f"{visible(type(error).__name__)}: {visible(text, 300)}{place}"  # characters of its text at most


def execute_file(path: Path, prefix: str) -> ModuleType:
    """Execute a user's Python file as a module named after it, and return the module."""
    name = f"{prefix}_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # of a .py file
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses and pickle look a class's module up
    with in_this_directory():
        spec.loader.exec_module(module)
    return module
