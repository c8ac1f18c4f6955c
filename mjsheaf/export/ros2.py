"""Sink that writes a bag of ROS 2: messages in CDR in one MCAP file, and metadata.yaml. Equal runs give equal bytes."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

from mjsheaf.arrays import Array
from mjsheaf.export.log import ARROW, HALF_OPEN, PALETTE, TOPICS, WORLD, LogSink, Moment
from mjsheaf.loop.system import Phase
from mjsheaf.results.store import BAG
from mjsheaf.scenario import Scenario

_STORE = get_typestore(Stores.ROS2_JAZZY)
_SHORT = {
    "tf": "tf2_msgs/msg/TFMessage",
    "markers": "visualization_msgs/msg/MarkerArray",
    "marker": "visualization_msgs/msg/Marker",
    "log": "rcl_interfaces/msg/Log",
    "values": "std_msgs/msg/Float64MultiArray",
    "layout": "std_msgs/msg/MultiArrayLayout",
    "dimension": "std_msgs/msg/MultiArrayDimension",
    "header": "std_msgs/msg/Header",
    "colour": "std_msgs/msg/ColorRGBA",
    "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
    "stamped": "geometry_msgs/msg/TransformStamped",
    "transform": "geometry_msgs/msg/Transform",
    "vector": "geometry_msgs/msg/Vector3",
    "point": "geometry_msgs/msg/Point",
    "quaternion": "geometry_msgs/msg/Quaternion",
    "pose": "geometry_msgs/msg/Pose",
    "image": "sensor_msgs/msg/CompressedImage",
    "mesh": "visualization_msgs/msg/MeshFile",
}
_Type: dict[str, Any] = {short: _STORE.types[name] for short, name in _SHORT.items()}
_MARKER = _Type["marker"]
_SHAPES = {
    "sphere": _MARKER.SPHERE,
    "box": _MARKER.CUBE,
    "cylinder": _MARKER.CYLINDER,
    "triangles": _MARKER.TRIANGLE_LIST,
}
_DEFAULT_TIME = {"sec": 0, "nsec": 0}
_LATCHED = {
    "history": "keep_last",
    "depth": 1,
    "reliability": "reliable",
    "durability": "transient_local",
    "deadline": _DEFAULT_TIME,
    "lifespan": _DEFAULT_TIME,
    "liveliness": "automatic",
    "liveliness_lease_duration": _DEFAULT_TIME,
    "avoid_ros_namespace_conventions": False,
}
"""Quality of service of messages that a subscriber gets although it comes later."""
_NO_POINTS: Array = np.zeros((0, 3))
_HERE = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


class Log(LogSink):
    """Sink that writes the files of one bag into a directory."""

    def __init__(self, path: Path, scenario: Scenario, phases: Sequence[Phase], attachment: Path) -> None:
        """Write to the directory `path`; `attachment` is the scenario's file, which is copied at the end."""
        path.mkdir(exist_ok=True)
        super().__init__(path / f"{BAG}.mcap", scenario, phases, attachment)
        self._path = path
        self._writer = Writer(self.file)
        self._writer.start(profile="ros2")
        self._channels: dict[str, int] = {}
        self._topics: dict[str, dict[str, Any]] = {}  # as metadata.yaml has them
        self._begun = 0

    def write_moment(self, moment: Moment) -> None:
        """Write poses, scene and values of a sample."""
        header = _Type["header"](_stamp(moment.time), WORLD)
        poses = [
            _Type["stamped"](
                header, frame, _Type["transform"](_Type["vector"](*pose[:3]), _Type["quaternion"](*pose[3:]))
            )
            for frame, pose in self.placed(moment)
        ]
        self._send("/tf", "tf", _Type["tf"](poses))
        self._send("/scene", "markers", self._scene(moment, header))
        for topic, names in TOPICS.items():
            for name in (name for name in names if name in moment.values):
                rows = np.atleast_1d(np.asarray(moment.values[name], np.float64))
                labels = [",".join(self.labels[name]), *[""] * (rows.ndim - 1)]  # the first lists the columns' names
                strides = [int(np.prod(rows.shape[k:])) for k in range(rows.ndim)]
                dimensions = [_Type["dimension"](*row) for row in zip(labels, rows.shape, strides, strict=True)]
                message = _Type["values"](_Type["layout"](dimensions, 0), rows.ravel())
                self._send(f"/{topic}/{name}", "values", message)

    def write_log(self, level: str, words: str) -> None:
        """Write a message, of level INFO or ERROR, at the time of the last sample."""
        kind = _Type["log"]
        self._send("/rosout", "log", kind(_stamp(self.last), getattr(kind, level), "mjsheaf", words, "", "", 0))

    def finish(self) -> None:
        """Write the index, metadata.yaml, and the scenario."""
        name, count = f"{BAG}.mcap", sum(topic["message_count"] for topic in self._topics.values())
        times = {
            "starting_time": {"nanoseconds_since_epoch": self._begun},
            "duration": {"nanoseconds": self.last - self._begun},
            "message_count": count,
        }
        bag = {
            "version": 9,
            "storage_identifier": "mcap",
            "relative_file_paths": [name],
            **times,
            "topics_with_message_count": [*self._topics.values()],
            "compression_format": "",
            "compression_mode": "",
            "files": [{"path": name, **times}],
            "custom_data": None,
            "ros_distro": "jazzy",
        }
        self._writer.add_metadata("rosbag2", {"serialized_metadata": json.dumps(bag)})
        self._writer.finish()
        text = json.dumps({"rosbag2_bagfile_information": bag}, indent=2)  # JSON is YAML
        (self._path / "metadata.yaml").write_text(text, encoding="utf-8")
        (self._path / "scenario.yaml").write_bytes(self.attachment.read_bytes())

    def _send(self, topic: str, kind: str, message: Any, *, latched: bool = False) -> None:
        """Write a message at the time of the last sample."""
        name = _SHORT[kind]
        if not self._topics:
            self._begun = self.last
        if topic not in self._topics:
            profiles = [_LATCHED] if latched else []
            about = {"name": topic, "type": name, "serialization_format": "cdr", "offered_qos_profiles": profiles}
            about["type_description_hash"] = _STORE.hash_rihs01(name)
            self._topics[topic] = {"topic_metadata": about, "message_count": 0}
            definition, _ = _STORE.generate_msgdef(name, ros_version=2)
            schema = self._writer.register_schema(name, "ros2msg", definition.encode())
            quality = {"offered_qos_profiles": json.dumps(profiles)}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", schema, quality)
        self._topics[topic]["message_count"] += 1
        self._writer.add_message(
            self._channels[topic], self.last, bytes(_STORE.serialize_cdr(message, name)), self.last
        )

    def _scene(self, moment: Moment, header: Any) -> Any:
        """Return edges, desired positions and arrows, after everything of the sample before is deleted."""
        markers = [_marker(header, "", 0, _MARKER.ARROW, action=_MARKER.DELETEALL)]
        if len(moment.edges):
            points = moment.poses[moment.edges.ravel(), :3]
            colours = PALETTE[np.repeat(moment.levels, 2)]
            width = [0.05, 0.0, 0.0]
            markers.append(_marker(header, "edges", 0, _MARKER.LINE_LIST, scale=width, points=points, colours=colours))
        for owner, goal in zip(moment.owners.tolist(), moment.goals.tolist(), strict=True):
            size = [2.0 * float(self.radii[owner])] * 3
            colour = [*self.colours[owner], HALF_OPEN]
            pose = [*goal, *_HERE[3:]]
            markers.append(_marker(header, "goals", owner, _MARKER.SPHERE, pose=pose, scale=size, colour=colour))
        for vehicle, flow in zip(moment.drifting.tolist(), moment.flow, strict=True):
            start = moment.poses[vehicle, :3]
            points = np.array([start, start + flow])
            shape = [0.0625, 0.1875, 0.0]
            markers.append(_marker(header, "flow", vehicle, _MARKER.ARROW, scale=shape, colour=ARROW, points=points))
        return _Type["markers"](markers)

    def write_vehicles(self) -> None:
        """Write the shapes of all vehicles, which move with their frames."""
        markers = []
        for frame, solids in zip(self.frames, self.solids, strict=True):
            header = _Type["header"](_stamp(self.last), frame)
            for k, solid in enumerate(solids):
                place = {"pose": solid.pose.tolist(), "scale": solid.size.tolist(), "points": solid.points}
                shape = _SHAPES[solid.shape]
                markers.append(_marker(header, frame, k, shape, **place, colour=solid.colour, frame_locked=True))
        self._send("/vehicles", "markers", _Type["markers"](markers), latched=True)


