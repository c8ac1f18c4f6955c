"""HTTP and websocket on 127.0.0.1, for one client that knows the token.

A request is accepted if its Host is the server's own address, which defeats DNS rebinding, and its query contains the
token. A websocket also needs the server's own Origin, and there is one at a time.
"""

import json
import logging
import os
import secrets
import threading
from collections import deque
from contextlib import suppress
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

from mjsheaf.errors import InputError

try:
    from websockets.exceptions import ConnectionClosed
    from websockets.http11 import Request, Response
    from websockets.sync.server import ServerConnection, serve
except ImportError:
    raise InputError("mjsheaf view needs websockets, which is not installed: pip install 'mjsheaf[live]'") from None

_MOST_WAIT = 60.0  # s that a browser waits for a page
_HEADERS = {
    "Content-Type": "text/html; charset=utf-8",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


class Server:
    """Server of one page.

    A frame that is not sent when the next one arrives is dropped, so the run never waits for the browser.

    Attributes:
        token: Secret in the page's address.
        opened: True from when a page was opened for the first time.
        closed: True after the page was closed.
        page_wanted: True while a browser waits for a page.
        host: Address and port.
    """

    def __init__(self, port: int = 0) -> None:
        """Listen; port 0 takes a free one.

        Raises:
            InputError: The port is taken.
        """
        quiet = logging.getLogger("mjsheaf.live")
        quiet.setLevel(logging.CRITICAL + 1)  # a refused client is no matter of the user's
        self.token = secrets.token_urlsafe(32)
        self.opened = False
        self.closed = False
        self.page_wanted = False
        self._changed = threading.Condition()
        self._page: bytes | None = None
        self._frame: bytes | None = None
        self._state = ""
        self._actions: deque[dict[str, Any]] = deque()
        self._client: ServerConnection | None = None
        self._requested = False  # True if a page was requested since the last client left
        try:
            self._server = serve(
                self._converse,
                "127.0.0.1",
                port,
                process_request=self._answer,
                max_size=4096,  # bytes of an action
                compression=None,
                server_header=None,
                open_timeout=_MOST_WAIT,
                logger=quiet,
            )
        except OSError as error:
            reason = os.strerror(error.errno or 0)
            raise InputError(f"--port {port}: {reason}; expected a free port, or 0 for any") from None
        self.host = f"127.0.0.1:{self._server.socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        return f"http://{self.host}/?token={self.token}"

    def answer(self, page: bytes) -> None:
        """Give a page to the browser that waits for it."""
        with self._changed:
            self.page_wanted = False
            self._page = page
            self._frame = None
            self._changed.notify_all()

    def publish(self, frame: bytes) -> None:
        """Replace the newest frame."""
        with self._changed:
            self._frame = frame
            self._changed.notify_all()

    def tell(self, state: dict[str, Any]) -> None:
        """Replace the state of the run that the page shows."""
        with self._changed:
            self._state = json.dumps(state)
            self._changed.notify_all()

    def take_actions(self) -> list[dict[str, Any]]:
        """Return the actions that have arrived, in order."""
        with self._changed:
            actions = list(self._actions)
            self._actions.clear()
        return actions

    def wait(self, seconds: float) -> None:
        """Wait until there is something to do, at most for a number of seconds."""
        with self._changed:
            opened = self.opened
            self._changed.wait_for(
                lambda: self._actions or self.page_wanted or self.closed or self.opened != opened, seconds
            )

    def close(self) -> None:
        """End the connection and the server."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()
        self._server.shutdown()
        self._thread.join(5.0)

    # -- requests ------------------------------------------------------------------------------------------------------

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer a request; None accepts a websocket."""
        address = urlsplit(request.path)
        given = parse_qs(address.query).get("token", [""])
        known = len(given) == 1 and secrets.compare_digest(given[0].encode(), self.token.encode())
        hosts = request.headers.get_all("Host")
        origins = request.headers.get_all("Origin")
        if hosts != [self.host] or not known:
            return _response(connection, HTTPStatus.FORBIDDEN)
        if address.path == "/" and "Upgrade" not in request.headers:
            return _response(connection, HTTPStatus.OK, self._next_page())
        if address.path != "/live":
            return _response(connection, HTTPStatus.NOT_FOUND)
        if origins != [f"http://{self.host}"]:
            return _response(connection, HTTPStatus.FORBIDDEN)
        if self._client:
            return _response(connection, HTTPStatus.CONFLICT)
        return None

    def _next_page(self) -> bytes | None:
        """Wait for a page that includes the newest sample; return None if there is none in time."""
        with self._changed:
            self.page_wanted = True
            self._requested = True
            self._page = None
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._page is not None or self.closed, _MOST_WAIT / 2)
            return self._page

    def _converse(self, connection: ServerConnection) -> None:
        """Serve the websocket of the one client: keep its actions; what is no mapping is ignored."""
        with self._changed:
            if self._client or self.closed:
                return
            self._client = connection
            self.opened = True
            self._changed.notify_all()
        threading.Thread(target=self._send, args=(connection,), daemon=True).start()
        with suppress(ConnectionClosed):
            for message in connection:
                action: Any = None
                with suppress(ValueError, RecursionError):
                    action = json.loads(message)
                with self._changed:
                    if isinstance(action, dict) and len(self._actions) < 100:  # that wait for the run
                        self._actions.append(action)
                    self._changed.notify_all()
        # The server closes after a client has left, unless its page comes back: it may have been reloaded.
        with self._changed:
            self._client = None
            self._requested = False
            self._changed.notify_all()
            # A page that does not come back is closed; a reload takes less than two seconds.
            self._changed.wait_for(lambda: self._client or self.closed or self._requested, 2.0)
            if self._requested:
                self._changed.wait_for(lambda: self._client or self.closed, _MOST_WAIT)
            self.closed = self.closed or self._client is None
            self._changed.notify_all()

    def _send(self, connection: ServerConnection) -> None:
        """Send the newest state and frame whenever they change, until the client is not the present one any more."""
        frame: bytes | None = None
        state = ""

        def is_over() -> bool:
            return self.closed or self._client is not connection

        with suppress(ConnectionClosed):
            while not is_over():
                with self._changed:
                    while not is_over() and self._frame is frame and self._state == state:
                        self._changed.wait()
                    news = self._frame, self._state
                if news[0] is not None and news[0] is not frame:
                    connection.send(news[0])
                if news[1] != state:
                    connection.send(news[1])
                frame, state = news
            connection.close()


def _response(connection: ServerConnection, status: HTTPStatus, page: bytes | None = None) -> Response:
    if status is HTTPStatus.OK and page is None:
        status = HTTPStatus.SERVICE_UNAVAILABLE
    response = connection.respond(status, f"{status.phrase}\n")
    if page is not None:
        response.body = page
        del response.headers["Content-Length"]
        del response.headers["Content-Type"]
        response.headers["Content-Length"] = str(len(page))
        response.headers.update(_HEADERS)
    return response
