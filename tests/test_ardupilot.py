"""The example's bridge to ArduPilot: the published fields of packets, and a network that loses and repeats them."""

import json
import re
import runpy
import select
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

import mjsheaf
from mjsheaf.arrays import Array
from tests.builders import REPOSITORY

EXAMPLE = runpy.run_path(str(REPOSITORY / "examples" / "20_ardupilot.py"))
DURATION = 0.25  # s


def relay(port: int, seed: int) -> int:
    """Return a port from which datagrams go to another and back, lost, repeated and late ones among them."""
    rng = np.random.default_rng(seed)
    near, far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    near.bind(("127.0.0.1", 0))
    far.bind(("127.0.0.1", 0))

    def run() -> None:
        client: Any = None
        late: list[tuple[socket.socket, bytes, Any]] = []
        while True:
            ready = select.select([near, far], [], [], 5.0)[0]
            if not ready:
                return
            for own in ready:
                data, peer = own.recvfrom(4096)
                client = peer if own is near else client
                out: tuple[socket.socket, bytes, Any] = (
                    (far, data, ("127.0.0.1", port)) if own is near else (near, data, client)
                )
                for to, what, where in late:
                    to.sendto(what, where)
                late.clear()
                chance = rng.random()
                if chance > 0.1:  # else it is lost
                    out[0].sendto(out[1], out[2])
                if chance > 0.8:  # repeated at once, or later
                    out[0].sendto(out[1], out[2])
                elif chance > 0.6:
                    late.append(out)

    threading.Thread(target=run, daemon=True).start()
    return int(near.getsockname()[1])


def test_what_the_network_loses_repeats_and_delays_changes_no_bit() -> None:
    flight: Callable[..., Array] = EXAMPLE["flight"]
    plain = flight(DURATION)
    assert plain.shape == (round(DURATION / EXAMPLE["PERIOD"]), 3, 3)
    bad = flight(DURATION, lambda ports: [relay(port, seed) for seed, port in enumerate(ports)])
    np.testing.assert_array_equal(bad, plain)


@pytest.fixture
def bridge() -> Iterator[Any]:
    made = EXAMPLE["Bridge"](mjsheaf.load_scenario(EXAMPLE["SCENARIO"]), first_port=0)
    yield made
    made.close()


class Autopilots:
    """Sockets that send frames by hand, one for each vehicle."""

    def __init__(self, bridge: Any) -> None:
        self.bridge = bridge
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in bridge.ports]
        for own in self.sockets:
            own.bind(("127.0.0.1", 0))
            own.settimeout(2.0)

    def send(self, k: int, frame: bytes) -> None:
        self.sockets[k].sendto(frame, ("127.0.0.1", self.bridge.ports[k]))
        self.bridge.receive(k, *self.bridge.sockets[k].recvfrom(256))

    def answer(self, k: int) -> bytes:
        return self.sockets[k].recv(4096)

    def period(self, *frames: bytes) -> list[bytes]:
        """Send a frame for each vehicle, and return the answers after a period."""
        for k, frame in enumerate(frames):
            self.send(k, frame)
        self.bridge.step()
        return [self.answer(k) for k in range(3)]


def parsed(text: str, section: str, key: str, numbers: int) -> list[float]:
    """Return what ArduPilot's parser reads (SIM_JSON.cpp, parse_sensors): it skips a fixed number of characters.

    After the key those are its closing quote and a colon; then sscanf expects the bracket at once.
    """
    begin = text.index(section) + len(section) + 1
    begin = text.index(key, begin) + len(key) + 2
    number = r"\s*([-+0-9.e]+)"
    pattern = number if numbers == 1 else r"\[" + ",".join([number] * numbers) + r"\]"
    match = re.match(pattern, text[begin:])
    assert match, f"{section}/{key} cannot be read: {text[begin : begin + 40]!r}"
    return [float(value) for value in match.groups()]


def frame_of(count: int, pwm: int = 1500, outputs: int = 16, **others: int) -> bytes:
    """A frame in which all outputs have the same pulse, but for some by their numbers, such as `o2`."""
    pulses = [others.get(f"o{k}", pwm) for k in range(outputs)]
    magic = {16: 18458, 32: 29569}[outputs]
    return struct.pack(f"<HHI{outputs}H", magic, 400, count, *pulses)


def test_answers_have_the_published_fields_in_their_frames(bridge: Any) -> None:
    """Level; drones point east, a yaw of 90 degrees, and the boat 60 degrees to the left of that."""
    pilots = Autopilots(bridge)
    texts = pilots.period(frame_of(1, 1000), frame_of(1, 1000, outputs=32), frame_of(1))
    for k, place in enumerate(([-3.0, 0.0, 10.0], [3.0, 0.0, 10.0], [0.0, -5.0, 0.0])):
        text = texts[k]
        assert text[:1] == text[-1:] == b"\n"
        state = json.loads(text)
        assert set(state) == {"timestamp", "imu", "position", "velocity", "quaternion"}
        assert set(state["imu"]) == {"gyro", "accel_body"}
        assert state["timestamp"] == pytest.approx(EXAMPLE["PERIOD"])
        assert parsed(text.decode(), "", "timestamp", 1) == [state["timestamp"]]
        for section, key, numbers in (
            *(("imu", "gyro", 3), ("imu", "accel_body", 3)),
            *(("", "position", 3), ("", "velocity", 3), ("", "quaternion", 4)),
        ):
            assert parsed(text.decode(), section, key, numbers) == (state[section] if section else state)[key]
        bearing = np.deg2rad(0.0 if k < 2 else 60.0)  # from east to the left
        hand = 0.0 if k < 2 else 1.0  # a scenario has a boat's position at a point ahead of its body
        east, north, up = place - hand * np.array([np.cos(bearing), np.sin(bearing), 0.0])
        np.testing.assert_allclose(state["position"], [north, east, -up], atol=2e-2)
        half = 0.5 * (0.5 * np.pi - bearing)
        np.testing.assert_allclose(np.abs(state["quaternion"]), [np.cos(half), 0.0, 0.0, np.sin(half)], atol=1e-2)


