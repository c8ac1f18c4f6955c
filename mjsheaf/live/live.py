"""The loop of a run that is watched: it simulates, publishes frames and takes the user's actions."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from typing import Any

import numpy as np
import xarray as xr

from mjsheaf.checking.loop.body_loop import body_loop, medium_on_path
from mjsheaf.checking.loop.held_law import loop_of
from mjsheaf.checking.spectrum import spectrum_of
from mjsheaf.checking.theorem.targets import follow_targets
from mjsheaf.errors import InputError, MjsheafError, UndecidedError
from mjsheaf.live.actions import MAX_FACTOR, Recorder, flow_values
from mjsheaf.live.frames import Frames, outlook
from mjsheaf.live.server import Server
from mjsheaf.loop.session import Session
from mjsheaf.page.page import Live, law_in_words, page_of
from mjsheaf.results.sinks import Memory, Sink
from mjsheaf.scenario import Scenario
from mjsheaf.system import System
from mjsheaf.threads import one_thread

FRAME = 0.05
"""Least time between frames, s."""
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Simulated seconds per second that the page offers, in addition to as fast as possible."""

_SHARE = 0.01  # fraction of the time that frames may take
_MAX_SAMPLES = 4096  # in a chunk
_MOST_KEPT = 1e9  # bytes of the run that a new page begins with


class Display:
    """Sink that shows a run in progress: it makes the pages that browsers request, and publishes frames.

    Attributes:
        cost: Time that the last frame took, s.
    """

    def __init__(self, server: Server, recorder: Recorder) -> None:
        """Show nothing until the first chunk."""
        self.cost = 0.0
        self._server = server
        self._recorder = recorder
        self._history = Memory(_MOST_KEPT)
        self._last: xr.Dataset | None = None
        self._frames: Frames | None = None
        scenario = recorder.origin
        self._height = scenario.scene.height
        self._ahead = outlook(recorder.session.engine.phases[0].system)
        self._controls = controls_of(scenario) | {"address": server.socket_address}
        self._again = f"mjsheaf view {scenario.name} --backend {recorder.session.backend}", ""

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Do nothing, because chunks contain everything."""

    def write(self, chunk: xr.Dataset) -> None:
        """Keep a chunk for pages, and publish a frame with its last sample."""
        self._history.write(chunk)
        self._last = chunk
        if self._frames is None:
            return
        began = time.perf_counter()
        phases = self._recorder.session.engine.phases
        self._server.publish(self._frames.frame(chunk, phases, self._recorder.samples - 1))
        self.cost = time.perf_counter() - began

    def close(self) -> None:
        """Keep the pages."""

    def show_page(self) -> None:
        """Make a page if a browser requests one. It begins at the start of the run, unless the run is too long."""
        if not self._server.page_wanted:
            return
        dataset = self._last if self._history.overflowed else self._history.dataset
        assert dataset is not None, "there is no page before the first sample"
        phases = self._recorder.session.engine.phases
        live = Live(self._controls, self._ahead)
        page = page_of(self._recorder.origin, phases, dataset, {}, (), again=self._again, live=live)
        self._frames = Frames(phases, dataset, self._height, self._ahead)
        self._server.answer(page)


def controls_of(scenario: Scenario) -> dict[str, Any]:
    """Return what the page's controls need to know."""
    return {
        "gain": scenario.controller.gain,
        "factor": MAX_FACTOR,
        "flow": bool(flow_values(scenario, 1.0)),
        "speeds": list(SPEEDS),
        "end": scenario.time.end,
        "agents": scenario.team.agent_ids,
        "links": links_of(scenario),
    }


def links_of(scenario: Scenario) -> list[list[str]]:
    """List the ids of the two ends of each link that can be cut."""
    team = scenario.team
    pairs = {frozenset(edge.between): list(edge.between) for edge in (*team.communication, *team.sensing)}
    return list(pairs.values())


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
        affordable = max(1, int(max(FRAME, self._display.cost / _SHARE) / work))
        wanted = affordable if math.isinf(self._speed) else round(FRAME * self._speed / period)
        self._samples = max(1, min(wanted, 2 * self._samples, affordable, _MAX_SAMPLES))

    def _act(self) -> None:
        """Perform the actions that have arrived."""
        for action in self._server.take_actions():
            self.message = ""
            try:
                self._do(action)
            except MjsheafError as error:
                self.message = f"Refused: {' '.join(map(str, error.args))}"
            self._tell()

    def _do(self, action: dict[str, Any]) -> None:
        """Do one action.

        Raises:
            MjsheafError: It is not possible.
        """
        if action.keys() == {"pause"}:
            self._paused = action["pause"] is True
        elif action.keys() == {"speed"}:
            speed = action["speed"]
            if speed is not None and (isinstance(speed, bool) or speed not in SPEEDS):
                raise InputError(f"speed: {speed!r}; expected one of {', '.join(f'{s:g}' for s in SPEEDS)}")
            self._speed = math.inf if speed is None else float(speed)
        else:
            self.recorder.do(action)

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


@one_thread  # for good: the search for the stable gain runs beside the loop, and the number is the process's
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
        InputError: As for `simulate`; or websockets is not installed, or the port is taken.
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
