"""Load scenarios by name or path, and laws in Python by their files; apply overrides, and check the whole."""

import inspect
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mjsheaf.arguments import require_mapping
from mjsheaf.errors import InputError, ScenarioError, expected, in_field, suggestion, visible
from mjsheaf.files import (
    SUFFIXES,
    confined,
    describe,
    digest,
    execute_file,
    in_this_directory,
    parse_yaml,
    read_yaml,
    resource_directory,
)
from mjsheaf.law.in_python import Controller
from mjsheaf.law.paths import Recorded
from mjsheaf.scenario.events import Join
from mjsheaf.scenario.scenario import EDGE_FIELDS, Scenario
from mjsheaf.section import plain, split_path, validation_problems
from mjsheaf.team.edges import edge_from_pair


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
        try:
            module = execute_file(Path(self.path), "mjsheaf_controller")
            with in_this_directory():
                if not hasattr(module, self.name):
                    public = [n for n, value in vars(module).items() if callable(value) and not n.startswith("_")]
                    raise InputError(f"there is no {self.name!r} in it; {expected(self.name, public)}")
                named = getattr(module, self.name)
                law: Any = named() if inspect.isclass(named) else named
                return Controller(law, self.label, seed)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            message = str(error) if isinstance(error, InputError) else describe(error)
            raise InputError(f"{self.field} {self.label}: {message}") from error

    @property
    def changed(self) -> bool:
        """True if the file is no longer the one that was found."""
        return digest(Path(self.path)) != self.digest

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
    source = source if source.isprintable() else visible(source)
    with in_field(f"{field} {source}"):
        path = Path(file) if directory is None else confined(file, directory)
    if not path.is_file():
        raise InputError(f"{field} {source}: there is no file {file}")
    return LawFile(str(path.resolve()), name, source, digest(path), field)


def load_controller(source: str, seed: int = 0) -> Controller:
    """Load the law FILE.py:NAME: a function, an object or a class that is made without arguments.

    Raises:
        InputError: There is no such file or name, or the file raises an exception.
    """
    if not isinstance(source, str):
        raise InputError(f"controller: expected FILE.py:NAME as a str, not {type(source).__name__}")
    return find_law(source).load(seed)


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


_VEHICLE_PLACES = (
    ("vehicles", "agents"),
    ("vehicles", "targets"),
    ("agents", "*", "vehicle"),
    ("targets", "*", "vehicle"),
    ("swarm", "vehicle"),
    ("controller", "custom", "*", "file"),
)
_FLOW_PLACES = (("flow", "*", "path"),)
_MOTION_PLACES = (("target_motion",), ("targets", "*", "motion"))


def list_scenarios() -> dict[str, Path]:
    """The scenarios that come with mjsheaf: name to file."""
    return {path.stem: path for path in sorted(resource_directory("scenarios").glob("*.yaml"))}


