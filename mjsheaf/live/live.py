"""A run that is watched and changed while it proceeds: the user's actions, frames for the page, and the loop.

A user's actions become events of the scenario. The session continues under the scenario with such an event, so the
recorded scenario reproduces the session, to the bit. Frames are the newest sample of the run in the arrays of its page.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from mjsheaf.arrays import Array
from mjsheaf.checking.loop.body_loop import body_loop, medium_on_path
from mjsheaf.checking.loop.held_law import loop_of
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.checking.theorem.targets import follow_targets
from mjsheaf.errors import InputError, MjsheafError, UndecidedError, in_field
from mjsheaf.export.log import LogSink
from mjsheaf.live.server import Server
from mjsheaf.loop.session import Session
from mjsheaf.loop.system import System
from mjsheaf.media.flow import FlowField
from mjsheaf.media.gridded import GriddedFlow
from mjsheaf.page.page import Packer, add_samples, law_in_words, origin_of, page_of
from mjsheaf.results.dataset import join, make_datasets
from mjsheaf.results.store import Memory, Sink
from mjsheaf.scenario import Scenario
from mjsheaf.scenario.events import Change, Cut, Event, Join, Lose, Restore, find_waiting
from mjsheaf.show.played import Region, edges_of
from mjsheaf.team.team import Path
from mjsheaf.threads import one_thread

MAX_FACTOR = 10.0
"""Largest ratio of a gain or a flow to that of the scenario, and of the scenario's gain to a gain."""

_STRENGTHS = {"sources": "alpha", "vortices": "gamma", "channels": "beta"}
FRAME = 0.05
"""Least time between frames, s."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Simulated seconds per second that the page offers, in addition to as fast as possible."""


# -- actions -----------------------------------------------------------------------------------------------------------


def flow_values(scenario: Scenario, factor: float) -> dict[str, Any]:
    """Return the fields of the steady flow multiplied by a factor, by path; none if a part of it is gridded."""
    values: dict[str, Any] = {}
    for medium in type(scenario.flow).model_fields:
        field = getattr(scenario.flow, medium)
        if isinstance(field, GriddedFlow):
            return {}
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


_ACTIONS: dict[str, type[Event]] = {"lose": Lose, "join": Join, "cut": Cut, "restore": Restore}


