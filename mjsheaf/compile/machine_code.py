"""Machine code on disk: files named by the sources that they were compiled from, and checked as they are read.

numba caches machine code next to the source. It notices when that source changes, but not when a compiled function
that it calls in another file changes. So the name of each file has a hash of the function's source and of all sources
that it imports, directly or indirectly: an edit recompiles only its callers, and two versions of the package have files
side by side. Sources are read as they are imported. A process that runs while its sources change neither reads nor
writes machine code of what it imports from then on, because it cannot know which text it has in memory.

Files that are damaged, by a full disk, a power cut or a bad block, count as missing. Each begins with a hash of the
rest.

A function is compiled for given types in one process at a time: the others wait, and load the code that it has saved.
Workers of a study, or two commands in two terminals, would otherwise compile the same functions side by side. For other
types they do: each has code of its own. The operating system releases a lock when its process ends.
"""

import ast
import hashlib
import logging
import pickle
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

import llvmlite
import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.compiler_lock import global_compiler_lock

_logger = logging.getLogger("mjsheaf")
_BEGUN = time.time()
_HASH = 16  # bytes of a hash
_KEPT = 30 * 86400.0  # age at which files of other versions are removed, s
_PACKAGE = Path(__file__).resolve().parents[1]
SOURCES = (
    "compile/jit.py",
    "noise.py",
    "vectors.py",
    "team/links.py",
    "sheaf/*.py",
    "media/*.py",
    "law/*.py",
    "vehicles/*.py",
    "loop/*.py",
    "checking/theorem/*.py",
)
"""Files of the package whose text decides on machine code."""

