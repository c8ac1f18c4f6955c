"""Files and directories that are written atomically: completely or not at all.

Each is written next to its destination, because a rename is atomic only within one file system. Its temporary name is
for example `.summary.json.3f0a90ab.part`, and it is locked while its process lives. The kernel releases the lock when
the process ends, for whatever reason. Files of a killed process are therefore unlocked, and the next process removes
them.

Paths in files are confined. A user may give any path on the command line or in Python. A file may come from anywhere,
so paths in it must lie in or below its own directory, after links are resolved.

Models, scenarios and studies are inside an installed package, or at the top of the repository.
"""

import ctypes
import errno
import fcntl
import hashlib
import os
import re
import shutil
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from io import BufferedReader
from pathlib import Path

from mjsheaf.errors import InputError, shortened

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
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise InputError(f"{path} is no regular file")
        yield file


def digest_of(path: str | Path) -> str:
    """Return the SHA-256 of a file's content, hexadecimal.

    Raises:
        InputError: It cannot be read; see `open_regular`.
    """
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


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


_PACKAGE = Path(__file__).resolve().parents[1]
_INSTALLED = {"studies": "studies/shipped"}  # mjsheaf/studies is a package of its own


def resource_directory(name: str) -> Path:
    """Return the directory of the 'models', 'scenarios' or 'studies' that come with mjsheaf."""
    installed = _PACKAGE / _INSTALLED.get(name, name)
    return installed if installed.is_dir() else _PACKAGE.parent / name


def list_studies() -> dict[str, Path]:
    """List the study files that come with mjsheaf by name."""
    return {path.stem: path for path in sorted(resource_directory("studies").glob("*.yaml"))}
