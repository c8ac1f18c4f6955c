"""Laws in Python by their files: FILE.py:NAME, recognised by a digest and loaded anew for every run."""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

from mjsheaf.control.controller import Controller, load_controller
from mjsheaf.errors import InputError
from mjsheaf.io.files import confined


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
        source = f"{self.path}:{self.name}"
        try:
            controller = load_controller(source, seed)
        except InputError as error:
            told = str(error).removeprefix(f"--controller {source}: ")
            raise InputError(f"{self.field} {self.label}: {told}") from None
        controller.name = self.label
        return controller

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
    try:
        path = Path(file) if directory is None else confined(file, directory)
    except InputError as error:
        raise InputError(f"{field} {source}: {error}") from None
    if not path.is_file():
        raise InputError(f"{field} {source}: there is no file {file}")
    return LawFile(str(path.resolve()), name, source, _digest(path), field)


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