_IMPORT = re.compile(r"^\s*from (mjsheaf[\w.]*) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
_COMMENT = re.compile(r"#.*")
_NAME = re.compile(r"(\w+)(?: as \w+)?")


class StoredCode(FunctionCache):
    """The machine code of a function on disk.

    Raises:
        RuntimeError: There is no directory that can be written.
    """

    _impl_class: Any = CompileResultCacheImpl
    _warned = False

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        base, own = self._impl.filename_base, source_hash(Path(function.__code__.co_filename).resolve())
        self._cache_file = _Files(self._cache_path, f"{base}.{own}", "")
        self._others = f"{base}.*.nb[ci]", f"{base}.{own}."
        if own == _CHANGED:
            self.disable()

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return the machine code for a signature, or None where there is none that can be used."""
        try:
            return super().load_overload(signature, target_context)
        except Exception:  # of whatever it is that code of other libraries cannot be rebuilt from
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        """Write the machine code for a signature; where that fails, warn once that each process compiles anew."""
        try:
            super().save_overload(signature, data)
            pattern, own = self._others
            for path in Path(self._cache_path).glob(pattern):
                if not path.name.startswith(own) and time.time() - path.stat().st_mtime > _KEPT:
                    path.unlink(missing_ok=True)
        except OSError as error:
            if not StoredCode._warned:
                StoredCode._warned = True
                why = error.strerror or error
                _logger.warning("%s: machine code cannot be kept, and is compiled again: %s", self._cache_path, why)


class _Files(IndexDataCacheFile):
    """The index of a function's machine code by signature, and the machine code, each behind its hash."""

    def _load_index(self) -> dict[Any, str]:
        return self._read(self._index_path) or {}

    def _save_index(self, names: dict[Any, str]) -> None:
        self._write(self._index_path, names)

    def _load_data(self, name: str) -> Any:
        return self._read(self._data_path(name))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _read(self, path: str) -> Any:
        """Return what a file holds; None if there is none or it is damaged."""
        try:
            content = Path(path).read_bytes()
            return pickle.loads(content[_HASH:]) if _hash(content[_HASH:]) == content[:_HASH] else None
        except Exception:  # there is none, it cannot be read, or it has what this numba does not know
            return None

    def _write(self, path: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(path) as file:
            file.write(_hash(content) + content)


def _hash(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_HASH).digest()


_CHANGED = "changed"


@cache
def _text_of(path: Path) -> str | None:
    """Return the text of a source; None if it changed after this process began, or is no file."""
    try:
        return None if path.stat().st_ctime > _BEGUN else path.read_text(encoding="utf-8")
    except OSError:
        return None


@cache
def _imports_of(path: Path) -> frozenset[Path]:
    """Return the files of the package from which a file imports names, looking through the faces of packages.

    The text is searched: parsing some sixty files would take a third of a second at each start.
    """
    found = set()
    for module, several, one in _IMPORT.findall(_COMMENT.sub("", _text_of(path) or "")):
        found |= {_origin_of(module, name) for name in _NAME.findall(several or one)}
    return frozenset(found)


@cache
def _origin_of(module: str, name: str) -> Path:
    """Return the file in which a name that is imported from a module of the package is defined."""
    base = _PACKAGE.joinpath(*module.split(".")[1:])
    if not base.is_dir():
        return base.with_suffix(".py")
    if (base / f"{name}.py").exists():
        return base / f"{name}.py"
    face = base / "__init__.py"
    for node in ast.walk(ast.parse(face.read_bytes())):
        if isinstance(node, ast.ImportFrom) and any((alias.asname or alias.name) == name for alias in node.names):
            return _origin_of(str(node.module), name)
    return face


@cache
def source_hash(path: Path) -> str:
    """Return a hash of a file, of all files of the package that its compiled functions may call, and of the compiler.

    It is 'changed' if one of them changed after this process began, or is no file.
    """
    reached, pending = set(), {path, _PACKAGE / "compile/jit.py"}
    while pending:
        file = pending.pop()
        reached.add(file)
        pending |= _imports_of(file) - reached
    digest = hashlib.blake2b(f"{numba.__version__} {llvmlite.__version__}".encode(), digest_size=8)
    for file in sorted(reached):
        inside = file.is_relative_to(_PACKAGE)
        if file == path or (inside and any(file.relative_to(_PACKAGE).match(pattern) for pattern in SOURCES)):
            text = _text_of(file)
            if text is None:
                return _CHANGED
            digest.update(text.encode())
    return digest.hexdigest()


_waits: list[str] = []  # functions and types that this process waits for


def is_waiting() -> bool:
    """Return True while this process waits for code that another one compiles."""
    return bool(_waits)


def keep_code(dispatcher: Any, cache: Any, kind: str = "") -> None:
    """Keep a function's machine code on disk, and let other processes wait while one compiles it for the same types."""
    dispatcher._cache = cache
    compile_here, function = dispatcher.compile, dispatcher.py_func
    name = f"{function.__module__}.{function.__qualname__}{kind and f', {kind}'}"

    def compile_or_load(signature: Any) -> Any:
        # numba's own lock comes first: a thread that holds it must not wait for a thread that needs it.
        with global_compiler_lock, _locked(cache.cache_path, f"{name} {signature}"):
            return compile_here(signature)

    dispatcher.compile = compile_or_load
    # Code for all types is in one index, which numba reads, and writes again with one file more.
    cache.save_overload = _locked(cache.cache_path, name)(cache.save_overload)


@contextmanager
def _locked(directory: str, name: str) -> Iterator[None]:
    """Hold the lock of a name; where there are no locks, as on some network drives, hold none."""
    from filelock import FileLock, Timeout

    file = Path(directory) / "locks" / f"{crc32(name.encode()):08x}"
    # One object a file: a function that is compiled within itself has its lock already.
    lock = FileLock(file, is_singleton=True)
    with ExitStack() as held:
        with suppress(OSError, NotImplementedError):
            file.parent.mkdir(parents=True, exist_ok=True)
            try:
                held.enter_context(lock.acquire(blocking=False))
            except Timeout:
                _waits.append(name)
                try:
                    held.enter_context(lock.acquire())
                finally:
                    _waits.remove(name)
        yield
