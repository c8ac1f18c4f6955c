"""Where a study comes from: a study file or a scenario, by name or path."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mjsheaf.errors import InputError, ScenarioError
from mjsheaf.io.files import confined, list_studies
from mjsheaf.io.yaml import read_yaml
from mjsheaf.scenario.load import list_scenarios, map_vehicles, read_scenario
from mjsheaf.studies.schema import StudyFile, problem_of, values_of

_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True)
class Source:
    """A study file as read.

    Attributes:
        name: of the study.
        study: what it asks; paths of vehicles in it are relative to `directory`.
        scenario: the scenario as read, with paths of vehicles absolute.
        directory: of the file, absolute.
    """

    name: str
    study: StudyFile
    scenario: dict[str, Any]
    directory: Path


def read_source(source: str) -> Source:
    """Read a study file, or a scenario as a study of one run.

    Args:
        source: a name in studies/ or scenarios/, or the path of a YAML file; one with a field `scenario` is a study.

    Raises:
        ScenarioError: the file does not exist, is not valid, or names what lies outside its directory.
    """
    studies, scenarios = list_studies(), list_scenarios()
    if source in scenarios:
        return Source(source, StudyFile(scenario=source), read_scenario(source), scenarios[source].parent)
    path = studies.get(source, Path(source))
    if path.suffix not in _SUFFIXES and not path.exists():
        raise ScenarioError(
            f"{source}: no such study or scenario; expected {', '.join([*studies, *scenarios])}, "
            "or the path of a YAML file"
        )
    if path.is_dir():
        raise ScenarioError(f"{source}: is a directory; expected a name or a YAML file")
    raw = read_yaml(path)
    directory = path.parent.resolve()
    if "scenario" not in raw:
        return Source(path.stem, StudyFile(scenario=source), read_scenario(source), directory)
    try:
        study = StudyFile.model_validate(raw)
    except ValidationError as error:
        raise ScenarioError(f"{source}: {problem_of(error)}") from None
    try:
        for field, value in values_of(study):
            map_vehicles(value, lambda name: str(confined(name, directory)), tuple(field.split(".")))
    except InputError as error:
        raise ScenarioError(f"{source}: {error}") from None
    if study.scenario in scenarios:
        return Source(path.stem, study, read_scenario(study.scenario), directory)
    try:
        beside = confined(study.scenario, directory)
    except InputError as error:
        raise ScenarioError(f"{source}: scenario: {error}") from None
    if not beside.is_file():
        raise ScenarioError(
            f"{source}: scenario: {study.scenario!r} is neither a file nor one of {', '.join(scenarios)}"
        )
    return Source(path.stem, study, read_scenario(beside), directory)


def vehicle_files(scenario: dict[str, Any], study: StudyFile, directory: Path) -> dict[str, str]:
    """SHA-256 of the files of vehicles that do not come with mjsheaf: path of description, MJCF file or mesh to digest.

    Args:
        scenario: as read.
        study: whose values may name vehicles too.
        directory: to which paths in the study are relative.

    Raises:
        InputError: a vehicle's files cannot be read, or lie outside its directory.
    """
    named: dict[Path, None] = {}

    def collect(name: str) -> str:
        named.setdefault(directory / name)
        return name

    map_vehicles(scenario, collect)
    for field, value in values_of(study):
        map_vehicles(value, collect, tuple(field.split(".")))
    digests: dict[str, str] = {}
    for description in named:
        from mjsheaf.vehicles.loading import files_of, read_description

        for path in [description, *files_of(description, read_description(description).mjcf)]:
            try:
                digests[str(path)] = hashlib.sha256(path.read_bytes()).hexdigest()
            except OSError as error:
                raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    return digests
