"""
Under ArduPilot
===============

Two copters and a boat of one scenario under autopilots of their own. `ArduPilot's JSON interface
<https://github.com/ArduPilot/ardupilot/tree/master/libraries/SITL/examples/JSON>`_ sends the PWM of 16 or 32 outputs in
a UDP datagram and waits for the state of the vehicle. ``Bridge`` answers it: it takes one control period of the whole
team once every autopilot has sent its next frame, on loopback. A frame that comes twice gets the same answer, so
nothing depends on what the network loses, repeats or delays.

For ArduPilot itself, start ``Bridge(scenario).serve(3600.0)``, and for vehicle k
``sim_vehicle.py -v ArduCopter -I k --model JSON:127.0.0.1``, or ``-v Rover``: instance k sends to port 9002 + 10 k. Set
``MOT_THST_EXPO`` to 0, as thrust is proportional to PWM here, and of the boat ``SERVO1_FUNCTION`` to 73 and
``SERVO3_FUNCTION`` to 74, its propellers. Where ArduPilot is not installed, ``StandIn`` speaks its part, as below.
"""

import json
import select
import socket
import struct
import threading
import time

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import mjsheaf

PERIOD, GRAVITY = 0.0025, 9.81  # s, that of ArduCopter's loop; m/s^2
OUTPUTS = {18458: 16, 29569: 32}  # by the number that a frame begins with
TO_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # from east, north, up
TO_FRD = np.diag([1.0, -1.0, -1.0])  # from forward, left, up
SCENARIO = {
    "name": "autopilots",
    "time": {"end": 15},
    "controller": {"gain": 1, "control_period": PERIOD},
    "physics": {"timestep": PERIOD},
    "agents": [
        {"id": "D1", "position": [-3, 0, 10], "vehicle": "x500"},
        {"id": "D2", "position": [3, 0, 10], "vehicle": "x500"},
        {"id": "B1", "position": [0, -5], "heading": 60, "vehicle": "otter"},
    ],
    "communication": [["D1", "D2"], ["D1", "B1"]],
}


def copter_commands(vehicle, pwm):
    """Return thrusts, N: an X500 has its rotors in the order of ArduPilot's quad X."""
    return np.clip((pwm[:4] - 1000.0) / 1000.0, 0.0, 1.0) * vehicle.limits[:, 1]


def boat_commands(vehicle, pwm):
    """Return thrusts, N, of the propellers on the left and on the right, outputs 1 and 3."""
    share = np.clip((pwm[[0, 2]] - 1500.0) / 500.0, -1.0, 1.0)
    return np.where(share < 0.0, -share * vehicle.limits[:, 0], share * vehicle.limits[:, 1])


class Bridge:
    """A scenario whose vehicles are commanded by autopilots over UDP, in lockstep.

    Attributes:
        ports: Port of each agent, on loopback.
        track: Position of each agent's body at every period, m.
    """

    def __init__(self, scenario, first_port=9002):
        """Listen on first_port + 10 k for agent k; on ports that are free if first_port is 0."""
        self.session = mjsheaf.Session(scenario, commanded="thrust")
        self.vehicles = scenario.whole.vehicles
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in scenario.agents]
        for k, own in enumerate(self.sockets):
            own.bind(("127.0.0.1", first_port + 10 * k if first_port else 0))
        self.ports = [own.getsockname()[1] for own in self.sockets]
        self.begin()

    def begin(self):
        """Go back to the start; autopilots count from anywhere."""
        self.session.reset()
        none = [None] * len(self.sockets)
        self.counts, self.peers, self.answers, self.waiting = list(none), list(none), list(none), {}
        self.track, self.velocity = [], self.session.observe().velocity

    def serve(self, end, patience=30.0):
        """Serve until `end`, s; raise a TimeoutError if an autopilot sends no new frame for `patience` seconds."""
        latest = time.monotonic() + patience
        while self.session.time < end - 0.5 * PERIOD:
            ready, _, _ = select.select(self.sockets, [], [], max(latest - time.monotonic(), 0.0))
            if time.monotonic() > latest:
                silent = [agent.id for k, agent in enumerate(self.session.scenario.agents) if k not in self.waiting]
                raise TimeoutError(f"no new frame for {patience:g} s from the autopilots of {', '.join(silent)}")
            for own in ready:
                self.receive(self.sockets.index(own), *own.recvfrom(256))
            if len(self.waiting) == len(self.sockets):
                self.step()
                latest = time.monotonic() + patience

    def receive(self, k, frame, peer):
        """Take a frame of autopilot k: a new one waits for the others', one that was answered is answered again."""
        magic, _rate, count = struct.unpack_from("<HHI", frame) if len(frame) >= 8 else (0, 0, 0)
        if len(frame) != 8 + 2 * OUTPUTS.get(magic, -5):
            return  # not from ArduPilot
        if self.peers[k] not in (None, peer):
            self.begin()  # an autopilot was started anew
        self.peers[k] = peer
        ahead = 1 if self.counts[k] is None else (count - self.counts[k]) % 2**32
        if ahead == 0 and self.answers[k]:
            self.sockets[k].sendto(self.answers[k], peer)
        elif 0 < ahead < 2**31:  # else an old one that was delayed
            self.counts[k], self.answers[k] = count, None
            self.waiting[k] = np.array(struct.unpack_from(f"<{OUTPUTS[magic]}H", frame, 8), dtype=float)

    def step(self):
        """Take one control period with the frames of all, and answer them."""
        commands = []
        for k, vehicle in enumerate(self.vehicles[: len(self.sockets)]):
            commands.append((boat_commands if vehicle.dimension == 2 else copter_commands)(vehicle, self.waiting[k]))
        self.waiting = {}
        self.session.step(np.clip(np.concatenate(commands), *np.hstack([v.limits.T for v in self.vehicles])))
        sample = self.session.observe()
        acceleration = (sample.velocity - self.velocity) / PERIOD + [0.0, 0.0, GRAVITY]  # what an accelerometer feels
        self.velocity = sample.velocity.copy()
        R = Rotation.from_quat(sample.attitude, scalar_first=True).as_matrix()  # body to world
        hands = np.array([vehicle.steering.hand for vehicle in self.vehicles])
        body = sample.truth.positions - hands[:, None] * R[:, :, 0]  # a boat is steered at a point ahead of it
        self.track.append(body)
        for k, own in enumerate(self.sockets):
            state = {
                "timestamp": self.session.time,
                "imu": {
                    "gyro": (TO_FRD @ sample.angular_velocity[k]).tolist(),
                    "accel_body": (TO_FRD @ R[k].T @ acceleration[k]).tolist(),
                },
                "position": (TO_NED @ body[k]).tolist(),
                "velocity": (TO_NED @ sample.velocity[k]).tolist(),
                "quaternion": Rotation.from_matrix(TO_NED @ R[k] @ TO_FRD).as_quat(scalar_first=True).tolist(),
            }
            self.answers[k] = f"\n{json.dumps(state)}\n".encode()
            own.sendto(self.answers[k], self.peers[k])

    def close(self):
        for own in self.sockets:
            own.close()


