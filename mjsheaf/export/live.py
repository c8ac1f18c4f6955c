"""Sink that shows a run in Foxglove while it is simulated: the messages of an MCAP file, on a loopback websocket."""

import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from threading import Thread
from typing import Any

import foxglove
import xarray as xr
from foxglove.websocket import WebSocketServer
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log as LogMessage
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap_protobuf.schema import build_file_descriptor_set

from mjsheaf.errors import InputError
from mjsheaf.export import mcap
from mjsheaf.export.log import Moment
from mjsheaf.live import PORT
from mjsheaf.loop.system import Phase
from mjsheaf.scenario import Scenario


class Log(mcap.Log):
    """Sink that serves a run.

    Attributes:
        pace: Simulated seconds per second that the run may take at most; infinite where others pace it.
    """

    def __init__(
        self, path: Path, scenario: Scenario, phases: Sequence[Phase], attachment: Path, pace: float = 1.0
    ) -> None:
        """Serve from the first sample on; nothing is written to `path`, the null device."""
        super().__init__(path, scenario, phases, attachment)
        self.pace = pace
        self._server: WebSocketServer | None = None
        self._sent = 0  # time of the last sample that was sent, ns
        self._begun = math.nan  # when one at time 0 would have been sent, s
        self._shown = -math.inf  # when vehicles were, s

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Begin to serve.

        Raises:
            InputError: The port is taken.
        """
        super().open(variables, attrs)
        kinds: dict[str, Any] = {
            "/tf": FrameTransforms,
            "/vehicles": SceneUpdate,
            "/scene": SceneUpdate,
            "/log": LogMessage,
            **{f"/{topic}": kind for topic, kind in self._kinds.items()},
        }
        self._context = context = foxglove.Context()  # which does not outlive its last reference
        # Before the server, because a client that connects while a channel is added may not receive it.
        self._channels = {
            topic: foxglove.Channel(
                topic,
                schema=foxglove.Schema(
                    name=kind.DESCRIPTOR.full_name,
                    encoding="protobuf",
                    data=build_file_descriptor_set(kind).SerializeToString(),
                ),
                message_encoding="protobuf",
                context=context,
            )
            for topic, kind in kinds.items()
        }
        try:
            self._server = foxglove.start_server(name=self.scenario.name, host="127.0.0.1", port=PORT, context=context)
        except RuntimeError as error:
            raise InputError(f"--live: port {PORT} on 127.0.0.1: {error}; expected that nothing else uses it") from None

    def write_moment(self, moment: Moment) -> None:
        """Send a sample when its time has come, in each phase at most one in 0.03 s of simulated time."""
        if math.isnan(self._begun):
            self._begun = time.monotonic() - moment.time / 1e9 / self.pace
        elif moment.phase == self._phase and moment.time - self._sent < 3e7:
            return
        time.sleep(max(0.0, self._begun + moment.time / 1e9 / self.pace - time.monotonic()))
        if time.monotonic() - self._shown >= 1.0:  # again for those who have come since
            self._shown = time.monotonic()
            self.write_vehicles()
        self._sent = moment.time
        super().write_moment(moment)

    def _send(self, topic: str, message: Any) -> None:
        self._channels[topic].log(message.SerializeToString(), log_time=self.last)

    def finish(self) -> None:
        """Write no index."""

    def close(self) -> None:
        """Say how the run ended, and serve no more."""
        try:
            super().close()
        finally:
            if self._server is not None:
                # It waits for a client that has connected and says nothing, as browsers do ahead of need: for ever.
                stopping = Thread(target=self._server.stop, daemon=True)
                stopping.start()
                stopping.join(1.0)
