"""Only the page that knows the token controls a run, and the run never waits for it."""

import json
import socket
import threading
import time
from collections.abc import Iterator

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from mjsheaf.errors import InputError
from mjsheaf.live.server import Server
from tests.commands import wait_until
from tests.live.client import get, joined

PAGE = b"<html>page</html>"


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    ended = threading.Event()

    def answer() -> None:
        while not ended.is_set():
            made.wait(0.02)
            if made.page_wanted:
                made.answer(PAGE)

    thread = threading.Thread(target=answer)
    thread.start()
    yield made
    ended.set()
    thread.join()
    made.close()


def test_the_page_is_served_with_the_token_only(server: Server) -> None:
    status, headers, content = get(server.url)
    assert (status, content) == (200, PAGE)
    assert headers["Cache-Control"] == "no-store"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    for path in ("/", "/?token=", "/?token=x", f"/?token={server.token[:-1]}", f"/?token=x&token={server.token}"):
        status, _, content = get(server.url, path)
        assert status == 403, path
        assert PAGE not in content
    assert get(server.url, f"/other?token={server.token}")[0] == 404


def test_another_name_of_this_machine_is_refused(server: Server) -> None:
    """So a page whose name is made to mean 127.0.0.1 cannot read it."""
    for host in ("evil.example", "localhost", f"localhost:{server.host.split(':')[1]}", f"evil.example@{server.host}"):
        assert get(server.url, Host=host)[0] == 403, host


def test_a_socket_needs_the_token_and_the_own_page(server: Server) -> None:
    for origin, token in (("own", None), ("own", "x"), ("http://evil.example", "own"), ("null", "own"), (None, "own")):
        with pytest.raises(InvalidStatus) as refused, joined(server.url, origin=origin, token=token):
            pass
        assert refused.value.response.status_code == 403
    assert not server.opened
    assert server.take_actions() == []


def test_there_is_one_client_at_a_time(server: Server) -> None:
    with joined(server.url):
        wait_until(lambda: server.opened, 10.0)
        with pytest.raises(InvalidStatus) as refused, joined(server.url):
            pass
        assert refused.value.response.status_code == 409


def test_it_listens_on_loopback_only(server: Server) -> None:
    assert server._server.socket.getsockname()[0] == "127.0.0.1"
    assert server._server.socket.family == socket.AF_INET


def test_a_port_that_is_taken_is_refused(server: Server) -> None:
    port = int(server.host.split(":")[1])
    with pytest.raises(InputError, match=f"--port {port}: .*expected a free port"):
        Server(port)


def test_actions_arrive_in_order_and_what_is_none_is_ignored(server: Server) -> None:
    with joined(server.url) as client:
        for message in ('{"gain": 2}', "", "[1]", "{", "1e999", "[" * 2000, b"\xff\xfe", '{"lose": "A1"}'):
            client.send(message)
        end = time.monotonic() + 10.0
        found: list[object] = []
        while len(found) < 2 and time.monotonic() < end:
            found += server.take_actions()
        assert found == [{"gain": 2}, {"lose": "A1"}]


def test_a_flood_is_bounded(server: Server) -> None:
    with joined(server.url) as client:
        for k in range(1000):
            client.send(json.dumps({"gain": k}))
        client.ping().wait(10.0)  # all of it has arrived
        assert len(server.take_actions()) <= 100
        client.send("x" * 100_000)
        with pytest.raises(ConnectionClosed):
            client.recv(timeout=10.0)


def test_a_slow_page_gets_the_newest_frame_and_delays_nobody(server: Server) -> None:
    frame = bytes(1_000_000)
    with joined(server.url, max_size=None) as client:
        wait_until(lambda: server.opened, 10.0)
        began = time.perf_counter()
        for k in range(300):
            server.publish(k.to_bytes(8) + frame)
        assert time.perf_counter() - began < 5.0  # the socket would take 300 MB
        found: list[int] = []
        while not found or found[-1] != 299:
            message = client.recv(timeout=10.0)
            assert isinstance(message, bytes)
            found.append(int.from_bytes(message[:8]))
        assert found == sorted(found)
        assert len(found) < 300


@pytest.mark.slow(first=True)
def test_closing_the_page_ends_the_server_but_reloading_does_not(server: Server) -> None:
    with joined(server.url):
        wait_until(lambda: server.opened, 10.0)
    assert get(server.url)[0] == 200  # reloaded
    with joined(server.url):
        time.sleep(2.5)
        assert not server.closed
    wait_until(lambda: server.closed, 10.0)
