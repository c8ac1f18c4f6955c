"""`mjsheaf video`."""

from pathlib import Path

from mjsheaf.cli.progress import progress_bars
from mjsheaf.errors import InputError
from mjsheaf.filming import film_run, video_options
from mjsheaf.results import load_run
from mjsheaf.scenario import load_scenario
from mjsheaf.video import available_backend


def video_command(directory: Path, out: Path | None, changes: dict[str, float | int | None]) -> None:
    """Draw a finished run again."""
    dataset, _ = load_run(directory)
    scenario = load_scenario(directory / "scenario.yaml")
    options = video_options(scenario, **changes)
    path = out or directory / "video.mp4"
    if path.suffix != ".mp4":
        raise InputError(f"--out {path}: legal is a name that ends in .mp4")
    if not path.parent.is_dir():
        raise InputError(f"--out {path}: there is no directory {path.parent}")
    backend, reason = available_backend()
    if backend is None:
        raise InputError(f"no video can be drawn here: {reason}")
    with progress_bars() as progress:
        frames = film_run(scenario, dataset, path, options, lambda done, total: progress("drawing video", done, total))
    print(f"{path}: {frames} frames, {options.width}x{options.height} at {options.fps:g} frames a second")
