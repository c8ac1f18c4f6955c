"""Laws in Python by their files: FILE.py:NAME, recognised by a digest and loaded anew for every run."""

import hashlib
import inspect
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mjsheaf.errors import InputError, expected, visible
from mjsheaf.io.files import confined
from mjsheaf.io.user_code import describe, execute_file, in_this_directory
from mjsheaf.law.in_python import Controller


@dataclass(frozen=True)
class LawFile:
    """A law in a Python file.

    Attributes:
        path: Absolute path of the file.
        name: Name of the function, object or class in it.
        label: Name in outputs: FILE.py:NAME as the user gave it.
        digest: SHA-256 of the file, hexadecimal.
        field: Field or option that named it, for messages.
    """

    path: str
    name: str
    label: str
    digest: str
    field: str = "--controller"

    def load(self, seed: int) -> Controller:
        """Execute the file and construct the law, so that no run sees the state of another.

        Raises:
            InputError: The file has changed, raises an exception or has no such name.
        """
        if self.changed:
            raise InputError(f"{self.field} {self.label}: the file has changed since the command began; start it again")
        try:
            return Controller(_execute(Path(self.path), self.name), self.label, seed)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            message = str(error) if isinstance(error, InputError) else describe(error)
            raise InputError(f"{self.field} {self.label}: {message}") from error

    @property
    def changed(self) -> bool:
        """True if the file is no longer the one that was found."""
        return _digest(Path(self.path)) != self.digest

    @property
    def here(self) -> str:
        """FILE.py:NAME with a path from the working directory."""
        return f"{os.path.relpath(self.path)}:{self.name}"

    def key(self) -> dict[str, str]:
        """Return what distinguishes the law from others: its file's name, its own name and the file's digest."""
        return {"file": Path(self.path).name, "name": self.name, "sha256": self.digest}


def find_law(source: str, field: str = "--controller", directory: Path | None = None) -> LawFile:
    """Find the law FILE.py:NAME.

    Args:
        source: Text that a user wrote.
        field: Field or option that has it, for messages.
        directory: Directory to which FILE is relative and in which it must lie; None takes the working directory, and
            any place.

    Raises:
        InputError: It is not of that form, or there is no such file.
    """
    file, colon, name = source.rpartition(":")
    if not colon or not name.isidentifier() or Path(file).suffix != ".py":
        raise InputError(f"{field} {source!r}: expected FILE.py:NAME, for example mylaw.py:MyLaw")
    source = source if source.isprintable() else visible(source)
    try:
        path = Path(file) if directory is None else confined(file, directory)
    except InputError as error:
        raise InputError(f"{field} {source}: {error}") from None
    if not path.is_file():
        raise InputError(f"{field} {source}: there is no file {file}")
    return LawFile(str(path.resolve()), name, source, _digest(path), field)


def load_controller(source: str, seed: int = 0) -> Controller:
    """Load the law FILE.py:NAME: a function, an object or a class that is made without arguments.

    Raises:
        InputError: There is no such file or name, or the file raises an exception.
    """
    if not isinstance(source, str):
        raise InputError(f"controller: expected FILE.py:NAME as a str, not {type(source).__name__}")
    return find_law(source).load(seed)


def _execute(path: Path, name: str) -> Any:
    """Execute a file and return the law of this name in it, an object of it where that is a class.

    Raises:
        InputError: There is none. Exceptions of the file pass through.
    """
    module = execute_file(path, "mjsheaf_controller")
    with in_this_directory():
        if not hasattr(module, name):
            public = [n for n, value in vars(module).items() if callable(value) and not n.startswith("_")]
            raise InputError(f"there is no {name!r} in it; {expected(name, public)}")
        law = getattr(module, name)
        return law() if inspect.isclass(law) else law


def name_law_from(law: LawFile, directory: Path) -> str:
    """Return FILE.py:NAME with a path from a directory, as a file there names the law.

    Raises:
        InputError: The law's file lies elsewhere.
    """
    home = directory.resolve()
    if not Path(law.path).is_relative_to(home):
        raise InputError(
            f"{law.field} {law.label}: lies outside {home}; a file there can only name a law in or below it"
        )
    return f"{Path(law.path).relative_to(home).as_posix()}:{law.name}"


def same_law(one: str, other: str | None) -> bool:
    """Return True if two laws, FILE.py:NAME, have the same name in files of the same name, wherever these are."""
    if other is None:
        return False
    (file, _, name), (own_file, _, own_name) = one.rpartition(":"), other.rpartition(":")
    return name == own_name and Path(file).name == Path(own_file).name


def _digest(path: Path) -> str:
    """Compute the SHA-256 of a file; empty if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
