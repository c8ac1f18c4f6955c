"""A run that is served to Foxglove, as Foxglove's own client receives it."""

import base64
import json
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import xarray as xr
from mcap.reader import make_reader

from mjsheaf import load_scenario, simulate
from mjsheaf.export import live as served
from tests.builders import REPOSITORY
from tests.commands import IDEAL, answer_of, call, is_refusal

CLIENT = REPOSITORY / "web" / "foxglove_client.mjs"
needs_client = pytest.mark.skipif(
    not (REPOSITORY / "web" / "node_modules" / "@foxglove").is_dir(), reason="node or web/node_modules is missing"
)


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        number = int(free.getsockname()[1])
    monkeypatch.setattr(served, "PORT", number)
    return number


def watched(port: int, during: Callable[[], object]) -> list[dict[str, Any]]:
    """Return what the client receives while something goes on."""
    found: list[dict[str, Any]] = []

    def follow() -> None:
        for _ in range(100):  # until the server is there
            client = subprocess.run(
                ["node", str(CLIENT), f"ws://127.0.0.1:{port}"], capture_output=True, text=True, timeout=120
            )
            assert client.returncode == 0 or "ECONNREFUSED" in client.stderr, client.stderr
            if client.returncode == 0:
                found.extend(map(json.loads, client.stdout.splitlines()))
                return

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    during()
    thread.join(30.0)
    return found


@needs_client
@pytest.mark.slow(first=True)
def test_a_client_receives_the_messages_of_the_mcap_file(port: int, tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = ["run", "midpoint", "--backend", "ideal", "--set", "time.end=4", "--no-video", "--mcap", "--live"]
    received = watched(port, partial(call, *command, "--out", out))
    with (out / "run.mcap").open("rb") as stream:
        found = list(make_reader(stream).iter_messages())
    written = {(channel.topic, message.log_time): message.data for _, channel, message in found}
    topics = {message["topic"] for message in received}
    assert {"/tf", "/scene", "/vehicles", "/errors"} <= topics
    assert all(message["encoding"] == "protobuf" for message in received)
    names = {message["topic"]: message["schemaName"] for message in received}
    assert (names["/tf"], names["/scene"]) == ("foxglove.FrameTransforms", "foxglove.SceneUpdate")
    same = [message for message in received if message["topic"] != "/vehicles"]  # which are shown again
    assert len(same) > 50
    for message in same:
        data = base64.b64decode(message["bytes"])
        assert data == written[message["topic"], int(message["timestamp"])], message["topic"]
    times = [int(message["timestamp"]) for message in received if message["topic"] == "/tf"]
    assert times == sorted(times)


@pytest.mark.slow
def test_it_is_shown_in_short_pieces_and_its_files_are_those_of_a_run_without(
    port: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slow law is seen as it goes on, not once a long piece of its run is there."""
    samples: list[int] = []
    write = served.Log.write

    def noting(self: served.Log, chunk: xr.Dataset) -> None:
        samples.append(chunk.sizes["time"])
        write(self, chunk)

    monkeypatch.setattr(served.Log, "write", noting)
    for out, options in (("plain", []), ("live", ["--live"])):
        command = ["run", "midpoint", "--backend", "ideal", "--set", "time.end=0.5", "--no-video", *options]
        assert call(*command, "--out", tmp_path / out) == 0
    period = load_scenario("midpoint").controller.control_period
    assert sum(samples) == round(0.5 / period) + 1
    assert max(samples) * period <= 0.1 + 1e-9
    for name in ("result.nc", "scenario.yaml", "errors.png"):
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()


def test_a_port_that_is_taken_is_named(port: int, tmp_path: Path) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", port))
        other.listen()
        answer = answer_of("run", "midpoint", "--no-video", "--live", "--out", tmp_path / "run")
    assert is_refusal(answer, f"port {port} on 127.0.0.1")
    assert not (tmp_path / "run").exists()


def test_a_client_that_says_nothing_does_not_hold_the_run(port: int, tmp_path: Path) -> None:
    """Browsers open connections ahead of need, without a word."""
    scenario = load_scenario("midpoint", {"time.end": 0.1})
    sink = served.Log(tmp_path / "null", scenario, scenario.phases, tmp_path / "null", pace=1e9)
    run = simulate(scenario, "ideal")
    sink.open(run.variables, run.attrs)
    with socket.create_connection(("127.0.0.1", port)):
        sink.write(run)
        begun = time.monotonic()
        sink.close()
        assert time.monotonic() - begun < 10.0


@pytest.mark.usefixtures("without_plots")
def test_nothing_listens_unless_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served.Log, "__init__", lambda *_, **__: pytest.fail("a server was made"))
    assert call("run", "midpoint", *IDEAL, "--out", tmp_path / "run") == 0
    with pytest.raises(pytest.fail.Exception):
        call("run", "midpoint", *IDEAL, "--live", "--out", tmp_path / "live")


def test_events_of_a_user_are_served_too(port: int, tmp_path: Path) -> None:
    """The phases of a session that is watched grow; messages of the log tell of them."""
    from mjsheaf.live.live import Recorder
    from mjsheaf.loop.session import Session

    scenario = load_scenario("midpoint", {"time.end": 1.0})
    with Session(scenario, "ideal") as session:
        sink = served.Log(tmp_path / "null", scenario, scenario.phases, tmp_path / "null", pace=1e9)
        said: list[str] = []
        sink.write_log = lambda level, words: said.append(words)  # type: ignore[method-assign]
        recorder = Recorder(session)
        first, _ = recorder.record(5)
        assert first is not None
        sink.open(first.variables, first.attrs)
        sink.write(first)
        recorder.do({"gain": 0.5 * scenario.controller.gain})
        sink.phases = session.engine.phases
        then, _ = recorder.record(5)
        assert then is not None
        sink.write(then)
        sink.close()
    assert said == [f"gain = {0.5 * scenario.controller.gain:g}"]