def event_of(action: Mapping[str, Any], scenario: Scenario, time: float) -> Event:
    """Return an action as an event.

    Args:
        action: Name of the action and its value, such as {"lose": "A1"}.
        scenario: Scenario at the start of the session.
        time: Present time, s.

    Raises:
        InputError: The action is unknown, or its value is not valid.
    """
    gain = scenario.controller.gain
    ranges = {"gain": (gain / MAX_FACTOR, gain * MAX_FACTOR), "flow": (0.0, MAX_FACTOR)}
    if len(action) != 1 or not action.keys() <= _ACTIONS.keys() | ranges.keys():
        expected = ", ".join([*_ACTIONS, *ranges])
        raise InputError(f"{', '.join(map(str, action)) or 'nothing'}: expected one of {expected}")
    ((name, value),) = action.items()
    if name in _ACTIONS:
        return _ACTIONS[name](time=time, **{name: value})
    low, high = ranges[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{value!r}: expected a number from {low:g} to {high:g}")
    values = {"controller.gain": float(value)} if name == "gain" else flow_values(scenario, float(value))
    if not values:
        raise InputError("flow: the scenario has no steady flow, or a gridded one; expected drift or kernels alone")
    return Change(time=time, set=values)


class Recorder:
    """A session, and the actions of its user.

    Attributes:
        session: The session.
        events: Events that the user added, in order.
        origin: Scenario at the start.
        samples: Number of samples taken.
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
        events = [*(other for other in self.events if not _replaces(event, other)), event]
        # Who is present from the start depends on a member's first event, which must not change.
        before, after = (
            find_waiting(sorted([*self.origin.events, *added], key=lambda event: event.time), self.origin.team)
            for added in (self.events, events)
        )
        for id in before ^ after:
            state = "has not joined yet" if id in before else "is present already"
            raise InputError(f"{event.words}: {id} {state}")
        changed = self.origin.model_copy(update={"events": [*self.origin.events, *events]})
        # No event of a user changes them.
        changed.__dict__ |= {"team": self.origin.team, "whole": self.origin.whole}
        with in_field(event.words):
            self.session.change_events(changed)
        self.events = events
        self.words[event.words] = event.words
        if "flow" in action:
            self.flow_factors.append((event.time, float(action["flow"])))
            self.words[event.words] = f"flow = {action['flow']:g} x the scenario's"


def _replaces(new: Event, old: Event) -> bool:
    """Return True if an event sets the same fields as another at the same time."""
    both = isinstance(new, Change) and isinstance(old, Change)
    return both and new.time == old.time and new.set.keys() == old.set.keys()  # type: ignore[attr-defined]


# -- frames ------------------------------------------------------------------------------------------------------------


@dataclass
class Row(Packer):
    """Packer that keeps one sample as 32-bit floats.

    Attributes:
        values: Values by name, flat.
    """

    values: dict[str, NDArray[np.float32]] = field(default_factory=dict)

    def add_fixed(self, name: str, values: Array, step: float) -> Array:
        """Keep values; `step` is not used."""
        self.add_float(name, values)
        return values

    def add_float(self, name: str, values: Array) -> None:
        """Keep values."""
        with np.errstate(over="ignore"):
            self.values[name] = np.asarray(values, "<f4").ravel()


def outlook(system: System) -> Array:
    """Return points that the run is expected to reach, in space, shape (K, 3), m.

    They are the targets' path without disturbance, and the harmonic extension of it. Where the path is not known, they
    are those of the start.
    """
    path = follow_targets(system.remaining)
    some = slice(None, None, 1 + path.positions[..., 0].size // 1000)  # about a thousand points
    points = path.positions[some].copy()
    points[:, : len(system.team.agents)] = system.team.unpack(path.q_star[some])
    points[:, system.planar, 2] += system.bodies.surface_height
    points = points.reshape(-1, 3)
    return np.asarray(points[np.isfinite(points).all(axis=1)])


class Display(Sink):
    """Sink that shows a run in progress: it makes the pages that browsers request, and publishes frames.

    Attributes:
        cost: Time that the last frame took, s.
    """

    def __init__(self, server: Server, recorder: Recorder) -> None:
        """Show nothing until the first chunk."""
        self.cost = 0.0
        self._server = server
        self._recorder = recorder
        self._history = Memory(1e9)
        self._last: xr.Dataset | None = None  # the newest chunk
        self._edges: list[Any] | None = None  # of the last page; None before there is one
        scenario = recorder.origin
        self._height = scenario.scene.height
        self._ahead = outlook(recorder.session.engine.phases[0].system)
        team = scenario.team
        pairs = {frozenset(edge.between): list(edge.between) for edge in (*team.communication, *team.sensing)}
        self._controls = {  # what the page's controls need to know
            "gain": scenario.controller.gain,
            "factor": MAX_FACTOR,
            "flow": bool(flow_values(scenario, 1.0)),
            "speeds": list(SPEEDS),
            "end": scenario.time.end,
            "agents": team.agent_ids,
            "links": list(pairs.values()),
            "address": f"ws://{server.host}/live",
        }
        self._again = f"mjsheaf view {scenario.name} --backend {recorder.session.backend}", ""

    def write(self, chunk: xr.Dataset) -> None:
        """Keep a chunk for pages, and publish a frame with its last sample."""
        self._history.write(chunk)
        before = self._last
        self._last = chunk
        if self._edges is None or before is None:
            return
        began = time.perf_counter()
        self._server.publish(self._frame(before, chunk))
        self.cost = time.perf_counter() - began

    def show_page(self) -> None:
        """Make a page if a browser requests one. It begins at the start of the run, unless the run is too long."""
        if not self._server.page_wanted:
            return
        dataset = self._last if self._history.overflowed else self._history.dataset
        assert dataset is not None, "there is no page before the first sample"
        phases = self._recorder.session.engine.phases
        page = page_of(
            self._recorder.origin, phases, dataset, {}, (),
            again=self._again, controls=self._controls, ahead=self._ahead,
        )  # fmt: skip
        self._edges = list(edges_of(phases))
        self._origin = origin_of(dataset)
        self._scene = Region.of(self._ahead - self._origin)
        self._attitude: NDArray[np.float32] | None = None
        self._server.answer(page)

    def _frame(self, before: xr.Dataset, chunk: xr.Dataset) -> bytes:
        """Return the last sample of a chunk: its time as a 64-bit float, then all arrays as 32-bit floats."""
        phases = self._recorder.session.engine.phases
        own = chunk.isel(time=[-1])
        both = join([before.isel(time=[-1]), own])  # headings along a path need two samples
        row = Row()
        add_samples(row, both, own, self._height, phases, self._scene, self._origin)
        # Residuals are in the page's order, and NaN for edges that no phase has any more.
        residual = dict(zip(edges_of(phases), row.values["residual"].tolist(), strict=True))
        row.values["residual"] = np.array([residual.get(key, np.nan) for key in self._edges or ()], "<f4")
        # The sign of each attitude is the one that is nearer to the previous frame.
        attitude = row.values["quaternion"].reshape(-1, 4)
        if self._attitude is not None:
            attitude[(attitude * self._attitude).sum(axis=1) < 0.0] *= -1.0
        self._attitude = attitude
        time = own["time"].values.astype("<f8")
        return b"".join([time.tobytes(), *(values.tobytes() for values in row.values.values())])


# -- the loop ----------------------------------------------------------------------------------------------------------


def stable_gain(system: System, backend: str) -> float | None:
    """Return the gain from which on the law is unstable, 1/s, as `mjsheaf check` has it; None if it is not known."""
    with suppress(UndecidedError, InputError, np.linalg.LinAlgError):
        if backend == "physics":
            medium = medium_on_path(system, follow_targets(system))
            return body_loop(system, spectrum_of(system.team), medium).largest_gain
        if len(system.law.links.table):
            return None  # delayed or lost measurements lower it
        loop = loop_of(system)
        return loop.stable_gains[1] if loop.stable_gains and loop.stable_gains[0] == 0.0 else None
    return None


class LiveRun:
    """A run in progress.

    Attributes:
        recorder: The session and the user's events.
        message: Reason why the last action was refused or the run ended; empty otherwise.
    """

    def __init__(self, session: Session, server: Server, sinks: Sequence[Sink] = (), speed: float = 1.0) -> None:
        """Take the first samples.

        Args:
            session: The session, at its start.
            server: The server.
            sinks: Further receivers of the run.
            speed: Simulated seconds per second; infinite for as fast as possible.
        """
        self.recorder = Recorder(session)
        self.message = ""
        self._server = server
        self._display = Display(server, self.recorder)
        self._sinks: list[Sink] = [self._display, *sinks]
        self._speed = speed
        self._paused = False
        self._unstable = False
        self._samples = 1
        self._phase = 0
        self._happened: list[str] | None = None
        self._stable_gain: float | None = None
        self._search: Future[float | None] | None = None  # of it, which takes seconds for large teams
        self._searches = ThreadPoolExecutor(1)
        self._advance(2)
        self._tell()

    def run(self) -> None:
        """Simulate from when the page is opened until it is closed."""
        while not self._server.closed:
            self._display.show_page()
            self._act()
            if self._search is not None and self._search.done():
                self._stable_gain, self._search = self._search.result(), None
                self._tell()
            if self._paused or self._ended or not self._server.opened:
                self._server.wait(0.5)
                continue
            began = time.perf_counter()
            self._advance(self._samples)
            self._pace(time.perf_counter() - began)
            if self._ended or self.recorder.phase != self._phase:
                self._tell()

    def close(self) -> None:
        """Begin no further search."""
        self._searches.shutdown(wait=False, cancel_futures=True)

    @property
    def _ended(self) -> bool:
        return self._unstable or self.recorder.samples > self.recorder.session.engine.system.grid.steps

    def _advance(self, samples: int) -> None:
        """Take samples, and pass them to the sinks."""
        chunk, message = self.recorder.record(samples)
        self._unstable = bool(message)
        self.message = message or self.message
        if chunk is None:
            return
        for sink in self._sinks:
            if isinstance(sink, LogSink):
                sink.phases = self.recorder.session.engine.phases  # the user's events among them
            if self.recorder.samples == chunk.sizes["time"]:
                sink.open(chunk.variables, chunk.attrs)
            sink.write(chunk)

    def _pace(self, took: float) -> None:
        """Choose the length of the next chunk, and wait as the speed requires.

        A frame shows the last sample of a chunk. Longer chunks need fewer frames, and their length is chosen to spend
        little time on frames.

        Args:
            took: Time that the chunk took with its frame, s.
        """
        period = self.recorder.session.engine.system.grid.period
        due = self._samples * period / self._speed
        if due > took:
            self._server.wait(due - took)
        work = max(took - self._display.cost, 1e-6) / self._samples
        # Frames may take a hundredth of the time.
        affordable = max(1, int(max(FRAME, self._display.cost / 0.01) / work))
        wanted = affordable if math.isinf(self._speed) else round(FRAME * self._speed / period)
        self._samples = max(1, min(wanted, 2 * self._samples, affordable, 4096))  # in a chunk

    def _act(self) -> None:
        """Perform the actions that have arrived."""
        for action in self._server.take_actions():
            self.message = ""
            try:
                if action.keys() == {"pause"}:
                    self._paused = action["pause"] is True
                elif action.keys() == {"speed"}:
                    speed = action["speed"]
                    if speed is not None and (isinstance(speed, bool) or speed not in SPEEDS):
                        raise InputError(f"speed: {speed!r}; expected one of {', '.join(f'{s:g}' for s in SPEEDS)}")
                    self._speed = math.inf if speed is None else float(speed)
                else:
                    self.recorder.do(action)
            except MjsheafError as error:
                self.message = f"Refused: {' '.join(map(str, error.args))}"
            self._tell()

    def _tell(self) -> None:
        """Publish the state of the run."""
        phases = self.recorder.session.engine.phases
        self._phase = self.recorder.phase
        system = phases[self._phase].system
        events = [words for phase in phases[: self._phase + 1] for words in phase.events]
        happened = [words for words in events if not words.startswith("gain = ") or "," in words]
        if happened != self._happened:  # another gain changes no limit
            self._happened, self._stable_gain = happened, None
            self._search = self._searches.submit(stable_gain, system.remaining, self.recorder.session.backend)
        words = self.recorder.words
        said = [{"time": phase.time, "events": [words.get(own, own) for own in phase.events]} for phase in phases[1:]]
        self._server.tell(
            {
                "paused": self._paused,
                "ended": self._ended,
                "speed": None if math.isinf(self._speed) else self._speed,
                "message": self.message,
                "phases": said,
                "absent": sorted(system.team.absent),
                "gain": system.gain,
                "stable_gain": self._stable_gain,
                "law": law_in_words(system),
                "flow": [{"time": time, "factor": factor} for time, factor in self.recorder.flow_factors],
                "done": [f"{event.time:g} s: {words[event.words]}" for event in self.recorder.events],
            }
        )


@one_thread  # for good: the search for the stable gain runs next to the loop, and the number is the process's
def view(
    scenario: Scenario,
    backend: str,
    *,
    engine: str = "mujoco",
    port: int = 0,
    speed: float = 1.0,
    sinks: Sequence[Sink] = (),
    opened: Callable[[str], None],
    recorded: Callable[[Scenario], None],
) -> None:
    """Run a scenario and show it in a browser, until its page is closed.

    Args:
        scenario: The scenario.
        backend: 'physics' or 'ideal'.
        engine: 'mujoco' or 'fused'.
        port: Number of the server's port on 127.0.0.1; 0 takes a free one.
        speed: Simulated seconds per second at the start.
        sinks: Further receivers of the run.
        opened: Function called with the address of the page, as soon as it can be opened.
        recorded: Function called with the scenario and the user's events, which reproduces the session, when the
            page is closed or a signal ends the session. It is not called if no page was opened.

    Raises:
        InputError: The scenario cannot be simulated, see `simulate`; websockets is not installed; or the port is taken.
        NotUniqueError: The harmonic extension is not unique.
    """
    with ExitStack() as stack:
        server = stack.enter_context(closing(Server(port)))  # refused before anything is prepared
        session = stack.enter_context(Session(scenario, backend, engine=engine))
        for sink in sinks:
            stack.callback(sink.close)
        run = stack.enter_context(closing(LiveRun(session, server, sinks, speed)))
        opened(server.url)
        try:
            run.run()
        finally:
            if server.opened:
                recorded(session.scenario)