def load_scenario(source: str | Path | Mapping[str, Any], overrides: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario.

    Args:
        source: a name in scenarios/, or the path of a YAML file. The paths of vehicles in it are relative to its
            directory and stay inside it. Or a mapping, as the file would give: its name is 'scenario' unless it has
            one, and paths of vehicles are relative to the working directory.
        overrides: field path to value, as `--set`; for example {"controller.gain": 30, "agents.A1.heading": 90}. Paths
            of vehicles here are relative to the working directory and may lie anywhere.

    Raises:
        ScenarioError: the file cannot be read, is not valid, or an override does not fit. The message names file and
            field and says what is expected.
    """
    require_mapping("overrides", overrides, "a mapping of field paths to values")
    if isinstance(source, Mapping):
        return scenario_from_mapping({"name": "scenario", **source}, overrides)
    if not isinstance(source, str | Path):
        raise ScenarioError(f"expected a scenario's name, the path of a file or a mapping, not {type(source).__name__}")
    return scenario_from_mapping(read_scenario(source), overrides, str(source))


def read_scenario(source: str | Path) -> dict[str, Any]:
    """A scenario as a mapping for `scenario_from_mapping`: unchecked, but named, and with vehicles' paths absolute.

    Raises:
        ScenarioError: the file cannot be read, or names a vehicle outside its directory.
    """
    path = find_scenario(source)
    found = read_yaml(path)
    with in_field(source, ScenarioError):
        raw = map_vehicles(found, lambda name: str(confined(name, path.parent)))
        raw = _with_recorded(raw, lambda name: str(confined(name, path.parent)))
    raw.setdefault("name", name_from(path))
    return raw


def scenario_from_mapping(
    raw: Mapping[str, Any], overrides: Mapping[str, Any] | None = None, source: str = "scenario"
) -> Scenario:
    """Validate a scenario given as a mapping; see `load_scenario`. Tuples and numpy's values are welcome."""
    try:
        node = plain(raw)
        for path, value in (overrides or {}).items():
            with in_field("--set"):
                names = split_path(path)
            node = _with(node, names, plain(value), path)
        scenario = _cut_short(Scenario.model_validate(_with_recorded(node, str)), overrides or {})
        _ = scenario.phases  # fields that are valid one by one must also fit together
    except ValidationError as error:
        raise ScenarioError(*validation_problems(error, Scenario)).within(source) from None
    except InputError as error:
        raise error.within(source, ScenarioError) from None
    return scenario


def _with_recorded(node: Any, place: Callable[[str], str]) -> Any:
    """A scenario whose motions from files hold what the files say; `place` finds a file from what is written."""

    def read(motion: Any) -> Any:
        from_file = isinstance(motion, dict) and motion.get("kind") in ("recorded", "file")
        if not (from_file and isinstance(motion.get("path"), str)):
            return motion
        return Recorded(**{**motion, "path": place(motion["path"])}).read().model_dump(exclude_none=True)

    return _with_changed(node, _MOTION_PLACES, read)


def _cut_short(scenario: Scenario, overrides: Mapping[str, Any]) -> Scenario:
    """A scenario without the events that come after its end, where that, and no event, is overridden.

    A file whose events come after its own end is wrong; but a run that is cut short for a look needs no other events.
    """
    if "time.end" not in overrides or any(path.split(".")[0] == "events" for path in overrides):
        return scenario
    events = [event for event in scenario.events if event.time <= scenario.time.end]
    joining = [event.join for event in events if isinstance(event, Join)]  # an agent drifts only until it joins
    agents = [a.model_copy(update={"drift": False}) if a.drift and a.id not in joining else a for a in scenario.agents]
    return scenario.model_copy(update={"events": events, "agents": agents})


def parse_override(text: str) -> tuple[str, Any]:
    """Split PATH=VALUE and read VALUE as YAML.

    Raises:
        ScenarioError: there is no '=', or VALUE is not YAML.
    """
    path, equals, value = text.partition("=")
    if not equals or not path:
        raise ScenarioError(f"--set {text!r}: expected PATH=VALUE, for example controller.gain=30")
    return path, parse_yaml(value, f"--set {path}")


def map_vehicles(node: Any, change: Callable[[str], str], path: tuple[str, ...] = ()) -> Any:
    """A copy of a scenario, or of the value of one of its fields, with every path of a vehicle's description changed.

    Args:
        node: plain values.
        change: what becomes of a path.
        path: Path of the field; none for a whole scenario.

    Raises:
        InputError: `change` did; the message begins with the field.
    """

    def changed(name: Any) -> Any:
        return change(name) if isinstance(name, str) and name.endswith((*SUFFIXES, ".py")) else name

    def of_flow(name: Any) -> Any:
        return change(name) if isinstance(name, str) else name

    return _with_changed(_with_changed(node, _VEHICLE_PLACES, changed, path), _FLOW_PLACES, of_flow, path)


def _with_changed(
    node: Any, places: Sequence[tuple[str, ...]], change: Callable[[Any], Any], path: tuple[str, ...] = ()
) -> Any:
    """A copy of plain values with the fields at some places changed, where * is any item of a list or mapping."""
    # Places that are this field, above it or below it.
    near = [place for place in places if all(a in ("*", b) for a, b in zip(place, path, strict=False))]
    if any(len(place) == len(path) for place in near):
        with in_field(".".join(path)):
            return change(node)
    if not near or not isinstance(node, dict | list):
        return node
    if isinstance(node, dict):
        return {key: _with_changed(item, places, change, (*path, key)) for key, item in node.items()}
    return [_with_changed(item, places, change, (*path, str(k))) for k, item in enumerate(node)]


def find_scenario(source: str | Path, studies: Mapping[str, Path] | None = None) -> Path:
    """The file of a scenario, or of one of some studies, that is given by name or path; it need not exist.

    Raises:
        ScenarioError: it is neither a known name nor the path of a YAML file.
    """
    path = Path(source)
    known = {**(studies or {}), **list_scenarios()}
    if str(source) in known:
        return known[str(source)]
    if path.is_dir():
        raise ScenarioError(f"{source or repr(source)}: is a directory; expected a name or a YAML file")
    if path.suffix in SUFFIXES or path.exists():
        return path
    beside = [f"{source}{suffix}" for suffix in SUFFIXES if Path(f"{source}{suffix}").is_file()]
    close = f"; did you mean {beside[0]}?" if beside else suggestion(str(source), known)
    what = "study or scenario" if studies else "scenario"
    raise ScenarioError(f"{source}: no such {what}; expected {', '.join(known)}, or the path of a YAML file{close}")


def origin(source: str | Path, directory: Path) -> str:
    """Return the source of a scenario: its name in scenarios/, else its path relative to the run's directory.

    Two runs of one file have one origin, also when the project that holds both is moved.
    """
    real, own = os.path.realpath(find_scenario(source)), os.path.realpath(directory)
    names = [name for name, path in list_scenarios().items() if os.path.realpath(path) == real]
    return names[0] if names else os.path.relpath(real, own)


def name_from(path: Path) -> str:
    """A valid name for a scenario that has none: its file's."""
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", path.stem)
    return name if re.match("[A-Za-z]", name) else f"scenario_{name}"


def _with(node: Any, keys: list[str], value: Any, path: str) -> Any:
    """Return a copy of nested mappings and lists with one value replaced; None is an empty mapping.

    An item of a list is given by its number, id or name; of several of one name, it is the first.

    Raises:
        ScenarioError: There is no such item, or a value on the way has no fields.
    """
    if not keys:
        return value
    key, *rest = keys
    if isinstance(node, list):
        names = [item.get("id", item.get("name")) if isinstance(item, dict) else None for item in node]
        places = {str(k): k for k in range(len(node))}
        places |= {name: k for k, name in reversed([*enumerate(names)]) if isinstance(name, str)}
        if key not in places:
            known = [str(name) for name in names if name] or [f"0 to {len(node) - 1}"]
            raise ScenarioError(f"--set {path}: no item {key!r}; {expected(key, known)}")
        k = places[key]
        return [*node[:k], _with(node[k], rest, value, path), *node[k + 1 :]]
    if not isinstance(node, dict | None):
        raise ScenarioError(f"--set {path}: {key!r} lies inside {node!r}, which has no fields")
    fields = node or {}
    below = fields.get(key)
    if key in EDGE_FIELDS and isinstance(below, list):
        below = [edge_from_pair(edge) for edge in below]
    return {**fields, key: _with(below, rest, value, path)}
