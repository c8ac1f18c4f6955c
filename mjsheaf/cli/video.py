"""`mjsheaf video`."""

from pathlib import Path

import numpy as np
import xarray as xr

from mjsheaf.cli.progress import progress_bars
from mjsheaf.errors import InputError
from mjsheaf.filming import film_run, video_options
from mjsheaf.results import open_run
from mjsheaf.results.store import enclosing_run, save_summary
from mjsheaf.runs.publish import video_entry
from mjsheaf.scenario import Scenario, load_scenario
from mjsheaf.video import available_backend

_DRAWN = {
    "ideal": ("agent_position", "target_position", "harmonic_extension", "disagreement"),
    "physics": ("agent_orientation", "target_orientation", "agent_height", "target_height"),
}


def video_command(directory: Path, out: Path | None, changes: dict[str, float | int | str | None]) -> None:
    """Draw a finished run again."""
    with open_run(directory) as (dataset, summary):
        scenario = load_scenario(directory / "scenario.yaml")
        _require_match(directory, scenario, dataset)
        options = video_options(scenario, **changes)
        own = directory / "video.mp4"
        path = own if out is None else out
        _check_place(path, own)
        backend, reason = available_backend()
        if backend is None:
            raise InputError(f"no video can be drawn here: {reason}")
        with progress_bars() as progress:
            frames = film_run(scenario, dataset, path, options, lambda done, of: progress("drawing video", done, of))
    if path.resolve() == own.resolve():
        save_summary({**summary, "video": video_entry(frames, options)}, directory / "summary.json")
    print(f"{path}: {frames} frames, {options.width}x{options.height} at {options.fps:g} frames a second")


def _check_place(path: Path, own: Path) -> None:
    """Refuse a place where the video cannot lie, before it is drawn."""
    if path.suffix != ".mp4" or path.is_dir():
        raise InputError(f"--out {path}: expected a file whose name ends in .mp4")
    if not path.parent.is_dir():
        raise InputError(f"--out {path}: there is no directory {path.parent}")
    run = enclosing_run(path)
    if run is not None and path.resolve() != own.resolve():
        raise InputError(f"--out {path}: lies in {run}, a run's directory; expected {own}, or a place outside of runs")


def _require_match(directory: Path, scenario: Scenario, dataset: xr.Dataset) -> None:
    """Refuse a run whose data are not those of its scenario.

    Raises:
        InputError: naming the directory and what differs.
    """
    backend = dataset.attrs.get("backend")
    drawn = _DRAWN["ideal"] + (_DRAWN["physics"] if backend == "physics" else ())
    missing = [name for name in (*drawn, "time", "agent", "target") if name not in dataset]
    if missing or backend not in _DRAWN or "status" not in dataset.attrs:
        raise InputError(f"{directory}: result.nc is not that of a run: it has no {(*missing, 'backend or status')[0]}")
    for kind, members in (("agent", scenario.agents), ("target", scenario.targets)):
        place = dataset[f"{kind}_position"].isel(time=0).transpose(kind, "axis").values
        dimensions = 3 - np.isnan(place).sum(axis=1)
        found = dict(zip(map(str, dataset[kind].values), dimensions.tolist(), strict=True))
        if found != {m.id: len(m.position) for m in members}:
            raise InputError(
                f"{directory}: result.nc and scenario.yaml do not match: their {kind}s differ; run the scenario again"
            )