def test_thrust_is_felt_up_and_a_turn_to_the_right_is_positive(bridge: Any) -> None:
    """With more thrust of the rotors on its left, a copter rolls to the right."""
    pilots, answers = Autopilots(bridge), []
    for count in range(1, 41):
        rolling = frame_of(count, o0=1400, o1=1600, o2=1600, o3=1400)
        answers = pilots.period(rolling, frame_of(count), frame_of(count, o0=1700, o2=1300))
    copter, other, boat = (json.loads(answer)["imu"] for answer in answers)
    assert copter["gyro"][0] > 0.1
    assert other["accel_body"][2] < -5.0  # down is positive: it is pushed up
    assert abs(other["gyro"][0]) < 1e-9
    assert boat["gyro"][2] > 0.0


def test_each_frame_counts_once_and_what_is_none_not_at_all(bridge: Any) -> None:
    pilots = Autopilots(bridge)
    for junk in (b"", b"junk", struct.pack("<HHI16H", 1, 400, 1, *[1500] * 16), frame_of(1)[:-2]):
        pilots.send(0, junk)
    assert not bridge.waiting
    first = pilots.period(*[frame_of(7)] * 3)
    pilots.send(1, frame_of(7, 1900))  # its answer was lost
    assert pilots.answer(1) == first[1]
    pilots.send(1, frame_of(6, 1900))  # it was delayed
    assert not bridge.waiting
    pilots.send(1, frame_of(2**32 - 1, 1900))  # as seen from 7, before it
    assert not bridge.waiting
    pilots.send(1, frame_of(8))
    assert list(bridge.waiting) == [1]
    assert len(bridge.track) == 1


def test_an_autopilot_that_starts_anew_starts_the_run_anew(bridge: Any) -> None:
    """From another port, or from its old one with a count that goes back; what others wait for stays."""
    pilots, others = Autopilots(bridge), Autopilots(bridge)
    for count in (400, 401):
        pilots.period(*[frame_of(count)] * 3)
    pilots.send(1, frame_of(402))
    others.send(0, frame_of(0))
    assert bridge.session.time == 0.0
    assert set(bridge.waiting) == {0, 1}
    pilots.send(0, frame_of(402))  # the old one is still there
    others.send(2, frame_of(402))  # one on the wrong port
    assert set(bridge.waiting) == {0, 1}
    pilots.send(2, frame_of(402))
    bridge.step()
    assert json.loads(others.answer(0))["timestamp"] == pytest.approx(EXAMPLE["PERIOD"])
    pilots.send(1, frame_of(0))  # as before, from its own port
    assert bridge.session.time == 0.0
    assert bridge.waiting.keys() == {1}


def test_copters_stand_until_their_rotors_carry_them(bridge: Any) -> None:
    """An autopilot that starts drives no output, 0, for a minute. A boat without a pulse goes nowhere."""
    pilots = Autopilots(bridge)
    begin = [body.copy() for body in (bridge.poses[0], bridge.poses[1])]
    state: dict[str, Any] = {}
    for count in range(121):
        rising = frame_of(count, 0 if count < 20 else 1900)
        state = json.loads(pilots.period(frame_of(count, 0), rising, frame_of(count, 0))[0])
    np.testing.assert_array_equal(bridge.poses[0], begin[0])
    assert state["velocity"] == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(state["imu"]["accel_body"], [0.0, 0.0, -9.81], atol=1e-12)
    assert bridge.poses[1][2] > begin[1][2] + 0.01
    np.testing.assert_allclose(np.ptp(np.array(bridge.track)[:, 2, :2], axis=0), 0.0, atol=0.01)  # it settles


def test_velocity_and_acceleration_are_those_of_the_position(bridge: Any) -> None:
    """Of a boat that turns, too: it is steered at a point ahead of the body whose position is told."""
    pilots, states = Autopilots(bridge), []
    for count in range(201):
        frames = [frame_of(count), frame_of(count), frame_of(count, o0=1900, o2=1600)]
        states.append([json.loads(answer) for answer in pilots.period(*frames)])
    for k in range(3):
        position, velocity = (np.array([state[k][key] for state in states]) for key in ("position", "velocity"))
        moved = np.diff(position, axis=0) / EXAMPLE["PERIOD"]
        np.testing.assert_allclose(0.5 * (velocity[1:] + velocity[:-1])[100:, :2], moved[100:, :2], atol=2e-3)
    assert np.linalg.norm(velocity[-1]) > 0.05


def test_a_port_in_use_is_named() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port} on 127.0.0.1, that of D1: Address already in use"):
            EXAMPLE["Bridge"](mjsheaf.load_scenario(EXAMPLE["SCENARIO"]), first_port=port)


def test_a_silent_autopilot_is_named(bridge: Any) -> None:
    Autopilots(bridge).send(0, frame_of(1))
    with pytest.raises(TimeoutError, match="D2, B1"):
        bridge.serve(1.0, patience=0.05)
