"""A watched run equals the run of the scenario that it records, to the bit, and frames show what is recorded."""

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjsheaf import load_scenario, simulate
from mjsheaf.live.live import outlook, view
from mjsheaf.results.store import Memory
from mjsheaf.runs.publish import write_scenario
from mjsheaf.scenario import Scenario
from tests.live.client import do, get, joined, next_state
from tests.live.test_random_sessions import NAMES
from tests.page.pages import positions_of, said_in, series_in
from tests.strategies import slow


class Watched:
    """A run that is watched from another thread, as fast as possible unless a speed is given."""

    def __init__(self, scenario: Scenario, backend: str, **options: Any) -> None:
        self.kept = Memory()
        self.recorded: list[Scenario] = []
        self.url = ""
        self._opened = threading.Event()
        self._error: Exception | None = None
        self._arguments = scenario, backend, {"speed": float("inf")} | options
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        scenario, backend, options = self._arguments
        try:
            view(scenario, backend, sinks=[self.kept], opened=self._open, recorded=self.recorded.append, **options)
        except Exception as error:
            self._error = error
            self._opened.set()

    def _open(self, url: str) -> None:
        self.url = url
        self._opened.set()

    def __enter__(self) -> "Watched":
        self._thread.start()
        self._opened.wait(300.0)
        if self._error:
            raise self._error
        return self

    def __exit__(self, *error: object) -> None:
        self._thread.join(60.0)
        assert not self._thread.is_alive(), "the server did not end with its page"
        if self._error:
            raise self._error


def read_frame(message: bytes, said: dict[str, Any]) -> tuple[float, dict[str, Any]]:
    values = np.frombuffer(message[8:], "<f4")
    found = {}
    for name, entry in said["arrays"].items():
        found[name] = values[: entry["shape"][1]]
        values = values[entry["shape"][1] :]
    assert len(values) == 0
    return float(np.frombuffer(message[:8], "<f8")[0]), found


@pytest.mark.parametrize(("name", "backend", "end"), [("paper", "ideal", 6.0), slow("harbour", "physics", 4.0)])
def test_the_recorded_scenario_repeats_the_session_to_the_bit(
    name: str, backend: str, end: float, tmp_path: Path
) -> None:
    """Every frame is a sample of the run, with the attitudes of a smooth motion."""
    scenario = load_scenario(name, {"time.end": end})
    lost = scenario.team.agent_ids[0]
    frames = []
    with Watched(scenario, backend, speed=0.2) as run:  # which does not end before the session pauses
        status, _, page = get(run.url)
        assert status == 200
        said = said_in(page)
        with joined(run.url, max_size=None) as socket:
            assert not next_state(socket)["done"]
            assert "expected one of" in do(socket, nonsense=1)["message"]
            assert do(socket, gain=scenario.controller.gain * 0.8)["message"] == ""
            state = do(socket, lose=lost)
            assert state["message"] == "" or "not unique" in state["message"]
            assert do(socket, pause=True)["paused"]
            link = said["live"]["links"][-1]
            state = do(socket, cut=link)
            assert state["message"] == "" or "not unique" in state["message"]
            assert not do(socket, pause=False)["paused"]
            state = do(socket, speed=None)
            while not state["ended"]:
                message = socket.recv(timeout=60)
                if isinstance(message, bytes):
                    frames.append(read_frame(message, said))
                else:
                    state = json.loads(message)
    (recorded,) = run.recorded
    assert len(recorded.events) > len(scenario.events)
    threads = 1 if backend == "physics" else None
    again = simulate(load_scenario(str(write_scenario(recorded, tmp_path))), backend, threads=threads)
    seen = run.kept.dataset
    for variable in NAMES:
        np.testing.assert_array_equal(seen[variable].values, again[variable].values, err_msg=variable)
    assert frames
    places, before = positions_of(again), -np.inf
    for time_of, arrays in frames:
        assert time_of > before
        before = time_of
        k = int(np.argmin(np.abs(again.time.values - time_of)))
        assert again.time.values[k] == time_of
        np.testing.assert_allclose(arrays["position"].reshape(-1, 3), places[k] - said["origin"], atol=1e-4)
        np.testing.assert_allclose(arrays["tracking_error"], again.tracking_error.values[k], rtol=1e-6, atol=1e-30)
        turned = np.linalg.norm(arrays["quaternion"].reshape(-1, 4), axis=1)
        np.testing.assert_allclose(turned, 1.0, atol=1e-5)


def test_where_the_targets_path_is_not_known_the_page_begins_with_their_start() -> None:
    """Gusts have no bound."""
    system = load_scenario("harbour_gusts").system
    agents = len(system.team.agents)
    points = outlook(system)
    assert np.isfinite(points).all()
    for place in system.initial[agents:]:
        assert (points[:, :2] == place[:2]).all(axis=1).any()


@pytest.mark.long
def test_a_page_opened_later_begins_with_the_whole_run() -> None:
    scenario = load_scenario("paper", {"time.end": 0.5})
    with Watched(scenario, "ideal") as run, joined(run.url, max_size=None) as socket:
        while not next_state(socket)["ended"]:
            pass
        page = get(run.url)[2]
    assert len(series_in(page)["position"]) == run.kept.dataset.sizes["time"]
    assert len(said_in(page)["time"]) == run.kept.dataset.sizes["time"]
    (recorded,) = run.recorded
    assert recorded.events == scenario.events


def test_a_run_nobody_opens_is_not_recorded() -> None:
    """A signal ends it: here an exception of what announces the address."""
    recorded: list[Scenario] = []

    def stop(url: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        view(load_scenario("midpoint", {"time.end": 0.1}), "ideal", opened=stop, recorded=recorded.append)
    assert recorded == []
