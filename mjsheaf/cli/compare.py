"""`mjsheaf compare`."""

import json
from pathlib import Path

from mjsheaf.cli.console import make_console
from mjsheaf.cli.progress import progress_bars
from mjsheaf.comparing.record import CompareRecord
from mjsheaf.comparing.report import WIDTH, default_directory, publish, report
from mjsheaf.errors import MjsheafError, UnstableError
from mjsheaf.results.store import PlaceError, require_same_origin
from mjsheaf.scenario import load_scenario
from mjsheaf.scenario.load import origin, parse_override


def compare_command(source: str, overrides: list[str], seed: int | None, out: Path | None, video: bool) -> None:
    """Compare ideal kinematics with bodies, print the page, and raise what the exit code says."""
    changes = dict(parse_override(text) for text in overrides)
    if seed is not None:
        changes["seed"] = seed
    scenario = load_scenario(source, changes)
    notes = make_console(stderr=True, soft_wrap=True)
    if "seed" in changes and not scenario.uses_seed("physics"):
        notes.print(f"note: the seed changes nothing: {scenario.name} has no spread and no disturbance")
    directory = default_directory(scenario) if out is None else out
    where = origin(source, directory)
    if out is None:
        require_same_origin(directory, where)
    try:
        with progress_bars() as progress:
            published = publish(scenario, directory, video=video, origin=where, progress=progress)
    except PlaceError:
        raise
    except MjsheafError as error:
        raise type(error)(f"{source}: {error}") from None
    for note in published.notes:
        notes.print(f"note: {note}", markup=False, highlight=False)
    console = make_console()
    console.width = max(console.width, WIDTH)
    console.print(report(published.record))
    if published.replaced:
        console.print(published.replaced, highlight=False, soft_wrap=True, markup=False)
    for path in sorted(directory.iterdir()):
        console.print(f"  {path}", highlight=False, soft_wrap=True, markup=False)
    for key in ("ideal", "all"):
        rung = published.record.rung(key)
        if rung.status != "finished":
            raise UnstableError(f"{rung.label}: {rung.message}; what was found is in {directory}")


def print_schema() -> None:
    """Print the JSON Schema of compare.json."""
    print(json.dumps(CompareRecord.model_json_schema(), indent=2))
