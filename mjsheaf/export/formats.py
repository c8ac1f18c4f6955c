"""Formats of exported runs and their files, of a finished run or during one."""

from collections.abc import Sequence
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mjsheaf.errors import InputError
from mjsheaf.io.files import naming, whole_directory, whole_file
from mjsheaf.results.netcdf import length_of_piece, split
from mjsheaf.results.sinks import send
from mjsheaf.results.store import BAG, reopen_run, strange_in_bag

if TYPE_CHECKING:
    from mjsheaf.results.sinks import Sink
    from mjsheaf.scenario import Scenario
    from mjsheaf.system import Phase


class Format(NamedTuple):
    """A format of exported runs.

    Attributes:
        name: Name in a run's directory.
        module: Module of mjsheaf that has its sink.
        sink: Name of the sink's class.
        directory: True if it is a directory.
        suffix: Suffix that a file's name must have.
    """

    name: str
    module: str
    sink: str
    directory: bool
    suffix: str


FORMATS = {
    "mcap": Format("run.mcap", "mjsheaf.export.mcap", "Mcap", False, ".mcap"),
    "ros2": Format(BAG, "mjsheaf.export.ros2", "Ros2Bag", True, ""),
}
"""Formats by name."""


def make_sink(format_name: str, path: Path, scenario: "Scenario", phases: "Sequence[Phase]", source: Path) -> "Sink":
    """Return the sink that writes a run to `path`; `source` is the scenario's file, which it includes.

    Raises:
        InputError: The packages of the extra `mcap` are not installed.
    """
    kind = FORMATS[format_name]
    sink: Sink = getattr(_load(format_name), kind.sink)(path, scenario, phases, source)
    return sink


def require_installed(formats: Sequence[str]) -> None:
    """Refuse formats whose packages are not installed.

    Raises:
        InputError: The message names the extra.
    """
    for name in formats:
        _load(name)


def _load(format_name: str) -> Any:
    try:
        return import_module(FORMATS[format_name].module)
    except ImportError as error:
        raise InputError(
            f"--{format_name} needs packages that are not installed ({error.name}): pip install 'mjsheaf[mcap]'"
        ) from None


def sinks_of(formats: Sequence[str], directory: Path, scenario: "Scenario", phases: "Sequence[Phase]") -> "list[Sink]":
    """Return the sinks that write a run's exports into its directory, which has scenario.yaml."""
    source = directory / "scenario.yaml"
    return [make_sink(name, directory / FORMATS[name].name, scenario, phases, source) for name in formats]


def export_run(directory: Path, format_name: str, out: Path | None = None) -> Path:
    """Export a finished run, and return the path of the file or directory.

    Args:
        directory: Directory of the run.
        format_name: A key of `FORMATS`.
        out: Path to write; None for the format's name in the run's directory.

    Raises:
        InputError: The directory holds no run, a package is missing, or nothing can be written there.
    """
    kind = FORMATS[format_name]
    path = directory / kind.name if out is None else out
    require_installed([format_name])
    with reopen_run(directory) as (scenario, dataset, _), ExitStack() as stack, naming(path):
        if kind.directory:
            _require_replaceable(path)
            part = stack.enter_context(whole_directory(path))
        else:
            part = stack.enter_context(whole_file(path))
        sink = make_sink(format_name, part, scenario, scenario.phases, directory / "scenario.yaml")
        pieces = split(dataset, length_of_piece(dataset))
        send((piece.load() for piece in pieces), sink)
    return path


def _require_replaceable(path: Path) -> None:
    """Refuse the path of a bag that holds anything else.

    Raises:
        InputError: The message names it.
    """
    strange = strange_in_bag(path)
    if strange:
        raise InputError(f"{path}: holds {strange[0]!r}, which mjsheaf did not write; choose another with --out")
