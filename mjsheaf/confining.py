"""Paths that stand in files: they stay inside the directory of the file that names them.

A person who types a path, on the command line or in Python, may name any file. A file, which may come from anywhere,
may name only what lies beside or below it; links are followed before that is decided.
"""

from pathlib import Path

from mjsheaf.errors import InputError


def confined(name: str, directory: Path, root: Path | None = None) -> Path:
    """The file that a path in a file names.

    Args:
        name: as written; relative to `directory`, or absolute.
        directory: of the file in which it stands.
        root: the directory in which it must lie; None takes `directory`.

    Returns:
        Its absolute path, links resolved; it need not exist.

    Raises:
        InputError: it lies outside, or is no path.
    """
    root = directory if root is None else root
    try:
        within, path = root.resolve(), (directory / name).resolve()
        path.exists()
    except (OSError, ValueError, RuntimeError) as error:  # a NUL, a name too long, links in a circle
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{_short(name)} is no path: {reason}") from None
    if path != within and within not in path.parents:
        raise InputError(f"{_short(name)} lies outside {root}; expected a file in that directory or below it")
    return path


def _short(name: str) -> str:
    return repr(name if len(name) <= 100 else name[:97] + "...")
