"""Changes that a user may make to a run in progress, as events of its scenario."""

from collections.abc import Callable, Mapping
from typing import Any

import xarray as xr

from mjsheaf.errors import InputError, NotUniqueError
from mjsheaf.loop.session import Session
from mjsheaf.media.flow import FlowField
from mjsheaf.results.dataset import make_datasets
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.events import Change, Cut, Event, Join, Lose, Restore, find_waiting
from mjsheaf.team.null_modes import free_axes
from mjsheaf.team.shapes import Path

MAX_FACTOR = 10.0
"""Largest ratio of a gain or a flow to that of the scenario, and of the scenario's gain to a gain."""

_STRENGTHS = {"sources": "alpha", "vortices": "gamma", "channels": "beta"}


def flow_values(scenario: Scenario, factor: float) -> dict[str, Any]:
    """Return the fields of the steady flow multiplied by a factor, by path."""
    values: dict[str, Any] = {}
    for medium in type(scenario.flow).model_fields:
        field = getattr(scenario.flow, medium)
        if not isinstance(field, FlowField):
            continue
        if field.drift is not None:
            values[f"flow.{medium}.drift"] = [factor * speed for speed in field.drift]
        for kind, strength in _STRENGTHS.items():
            raw = [kernel.model_dump(mode="json", exclude_none=True) for kernel in getattr(field, kind)]
            for kernel in raw:
                kernel[strength] *= factor
            if raw:
                values[f"flow.{medium}.{kind}"] = raw
    return values


def _number(value: Any, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{value!r}: expected a number from {low:g} to {high:g}")
    return float(value)


def _id(value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"{value!r}: expected an id")
    return value


def _pair(value: Any) -> list[str]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{value!r}: expected the ids of the two ends of a link")
    return [_id(value[0]), _id(value[1])]


def _set_gain(scenario: Scenario, time: float, value: Any) -> Event:
    gain = scenario.controller.gain
    return Change(time=time, set={"controller.gain": _number(value, gain / MAX_FACTOR, gain * MAX_FACTOR)})


def _set_flow(scenario: Scenario, time: float, value: Any) -> Event:
    values = flow_values(scenario, _number(value, 0.0, MAX_FACTOR))
    if not values:
        raise InputError("flow: the scenario has no steady flow; expected one")
    return Change(time=time, set=values)


_ACTIONS: dict[str, Callable[[Scenario, float, Any], Event]] = {
    "lose": lambda _, time, value: Lose(time=time, lose=_id(value)),
    "join": lambda _, time, value: Join(time=time, join=_id(value)),
    "cut": lambda _, time, value: Cut(time=time, cut=_pair(value)),
    "restore": lambda _, time, value: Restore(time=time, restore=_pair(value)),
    "gain": _set_gain,
    "flow": _set_flow,
}


def event_of(action: Mapping[str, Any], scenario: Scenario, time: float) -> Event:
    """Return an action as an event.

    Args:
        action: Name of the action and its value, such as {"lose": "A1"}.
        scenario: Scenario at the start of the session.
        time: Present time, s.

    Raises:
        InputError: The action is unknown, or its value is not valid.
    """
    if len(action) != 1 or not action.keys() <= _ACTIONS.keys():
        raise InputError(f"{', '.join(map(str, action)) or 'nothing'}: expected one of {', '.join(_ACTIONS)}")
    ((name, value),) = action.items()
    return _ACTIONS[name](scenario, time, value)


class Recorder:
    """A session, and what its user did.

    Attributes:
        session: The session.
        events: Events that the user added, in order.
        origin: Scenario at the start.
        samples: Number of samples taken so far.
        flow_factors: Time, s, and ratio to the scenario's flow, of each change of the flow.
        words: Short words for each event of the user, by its own words.
    """

    def __init__(self, session: Session) -> None:
        """Begin without events of a user."""
        self.session = session
        self.origin = session.scenario
        self.events: list[Event] = []
        self.samples = 0
        self.flow_factors: list[tuple[float, float]] = []
        self.words: dict[str, str] = {}
        self._path = Path()

    @property
    def phase(self) -> int:
        """Number of the phase that the next sample belongs to."""
        return max(k for k, phase in enumerate(self.session.engine.phases) if phase.start <= self.samples)

    def record(self, samples: int) -> tuple[xr.Dataset | None, str]:
        """Take samples, but not beyond the present phase and the end of the run.

        Returns:
            The samples, None if there are none, and the reason if the run became unstable.
        """
        session = self.session
        piece = next(session.engine.record(samples))
        if not len(piece.time):
            return None, piece.message
        seed = session.scenario.seed
        chunk = next(make_datasets([piece], session.backend, seed, session.engine.phases, self.samples, self._path))
        self.samples += len(piece.time)
        return chunk, piece.message

    def do(self, action: Mapping[str, Any]) -> None:
        """Add an action as an event at the present sample.

        A value that is set replaces one that was set at the same sample.

        Raises:
            MjsheafError: The action is not possible now; nothing is changed.
        """
        if self.session.finished:
            raise InputError("the run has ended")
        engine = self.session.engine
        grid = engine.system.grid
        sample = engine.steps_taken // engine.steps_per_sample
        event = event_of(action, self.origin, grid.start + sample * grid.period)
        events = [other for other in self.events if not _replaces(event, other)]
        events.append(event)
        self._require_same_past(event, [*self.origin.events, *events])
        changed = self.origin.model_copy(update={"events": [*self.origin.events, *events]})
        # No event of a user changes them.
        changed.__dict__ |= {"team": self.origin.team, "whole": self.origin.whole}
        try:
            self.session.change_events(changed)
        except NotUniqueError as error:
            raise NotUniqueError(_why_free(event, changed) or str(error)) from error
        self.events = events
        self.words[event.words] = event.words
        if "flow" in action:
            self.flow_factors.append((event.time, float(action["flow"])))
            self.words[event.words] = f"flow = {action['flow']:g} x the scenario's"

    def _require_same_past(self, new: Event, events: list[Event]) -> None:
        """Refuse an event that would change who is present from the start: this depends on a member's first event.

        Raises:
            InputError: It would.
        """
        team = self.origin.team
        before = find_waiting(sorted([*self.origin.events, *self.events], key=lambda event: event.time), team)
        for id in before ^ find_waiting(sorted(events, key=lambda event: event.time), team):
            state = "has not joined yet" if id in before else "is present already"
            raise InputError(f"{new.words}: {id} {state}")


def _why_free(event: Event, scenario: Scenario) -> str:
    """Say what nothing determines after an event, and who needs an edge; empty if no agent is free along an axis."""
    free = next((phase.system for phase in scenario.phases if phase.system.free_directions), None)
    if free is None:
        return ""
    axes = free_axes(free.determined)
    names = {agent for names in axes for agent in names}
    parts = [
        f"{who[0]}'s {' and '.join(own)}" if len(who) == 1 else f"the {' and '.join(own)} of {', '.join(who)} together"
        for who, own in axes.items()
    ]
    kind, _, whom = event.words.partition(" ")
    after = {"lose": f"without {whom}", "cut": f"without the link {whom}"}.get(kind, f"after {event.words}")
    give = names.pop() if len(names) == 1 else "one of them"
    return f"{after}, nothing determines {'; '.join(parts)}. Give {give} an edge first."


def _replaces(new: Event, old: Event) -> bool:
    """Return True if an event sets the same fields as another at the same time."""
    both = isinstance(new, Change) and isinstance(old, Change)
    return both and new.time == old.time and new.set.keys() == old.set.keys()  # type: ignore[attr-defined]
