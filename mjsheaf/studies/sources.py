"""Where a study comes from: a study file or a scenario, by name or path."""

import hashlib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.reading import describe_validation_error, read_yaml
from mjsheaf.resources import resource_directory
from mjsheaf.scenario import list_scenarios, load
from mjsheaf.studies.schema import StudyFile

_SUFFIXES = (".yaml", ".yml")
_VEHICLE_FIELDS = ("vehicle", "agents", "targets")  # of an agent, a target, a swarm, and of `vehicles`
_INSTALLED = Path(__file__).resolve().parent / "shipped"


def list_studies() -> dict[str, Path]:
    """The study files that come with mjsheaf: name to file."""
    folder = _INSTALLED if _INSTALLED.is_dir() else resource_directory("scenarios").parent / "studies"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def read_source(source: str) -> tuple[str, StudyFile, dict[str, Any]]:
    """Read a study file, or a scenario as a study of one run.

    Args:
        source: a name in studies/ or scenarios/, or the path of a YAML file; one with a field `scenario` is a study.

    Returns:
        The study's name, what it asks, and its scenario as read, with the paths of vehicles absolute.

    Raises:
        ScenarioError: there is no such file, or it is not valid.
    """
    studies, scenarios = list_studies(), list_scenarios()
    if source in scenarios:
        return source, StudyFile(scenario=source), read_scenario(source)
    path = studies.get(source, Path(source))
    if path.suffix not in _SUFFIXES and not path.exists():
        raise ScenarioError(
            f"{source}: no such study or scenario; legal are {', '.join([*studies, *scenarios])}, "
            "or the path of a YAML file"
        )
    if path.is_dir():
        raise ScenarioError(f"{source}: is a directory; legal is a name or a YAML file")
    raw = read_yaml(path)
    if "scenario" not in raw:
        return path.stem, StudyFile(scenario=source), read_scenario(source)
    try:
        study = StudyFile.model_validate(raw)
    except ValidationError as error:
        raise ScenarioError(f"{source}: {describe_validation_error(error, StudyFile)}") from None
    wanted = study.scenario if study.scenario in scenarios else str(path.parent / study.scenario)
    if wanted not in scenarios and not Path(wanted).is_file():
        raise ScenarioError(
            f"{source}: scenario: {study.scenario!r} is neither a file nor one of {', '.join(scenarios)}"
        )
    return path.stem, study, read_scenario(wanted)


def read_scenario(source: str) -> dict[str, Any]:
    """A scenario as a mapping that `scenario_from_mapping` takes anywhere: paths absolute, name given, unchecked.

    Raises:
        ScenarioError: the file cannot be read, or names a vehicle outside its directory.
    """
    path = load.find_scenario(source)
    raw = read_yaml(path)
    try:
        raw = load._anchor_paths(raw, path.parent)
    except InputError as error:
        raise ScenarioError(f"{source}: {error}") from None
    raw.setdefault("name", load._name_from(path))
    return raw


def vehicle_files(raw: dict[str, Any]) -> dict[str, str]:
    """SHA-256 of the files of vehicles that do not come with mjsheaf: path of description, MJCF file or mesh to digest.

    Raises:
        InputError: a vehicle's files cannot be read, or lie outside its directory.
    """
    holders = [raw.get("vehicles"), raw.get("swarm")]
    for field in ("agents", "targets"):
        holders += items if isinstance(items := raw.get(field), list) else []
    named = [value for h in holders if isinstance(h, dict) for value in (h.get(k) for k in _VEHICLE_FIELDS)]
    digests: dict[str, str] = {}
    for name in dict.fromkeys(n for n in named if isinstance(n, str) and n.endswith(_SUFFIXES)):
        from mjsheaf.backends.physics.loading import read_description
        from mjsheaf.backends.physics.sources import files_of

        description = Path(name)
        for path in [description, *files_of(description, read_description(description).mjcf)]:
            digests[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return digests
