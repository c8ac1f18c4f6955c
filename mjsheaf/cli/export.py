"""`mjsheaf export`: a finished run in formats of other tools."""

from pathlib import Path
from typing import Annotated

import typer

from mjsheaf.cli.options import McapOption, Ros2Option, formats_of, require_file_name
from mjsheaf.cli.run import require_outside_of_runs
from mjsheaf.cli.terminal import print_lines, progress_bars
from mjsheaf.errors import InputError


def export(
    directory: Annotated[Path, typer.Argument(metavar="DIR", help="Directory of a finished run.")],
    mcap: McapOption = False,
    ros2: Ros2Option = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="PATH",
            help="File to write with --mcap, directory to write with --ros2.",
            show_default="DIR/run.mcap, DIR/run_ros2",
        ),
    ] = None,
) -> None:
    """Export a finished run as a log that other tools read, without simulating.

    The log has the pose of every vehicle, the scene with edges coloured by residual, desired positions and flow, errors
    and commands, events as messages, and the scenario. `run --mcap` writes the same file during a run.
    """
    formats = formats_of(mcap, ros2)
    one_place = f"--out {out}: names one place; expected only one of --mcap and --ros2 with it"
    if not formats:
        raise InputError("export: expected --mcap, --ros2 or both")
    if out is not None and len(formats) > 1:
        raise InputError(one_place)
    with progress_bars("exporting the run"):
        from mjsheaf.export import FORMATS, export_run

        if out is not None:
            _require_place(out, directory / FORMATS[formats[0]].name, mcap)
        paths = [export_run(directory, name, out) for name in formats]
    print_lines(*paths)


def _require_place(out: Path, own: Path, mcap: bool) -> None:
    """Refuse a path that cannot be written, or lies in the directory of another run.

    Raises:
        InputError: The path is one.
    """
    if mcap:
        require_file_name("--out", out, ".mcap")
    elif not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no directory {out.parent}")
    require_outside_of_runs(out, own)
