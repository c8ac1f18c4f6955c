"""A client of the live page's server, which does what the page does."""

import http.client
import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import parse_qs, urlsplit

from websockets.sync.client import ClientConnection, connect


def get(url: str, path: str | None = None, **headers: str) -> tuple[int, dict[str, str], bytes]:
    """Ask for a page; `path` replaces that of the address. Returns status, headers and content."""
    address = urlsplit(url)
    connection = http.client.HTTPConnection(address.netloc, timeout=60)
    try:
        connection.request("GET", path if path is not None else f"{address.path}?{address.query}", headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()
    finally:
        connection.close()


@contextmanager
def joined(
    url: str, *, origin: str | None = "own", token: str | None = "own", **options: Any
) -> Iterator[ClientConnection]:
    address = urlsplit(url)
    own = parse_qs(address.query).get("token", [""])[0]
    query = f"?token={own if token == 'own' else token}" if token is not None else ""
    given = f"http://{address.netloc}" if origin == "own" else origin
    uri = f"ws://{address.netloc}/live{query}"
    with connect(uri, origin=given, proxy=None, compression=None, **options) as socket:  # type: ignore[arg-type]
        yield socket


def do(socket: ClientConnection, **action: Any) -> dict[str, Any]:
    socket.send(json.dumps(action))
    return next_state(socket)


def next_state(socket: ClientConnection) -> dict[str, Any]:
    while True:
        message = socket.recv(timeout=60)
        if isinstance(message, str):
            return json.loads(message)