def _marker(
    header: Any,
    name: str,
    number: int,
    shape: int,
    *,
    action: int = 0,
    pose: Sequence[float] = tuple(_HERE),
    scale: Sequence[float] = (1.0, 1.0, 1.0),
    colour: Any = (1.0, 1.0, 1.0, 1.0),
    points: Array = _NO_POINTS,
    colours: Array = _NO_POINTS,
    frame_locked: bool = False,
) -> Any:
    """Return a marker; `points` has shape (n, 3), and `colours`, RGBA of each point, (n, 4)."""
    return _MARKER(
        header=header,
        ns=name,
        id=number,
        type=shape,
        action=action,
        pose=_Type["pose"](_Type["point"](*pose[:3]), _Type["quaternion"](*pose[3:])),
        scale=_Type["vector"](*scale),
        color=_colour(colour),
        lifetime=_Type["duration"](0, 0),
        frame_locked=frame_locked,
        points=[_Type["point"](*point) for point in points.tolist()],
        colors=[_colour(rgba) for rgba in colours],
        texture_resource="",
        texture=_Type["image"](header, "", np.zeros(0, np.uint8)),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=_Type["mesh"]("", np.zeros(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )


def _colour(colour: Any) -> Any:
    return _Type["colour"](*(float(part) for part in colour))


def _stamp(time: int) -> Any:
    return _Type["time"](*divmod(time, 10**9))
