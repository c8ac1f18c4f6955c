"""The resolved scenario in the directory of a run: all that it takes to run it again, vehicles' files included."""

import shutil
from pathlib import Path
from typing import Any

from mjsheaf.reading import dump_yaml
from mjsheaf.results.store import CHECKSUMS, VEHICLES, write_checksums
from mjsheaf.scenario import Scenario


def dump_scenario(scenario: Scenario) -> str:
    """The resolved scenario as YAML: every field that has a value; running it again gives the same bits.

    Vehicles that do not come with mjsheaf stand in it as they were given; `write_scenario` takes their files along.
    """
    return dump_yaml(_resolved(scenario))


def write_scenario(scenario: Scenario, directory: Path) -> Path:
    """Write scenario.yaml, and into vehicles/ the files of vehicles that do not come with mjsheaf.

    It names those by paths inside the directory, which may then be moved, and runs to the same bits even when the
    originals have changed. Their checksums tell later what else a person has put there.

    Returns:
        The path of scenario.yaml.

    Raises:
        InputError: a vehicle's files cannot be found, or lie outside its directory.
        OSError: the directory cannot be written.
    """
    raw = _resolved(scenario)
    holders = [*raw["agents"], *raw["targets"]]
    places = [(holder, "vehicle") for holder in holders] + [
        (raw.get("vehicles", {}), key) for key in ("agents", "targets")
    ]
    copies: dict[str, str] = {}
    for holder, key in places:
        name = holder.get(key)
        if name is None or Path(name).suffix not in (".yaml", ".yml"):
            continue
        if name not in copies:
            taken = {CHECKSUMS, *(Path(copy).parts[1] for copy in copies.values())}
            copies[name] = _copy(Path(name), directory, taken)
        holder[key] = copies[name]
    if copies:
        write_checksums(directory / VEHICLES)
    path = directory / "scenario.yaml"
    path.write_text(dump_yaml(raw), encoding="utf-8")
    return path


def _copy(description: Path, directory: Path, taken: set[str]) -> str:
    """Copy the files of a vehicle into a folder of its own; the path of the copied description, relative."""
    from mjsheaf.backends.physics.loading import read_description
    from mjsheaf.backends.physics.sources import files_of

    folder, k = description.stem, 1
    while folder in taken:
        k += 1
        folder = f"{description.stem}_{k}"
    root = description.parent.resolve()
    files = files_of(description, read_description(description).mjcf)
    home = directory / VEHICLES / folder
    for file in files:
        copy = home / file.relative_to(root)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, copy)
    home.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(description, home / description.name)
    return f"{VEHICLES}/{folder}/{description.name}"


def _resolved(scenario: Scenario) -> dict[str, Any]:
    return scenario.model_dump(mode="json", exclude_none=True)
