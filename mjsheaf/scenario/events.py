"""Events: agents and targets are lost or join, links are cut or restored, formations and fields of the law change.

Each event happens at a sample and begins a phase of the run there (see `phases_of_events`). An agent or a target whose
first event is `join` is disconnected until then; such an agent holds its position, unless it is to drift. A lost agent
is disconnected and its thrusters stop; a lost target continues, and no agent senses it.

A formation changes at once or over a time. Its members' places then move in straight lines. Such a change is a phase of
its own, or several if something else happens meanwhile; in each, places begin where they are then.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationError

from mjsheaf.errors import InputError, expected, in_field
from mjsheaf.law.law import Station
from mjsheaf.loop.system import Phase, System, TimeGrid
from mjsheaf.section import Id, NonNegative, Section, split_path, validation_problems
from mjsheaf.team.edges import Edge, Explicit, Formation, Group
from mjsheaf.team.team import Ramp, Team

_FIXED = ("controller.control_period", "controller.record_period")  # samples are those of the whole run
_CHANGING = re.compile(
    r"controller\..+"
    r"|flow\.(agents|targets|air|water)(\..+)?"
    r"|links\.(all|communication|sensing)\.(noise|bias|loss|range|hold)(\..+)?"
    r"|safety\.(distance|range|rate|authority|tie_break)"
)
_Pair = Annotated[list[Id], Field(min_length=2, max_length=2)]


class Groups(Section):
    """Formations by name, as events change them."""

    formations: dict[str, Group] = Field(description="the groups")


class _Move(NamedTuple):
    """Change of a formation between two samples, with its outcome in words."""

    start: int
    end: int
    before: Formation
    outcome: str

    def at(self, sample: int, after: Formation, dimension: Mapping[str, int]) -> Formation:
        """Return the formation at a sample, `after` from the end on, with the dimension of each member."""
        share = (sample - self.start) / (self.end - self.start)
        if not 0.0 < share < 1.0:
            return self.before if share <= 0.0 else after
        own = [dimension[member] for member in after.members]
        ends = zip(self.before.places(own), after.places(own), strict=True)
        places = [(one + share * (other - one)).tolist() for one, other in ends]
        return Explicit(name=after.name, members=after.members, about=after.about, displacements=places)


@dataclass
class State:
    """Changes made by the events up to now.

    Attributes:
        team: with everybody present and all edges.
        grid: Sample times.
        lost: ids of agents and targets that are lost.
        waiting: ids of those that have yet to join.
        drifting: Ids of agents that do not hold their position until they join.
        cut: pairs whose edges are cut.
        sections: Controller, links and flow as they are now, by name.
        formations: Formations by name, as they are once they have changed.
        moves: Changes of formations over a time, by name, past ones included.
    """

    team: Team
    grid: TimeGrid
    sections: dict[str, Section]
    formations: dict[str, Formation] = field(default_factory=dict)
    moves: dict[str, _Move] = field(default_factory=dict)
    lost: set[str] = field(default_factory=set)
    waiting: set[str] = field(default_factory=set)
    drifting: frozenset[str] = frozenset()
    cut: set[frozenset[str]] = field(default_factory=set)

    def require_known(self, id: str) -> None:
        """Raise an InputError unless an agent or a target has this id."""
        if id not in self.team.index:
            raise InputError(f"unknown id {id!r}; {expected(id, self.team.index)}")

    def require_edge(self, pair: Sequence[str]) -> frozenset[str]:
        """The ends of an edge between agents, or of an agent and a target that it senses.

        Raises:
            InputError: an end is unknown, or there is no edge.
        """
        for id in pair:
            self.require_known(id)
        edges = [frozenset(e.between) for e in (*self.team.communication, *self.team.sensing)]
        if frozenset(pair) not in edges:
            near = sorted({id for e in edges if pair[0] in e for id in e - {pair[0]}}, key=self.team.index.__getitem__)
            raise InputError(
                f"{pair[0]} has no link to {pair[1]}; {expected(pair[1], near) if near else f'{pair[0]} has no links'}"
            )
        return frozenset(pair)

    def formations_at(self, sample: int) -> list[Formation]:
        """Return the formations at a sample, in their order."""
        dimension = {member.id: member.dimension for member in self.team.members}
        return [
            self.moves[name].at(sample, after, dimension) if name in self.moves else after
            for name, after in self.formations.items()
        ]

    @property
    def absent(self) -> set[str]:
        """Agents that are not part of the team now."""
        return {id for id in self.lost | self.waiting if id in self.team.agent_ids}

    def present_team(self, team: Team) -> Team:
        """Return a team with those who are present now and the edges that are whole.

        Raises:
            InputError: no agent is left.
        """
        if len(self.absent) == len(self.team.agents):
            raise InputError("no agent is left; expected at least one")
        unseen = (self.lost | self.waiting) - self.absent

        def is_active(edge: Edge) -> bool:
            return frozenset(edge.between) not in self.cut and edge.head not in unseen

        return team.changed(sorted(self.absent), is_active) if self.absent | unseen | self.cut else team


class Event(Section):
    """Base of all events: a time and one field more; subclasses must implement `apply`, which changes a State."""

    time: NonNegative = Field(description="when it happens; the time of a sample [s]")

    def apply(self, state: State) -> None:
        """Change the state.

        Raises:
            InputError: the event cannot happen then; the message begins with the field.
        """
        raise NotImplementedError

    @property
    def words(self) -> str:
        """The event in a few words: its field and whom it is about, such as: cut A1 - A4."""
        (name,) = type(self).model_fields.keys() - {"time"}
        about = getattr(self, name)
        return f"{name} {about if isinstance(about, str) else ' - '.join(about)}"


class Lose(Event):
    """Disconnect an agent and stop its thrusters; or stop the sensing of a target."""

    lose: Id = Field(
        description="id of an agent, which is disconnected and drifts, or of a target, which no agent senses any more"
    )

    def apply(self, state: State) -> None:
        """Lose it, if it is there."""
        with in_field("lose"):
            state.require_known(self.lose)
            if self.lose in state.lost | state.waiting:
                what = "is lost already" if self.lose in state.lost else "has not joined yet"
                raise InputError(f"{self.lose} {what}; expected an agent or target that is present")
            state.lost.add(self.lose)


class Cut(Event):
    """A link is cut: the edges between two agents, or of an agent that senses a target."""

    cut: _Pair = Field(description="ids of the two ends of a link")

    def apply(self, state: State) -> None:
        """Cut it, if it is whole."""
        with in_field("cut"):
            pair = state.require_edge(self.cut)
            if pair in state.cut:
                raise InputError(f"{' - '.join(self.cut)} is cut already; expected a link that is not")
            state.cut.add(pair)


class Restore(Event):
    """A link that was cut is restored."""

    restore: _Pair = Field(description="ids of the two ends of a link that was cut")

    def apply(self, state: State) -> None:
        """Restore it, if it is cut."""
        with in_field("restore"):
            pair = state.require_edge(self.restore)
            if pair not in state.cut:
                raise InputError(f"{' - '.join(self.restore)} is not cut; expected a link that is")
            state.cut.remove(pair)


class Join(Event):
    """Connect an agent or a target: one that was lost, or that was disconnected from the start."""

    join: Id = Field(
        description="id of an agent or a target; if this is its first event, it is disconnected until then, and an "
        "agent holds its position"
    )

    def apply(self, state: State) -> None:
        """Let it join, if it is not there."""
        with in_field("join"):
            state.require_known(self.join)
            if self.join not in state.lost | state.waiting:
                raise InputError(f"{self.join} is present already; expected one that is lost or has not joined yet")
            state.lost.discard(self.join)
            state.waiting.discard(self.join)


class Change(Event):
    """Change fields of the controller, of the flow, of formations, or of the links of all edges or of a kind."""

    set: dict[str, Any] = Field(
        description="values by path, such as controller.gain, flow.water.drift or formations.NAME.radius", min_length=1
    )
    over: NonNegative | None = Field(
        None,
        description="time in which formations change, a whole number of samples: their places move in straight lines; "
        "at once unless given; may end after the run [s]",
    )

    def apply(self, state: State) -> None:
        """Change them, all at once or over a time, if the values are valid."""
        self._reshape(state)
        paths = [path for path, _ in self.values() if not path.startswith("formations.")]
        if self.over and paths:
            raise InputError(f"over: only formations change over a time; expected another event for {paths[0]}")
        if not (paths or self.reshaped()):
            raise InputError("set.controller: names no field; expected fields of controller and their values")
        for path in paths:
            with in_field("set"):
                split_path(path)
            if path in _FIXED or not _CHANGING.fullmatch(path):
                raise InputError(
                    f"set.{path}: cannot change during a run; expected a field of controller but for its periods, of "
                    "flow.agents, flow.targets, flow.air, flow.water, safety or formations.NAME, or noise, bias, loss, "
                    "range or hold of links.all, links.communication or links.sensing"
                )
            if path.startswith("safety.") and "safety" not in state.sections:
                raise InputError(
                    f"set.{path}: the scenario has no section safety; expected one from the start of the run"
                )
        before = dict(state.sections)
        for name, section in before.items():
            state.sections[name] = _changed(section, name, self.values())
        places = {"controller": "it in controller.custom", "flow": "one that `flow` has at the start"}
        for name, place in places.items():
            new = sorted(set(_files_in(state.sections[name])) - set(_files_in(before[name])))
            if new:
                own = "controller.custom" if name == "controller" else name
                raise InputError(f"set.{own}: an event cannot name a file, {new[0]}; expected {place}")

    def reshaped(self) -> dict[str, dict[str, Any]]:
        """Return the new fields of each formation that changes, by its name."""
        found: dict[str, dict[str, Any]] = {}
        for path, value in self.values():
            first, *names = path.split(".", 2)
            if first == "formations" and names:
                own = {names[1]: value} if len(names) > 1 else value
                if not isinstance(own, Mapping):
                    raise InputError(f"set.{path}: expected fields of a formation and their values")
                found.setdefault(names[0], {}).update(own)
        return found

    def _reshape(self, state: State) -> None:
        """Change formations."""
        start = _sample_of(self.time, state.grid)
        with in_field("over"):
            end = _sample_of(self.time + (self.over or 0.0), state.grid, beyond=True)
        for name, fields in self.reshaped().items():
            with in_field(f"set.formations.{name}"):
                before = state.formations.get(name)
                if before is None:
                    raise InputError(f"unknown formation; {expected(name, state.formations or ['none'])}")
                if fixed := sorted({"name", "members", "about"} & fields.keys()):
                    raise InputError(f"{fixed[0]} cannot change during a run; expected fields of shape or place")
                if name in state.moves and start < state.moves[name].end:
                    raise InputError("still changes from an earlier event; expected a later time")
            # A shape replaces all that the shape before it had of its own, and one of side and radius the other.
            kept = _PLACING if "shape" in fields else set(type(before).model_fields)
            taken = {"side", "radius"} if {"side", "radius"} & fields.keys() else set()
            raw = before.model_dump(mode="json", exclude_none=True, include=kept, exclude=taken)
            try:
                groups = Groups.model_validate({"formations": {name: raw | fields}})
            except ValidationError as error:
                raise InputError(*(f"set.{line}" for line in validation_problems(error, Groups))) from None
            state.formations[name] = groups.formations[name]
            if end > start:
                state.moves[name] = _Move(start, end, before, self.outcome)

    def touches(self, part: str) -> bool:
        """Return True if the event changes that part of the controller, or fields in it."""
        return any(f"{path}.".startswith(f"controller.{part}.") for path, _ in self.values())

    def values(self) -> Iterator[tuple[str, Any]]:
        """Path and value of every field."""
        for name, value in self.set.items():
            if name == "controller" and isinstance(value, Mapping):
                yield from ((f"{name}.{below}", item) for below, item in value.items())
            else:
                yield name, value

    @property
    def words(self) -> str:
        """For example: gain = 5, or: ring.radius = 2 over 10 s."""
        return self.outcome + (f" over {self.over:g} s" if self.over else "")

    @property
    def outcome(self) -> str:
        """The new values in words."""
        return ", ".join(f"{path.partition('.')[2]} = {_in_words(value)}" for path, value in self.values())


def _files_in(section: Any) -> Iterator[str]:
    """Yield the files of registered terms in a section `controller`, and those of gridded flow in a section `flow`."""
    yield from (term.file for term in getattr(section, "custom", {}).values() if term.file is not None)
    parts = (getattr(section, name) for name in type(section).model_fields)
    yield from (part.path for part in parts if hasattr(part, "path"))


def _in_words(value: Any) -> str:
    """A value of a field, of a section its kind or what it has."""
    if not isinstance(value, Mapping):
        return str(value)
    inside = ", ".join(f"{name} {_in_words(item)}" for name, item in value.items())
    return str(value.get("kind") or inside or "default")


_KINDS = {"lose": Lose, "cut": Cut, "restore": Restore, "join": Join, "set": Change}


def _kind_of(event: Any) -> str | None:
    """The name of the class of an event, as a file has it."""
    if isinstance(event, Event):
        return type(event).__name__
    return next((_KINDS[key].__name__ for key in event if key in _KINDS), None) if isinstance(event, dict) else None


AnyEvent = Annotated[
    Annotated[Lose, Tag("Lose")]
    | Annotated[Cut, Tag("Cut")]
    | Annotated[Restore, Tag("Restore")]
    | Annotated[Join, Tag("Join")]
    | Annotated[Change, Tag("Change")],
    Discriminator(
        _kind_of,
        custom_error_type="event_kind",
        custom_error_message=f"expected time and one of {', '.join(_KINDS)}",
    ),
]
"""An event as a file has it: its kind is the name of its field."""


def _changed(section: Section, name: str, values: Iterable[tuple[str, Any]]) -> Section:
    """A section with fields changed, by paths of which those that do not begin with its name are of others.

    Raises:
        InputError: a field is unknown or its value not valid; the message begins with the field.
    """
    raw = section.model_dump(mode="json", exclude_none=True)
    for path, value in values:
        first, *between, last = split_path(path)
        if first != name:
            continue
        node = raw
        for part in between:
            node = node.setdefault(part, {})
            if not isinstance(node, dict):
                raise InputError(f"{path}: {part!r} has no fields")
        node[last] = value
    try:
        return type(section).model_validate(raw)
    except ValidationError as error:
        raise InputError(*(f"{name}.{line}" for line in validation_problems(error, type(section)))) from None


_PLACING = {"name", "members", "about", "height", "centre"}  # fields of a formation that no shape has of its own


def phases_of_events(
    events: Sequence[Event],
    whole: System,
    sections: Mapping[str, Section],
    adapt: Callable[[Team, Mapping[str, Section]], System],
    place: Callable[[Sequence[Formation]], Team],
    drifting: Collection[str] = (),
) -> tuple[Phase, ...]:
    """The phases of a run: one that begins with the run, and one at each sample at which something happens.

    Args:
        events: Events in any order; those at one time happen in the order given.
        whole: The system with all agents and targets present.
        sections: Controller, links, flow and, if there is one, safety at the start, by name.
        adapt: makes the system of another team, and of other sections.
        place: Makes the team of other formations.
        drifting: Ids of agents that drift with the medium until they join.

    Raises:
        InputError: an event cannot happen, or an agent that is to drift does not join later; the message begins with
            the field.
    """
    if not events and not drifting:
        return (Phase(0, whole),)
    grid = whole.grid
    numbers: dict[int, list[int]] = {0: []}  # of the events at each sample
    for k, event in enumerate(events):
        with in_field(f"events.{k}.time"):
            numbers.setdefault(_sample_of(event.time, grid), []).append(k)
    state = State(whole.team, grid, dict(sections), {group.name: group for group in whole.team.formations})
    state.waiting = find_waiting([events[k] for _, own in sorted(numbers.items()) for k in own], whole.team)
    state.drifting = frozenset(drifting)
    for id in drifting:
        if id not in state.waiting:
            raise InputError(
                f"agents.{id}.drift: is true, but {id} is present from the start; expected false, or an event "
                f"{{time: ..., join: {id}}} as its first"
            )
    phases = []
    begins = set(numbers)
    while begins:
        start = min(begins)
        own = numbers.get(start, [])
        words = dict.fromkeys(f"{move.outcome} reached" for move in state.moves.values() if move.end == start)
        for k in own:
            with in_field(f"events.{k}"):
                if start == 0 and isinstance(events[k], Join):
                    raise InputError("join: at the start of the run; expected a later time, or no event")
                events[k].apply(state)
        turns = {sample for move in state.moves.values() for sample in (move.start, move.end)}
        ahead = {sample for sample in turns if sample > start}
        begins = {sample for sample in begins | turns if start < sample <= grid.steps}
        with in_field(f"events.{own[-1] if own else 0}"):
            now = state.formations_at(start)
            team = state.present_team(place(now) if ahead or now != list(whole.team.formations) else whole.team)
            if ahead:
                ends = max(turns - ahead), min(ahead)
                teams = [state.present_team(place(state.formations_at(sample))) for sample in ends]
                times = [grid.start + grid.period * sample for sample in (*ends, start)]
                team.begin_ramp(Ramp(times[0], times[1], teams[0], teams[1], times[2]))
            unchanged = team is whole.team and state.sections == sections
            system = whole if unchanged else adapt(team, state.sections)
        phases.append(Phase(start, _stopped(system, state), (*words, *(events[k].words for k in own))))
    return tuple(phases)


def find_waiting(events: Sequence[Event], team: Team) -> set[str]:
    """Return the ids of a team whose first event, of events in order, is to join."""
    first = dict[str, bool]()
    for event in events:
        if isinstance(event, Join) and event.join in team.index:
            first.setdefault(event.join, True)
        elif isinstance(event, Lose):
            first.setdefault(event.lose, False)
    return {id for id, joins in first.items() if joins}


def _stopped(system: System, state: State) -> System:
    """The system with lost agents' thrusters stopped; agents that have yet to join hold their position or drift."""
    if not state.absent:
        return system
    ids = [member.id for member in system.team.members]
    limit = np.where([id in state.absent for id in ids], 0.0, system.law.limit)
    lost, holding = state.lost & state.absent, (state.waiting & state.absent) - state.drifting
    stopped = np.array([id in lost for id in ids]) if lost else None
    waiting = system.waiting  # of fixed targets
    if holding:
        holds = np.array([id in holding for id in ids])
        if waiting is not None:
            holds |= waiting.holds
        waiting = Station(holds, system.initial, np.zeros(len(ids)), system.law.limit)
    return replace(system, law=system.law._replace(limit=limit), stopped=stopped, waiting=waiting)


def _sample_of(time: float, grid: TimeGrid, *, beyond: bool = False) -> int:
    """The number of the sample at a time in s; `beyond` the end of the run too, if so."""
    place = (time - grid.start) / grid.period
    nearest = round(place)
    at = f"{grid.start + nearest * grid.period:.9g}"
    if not 0 <= nearest <= grid.steps and not beyond:
        end = grid.start + grid.steps * grid.period
        raise InputError(f"{time:g} s lies outside the run; expected {grid.start:g} to {end:g} s")
    if abs(place - nearest) > 1e-6 * max(1.0, abs(place) * 1e-3):  # in periods; less is rounding
        raise InputError(
            f"{time:.9g} s lies between samples, which are {grid.period:g} s apart; expected {at} s, the nearest"
        )
    return nearest