class StandIn(threading.Thread):
    """An autopilot that speaks as ArduPilot does, and brings its vehicle to a place, (north, east, down) m.

    It sends a frame again until it is answered, sooner than ArduPilot, which waits ten seconds.
    """

    def __init__(self, port, place, end, copter=True):
        super().__init__(daemon=True)
        self.peer, self.place, self.end, self.copter = ("127.0.0.1", port), np.array(place), end, copter

    def run(self):
        pwm, count, now = np.full(16, 1500), 0, 0.0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.settimeout(0.05)
            while now < self.end - 0.5 * PERIOD:
                count += 1
                frame = struct.pack("<HHI16H", 18458, round(1 / PERIOD), count, *pwm)
                state = None
                while state is None or state["timestamp"] <= now:  # an answer may come twice
                    own.sendto(frame, self.peer)
                    try:
                        state = json.loads(own.recv(4096))
                    except TimeoutError:
                        continue
                now = state["timestamp"]
                pwm = self.fly(state) if self.copter else self.sail(state)

    def fly(self, state):
        away, velocity = self.place - state["position"], np.array(state["velocity"])
        R = Rotation.from_quat(state["quaternion"], scalar_first=True)
        wanted = np.clip(0.6 * away, -2.0, 2.0)
        pull = np.clip(1.5 * (wanted - velocity), -4.0, 4.0) - [0.0, 0.0, GRAVITY]  # m/s^2, north, east, down
        forward, right, down = R.inv().apply(pull)
        lean = np.array([-right, forward]) / down  # of the thrust, about x and y
        turn = np.append(20.0 * lean, -2.0 * R.as_euler("ZYX")[0]) - [6.0, 6.0, 3.0] * np.array(state["imu"]["gyro"])
        mixed = np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1]]) @ (turn * [0.008, 0.008, 0.03])
        pwm = np.full(16, 1000)
        pwm[:4] = np.clip(1000.0 + 1000.0 * (-down * 2.28 / 4.0 / 12.13 + mixed), 1000.0, 2000.0).round()
        return pwm

    def sail(self, state):
        north, east, _ = self.place - state["position"]
        yaw = Rotation.from_quat(state["quaternion"], scalar_first=True).as_euler("ZYX")[0]
        off = np.angle(np.exp(1j * (np.arctan2(east, north) - yaw)))
        ahead = min(0.12 * np.hypot(north, east), 0.6) * max(np.cos(off), 0.0)
        turn = np.clip(0.4 * off - 0.4 * state["imu"]["gyro"][2], -0.3, 0.3) * (np.hypot(north, east) > 1.0)
        pwm = np.full(16, 1500)
        pwm[[0, 2]] = 1500 + np.round(500 * np.clip([ahead + turn, ahead - turn], -1.0, 1.0))
        return pwm


PLACES = [(4.0, -4.0, -12.0), (4.0, 4.0, -12.0), (-1.0, 1.2, 0.0)]  # where the autopilots go: north, east, down, m


def flight(end, network=lambda ports: ports):
    """Return the track (T, N, 3), m, of a flight under autopilots that reach the bridge's ports through a network."""
    bridge = Bridge(mjsheaf.load_scenario(SCENARIO), first_port=0)
    for k, port in enumerate(network(bridge.ports)):
        StandIn(port, PLACES[k], end, copter=k < 2).start()
    try:
        bridge.serve(end)
        return np.array(bridge.track)
    finally:
        bridge.close()


if __name__ == "__main__":
    track = flight(SCENARIO["time"]["end"])
    figure, axes = plt.subplots(figsize=(5, 4), layout="constrained")
    for k, agent in enumerate(SCENARIO["agents"]):
        (line,) = axes.plot(track[:, k, 0], track[:, k, 1], label=f"{agent['id']}, {agent['vehicle']}")
        axes.plot(*track[-1, k, :2], "o", color=line.get_color())
        axes.plot(PLACES[k][1], PLACES[k][0], "x", color="black", label="wanted" if k == 2 else None)
        apart = np.linalg.norm(TO_NED @ track[-1, k] - PLACES[k])
        print(f"{agent['id']} ends {apart:.2f} m from where its autopilot was to bring it")
        assert apart < 1.5
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
    axes.legend(loc="lower left")
