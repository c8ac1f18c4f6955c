"""
Under ArduPilot
===============

Two copters and a boat of one scenario, each with its own autopilot. `ArduPilot's JSON interface
<https://github.com/ArduPilot/ardupilot/tree/master/libraries/SITL/examples/JSON>`_ sends the PWM of 16 or 32 outputs in
a UDP datagram and waits for the state of the vehicle. ``Bridge`` replies to it. Once every autopilot has sent its next
frame, on loopback, it advances the whole team by one control period. A frame that arrives twice gets the same reply, so
the result does not depend on lost, repeated or delayed datagrams.

If ArduPilot is not installed, ``StandIn`` takes its place, as below. For ArduPilot itself, start
``Bridge(scenario).serve(3600.0)``, and for vehicle k ``sim_vehicle.py -v ArduCopter -I k --model JSON:127.0.0.1``, or
``-v Rover``: instance k sends to port 9002 + 10 k. Set ``MOT_THST_EXPO`` to 0, because thrust is proportional to PWM
here. For the boat, set ``SERVO1_FUNCTION`` to 73 and ``SERVO3_FUNCTION`` to 74, its propellers. An autopilot takes a
minute to start, so a copter rests on a stand at its initial position until its rotors first lift it. There is no ground
to land on.
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
FIRST = 100  # frames: an autopilot that has just started counts less, and no network delays a frame for longer
TO_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # from east, north, up
TO_FRD = np.diag([1.0, -1.0, -1.0])  # from forward, left, up
SCENARIO = {
    "name": "autopilots",
    "time": {"end": 9},
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
    """Return thrusts, N, of the propellers on the left and on the right, outputs 1 and 3; 0 is that of no pulse."""
    pwm = np.where(pwm[[0, 2]] == 0.0, 1500.0, pwm[[0, 2]])
    share = np.clip((pwm - 1500.0) / 500.0, -1.0, 1.0)
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
        self.period = scenario.controller.control_period
        self.vehicles = scenario.whole.vehicles[: len(scenario.agents)]
        data = self.session.engine.data  # MuJoCo's: positions with quaternions, velocities with those in body axes
        self.poses, self.rates = data.qpos.reshape(-1, 7), data.qvel.reshape(-1, 6)
        self.sockets, self.ports = [], []
        for k, agent in enumerate(scenario.agents):
            own, port = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), first_port + 10 * k if first_port else 0
            self.sockets.append(own)
            try:
                own.bind(("127.0.0.1", port))
            except OSError as error:
                self.close()
                raise OSError(f"port {port} on 127.0.0.1, that of {agent.id}: {error.strerror}") from None
            self.ports.append(own.getsockname()[1])
        none = [None] * len(self.sockets)
        self.counts, self.peers, self.answers, self.waiting = list(none), list(none), list(none), {}
        self.begin()

    def begin(self):
        """Go back to the start, copters on their stands."""
        self.session.reset()
        self.stands = {k: self.poses[k].copy() for k, own in enumerate(self.vehicles) if own.dimension == 3}
        self.track, self.velocity = [], self.rates[: len(self.vehicles), :3].copy()

    def serve(self, end, patience=30.0):
        """Serve until `end`, s; raise a TimeoutError if an autopilot sends no new frame for `patience` seconds.

        Their first ones may take ten times as long: autopilots are started one by one.
        """
        latest = time.monotonic() + 10.0 * patience
        while self.session.time < end - 0.5 * PERIOD:
            ready, _, _ = select.select(self.sockets, [], [], max(latest - time.monotonic(), 0.0))
            if time.monotonic() > latest:
                silent = [agent.id for k, agent in enumerate(self.session.scenario.agents) if k not in self.waiting]
                raise TimeoutError(f"no new frame within {patience:g} s from the autopilots of {', '.join(silent)}")
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
        if self.peers[k] is None:
            self.peers[k] = peer  # it may count from anywhere
        elif count < FIRST and (peer != self.peers[k] or self.counts[k] >= 2 * FIRST):
            self.begin()  # it was started anew; what others wait for stays
            self.peers[k], self.counts[k], self.answers[k] = peer, None, None
        elif peer != self.peers[k]:
            return  # one on the wrong port
        ahead = 1 if self.counts[k] is None else (count - self.counts[k]) % 2**32
        if ahead == 0 and self.answers[k]:
            self.sockets[k].sendto(self.answers[k], peer)
        elif 0 < ahead < 2**31:  # else an old one that was delayed
            self.counts[k], self.answers[k] = count, None
            self.waiting[k] = np.array(struct.unpack_from(f"<{OUTPUTS[magic]}H", frame, 8), dtype=float)

    def step(self):
        """Take one control period with the frames of all, and answer them."""
        commands = []
        for k, vehicle in enumerate(self.vehicles):
            thrusts = (boat_commands if vehicle.dimension == 2 else copter_commands)(vehicle, self.waiting[k])
            commands.append(np.clip(thrusts, *vehicle.limits.T))
            if k in self.stands and commands[k].sum() > vehicle.mass * GRAVITY:
                del self.stands[k]
        self.waiting = {}
        self.session.step(np.concatenate(commands))
        for k, stand in self.stands.items():
            self.poses[k], self.rates[k] = stand, 0.0
        poses, rates = self.poses[: len(self.vehicles)], self.rates[: len(self.vehicles)]
        felt = (rates[:, :3] - self.velocity) / self.period + [0.0, 0.0, GRAVITY]  # by an accelerometer
        self.track.append(poses[:, :3].copy())
        self.velocity = rates[:, :3].copy()
        R = Rotation.from_quat(poses[:, 3:], scalar_first=True).as_matrix()  # body to world
        quaternions = Rotation.from_matrix(TO_NED @ R @ TO_FRD).as_quat(scalar_first=True)
        for k, own in enumerate(self.sockets):
            state = {
                "timestamp": self.session.time,
                "imu": {"gyro": (TO_FRD @ rates[k, 3:]).tolist(), "accel_body": (TO_FRD @ R[k].T @ felt[k]).tolist()},
                "position": (TO_NED @ poses[k, :3]).tolist(),
                "velocity": (TO_NED @ rates[k, :3]).tolist(),
                "quaternion": quaternions[k].tolist(),
            }
            # Without spaces: ArduPilot's parser looks for [ right behind the colon.
            self.answers[k] = f"\n{json.dumps(state, separators=(',', ':'))}\n".encode()
            own.sendto(self.answers[k], self.peers[k])

    def close(self):
        for own in self.sockets:
            own.close()


class StandIn(threading.Thread):
    """An autopilot with ArduPilot's JSON interface, which brings its vehicle to a place, (north, east, down) m.

    It repeats a frame until it receives a reply, sooner than ArduPilot, which waits ten seconds.
    """

    def __init__(self, port, place, end, copter=True):
        super().__init__(daemon=True)
        self.peer, self.place, self.end, self.copter = ("127.0.0.1", port), np.array(place), end, copter

    def run(self):
        pwm, count, now = np.zeros(16, int), 0, 0.0  # an autopilot that starts drives no output
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.settimeout(0.05)
            while now < self.end - 0.5 * PERIOD:
                frame = struct.pack("<HHI16H", 18458, round(1 / PERIOD), count, *pwm.tolist())
                count += 1
                state = None
                # An answer may come twice. One that is much older is of a run that began anew.
                while state is None or now - 10 * PERIOD < state["timestamp"] <= now:
                    own.sendto(frame, self.peer)
                    try:
                        state = json.loads(own.recv(4096))
                    except TimeoutError:
                        continue
                now = state["timestamp"]
                pwm = self.fly(state) if self.copter else self.sail(state)

    def fly(self, state):
        """Return the outputs of a copter: thrust and lean for a velocity to the place."""
        R, yaw = matrix(state["quaternion"])
        wanted = np.clip(0.6 * (self.place - state["position"]), -2.0, 2.0)
        pull = np.clip(1.5 * (wanted - state["velocity"]), -4.0, 4.0) - [0.0, 0.0, GRAVITY]  # m/s^2
        forward, right, down = pull @ R
        turn = 20.0 * np.array([-right / down, forward / down, -0.1 * yaw])  # about x, y and z
        turn -= np.array([6.0, 6.0, 3.0]) * state["imu"]["gyro"]
        mixed = MIXER @ (turn * [0.008, 0.008, 0.03])
        pwm = np.full(16, 1000)
        pwm[:4] = np.clip(1000.0 + 1000.0 * (-down * 2.28 / 4.0 / 12.13 + mixed), 1000.0, 2000.0).round()
        return pwm

    def sail(self, state):
        """Return the outputs of a boat that turns to the place and goes there."""
        north, east, _ = self.place - state["position"]
        yaw = matrix(state["quaternion"])[1]
        off = np.angle(np.exp(1j * (np.arctan2(east, north) - yaw)))
        ahead = min(0.2 * np.hypot(north, east), 0.8) * max(np.cos(off), 0.0)
        turn = np.clip(0.4 * off - 0.4 * state["imu"]["gyro"][2], -0.3, 0.3) * (np.hypot(north, east) > 1.0)
        pwm = np.full(16, 1500)
        pwm[[0, 2]] = 1500 + np.round(500 * np.clip([ahead + turn, ahead - turn], -1.0, 1.0))
        return pwm


MIXER = np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1]])  # of turns about x, y and z to the rotors


def matrix(quaternion):
    """Return the rotation (3, 3) of a quaternion (w, x, y, z), and its yaw, rad."""
    w, x, y, z = quaternion
    R = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(R), np.arctan2(R[1][0], R[0][0])


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
        axes.plot(*track[0, k, :2], "o", color=line.get_color(), fillstyle="none", label="begin" if k == 2 else None)
        axes.plot(*track[-1, k, :2], "o", color=line.get_color(), label="end" if k == 2 else None)
        axes.plot(PLACES[k][1], PLACES[k][0], "x", color="black", label="wanted" if k == 2 else None)
        apart = np.linalg.norm(TO_NED @ track[-1, k] - PLACES[k])
        print(f"{agent['id']} ends {apart:.2f} m from where its autopilot was to bring it")
        assert apart < 1.5
    axes.set(title="each under an autopilot of its own", xlabel="east (m)", ylabel="north (m)", aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
