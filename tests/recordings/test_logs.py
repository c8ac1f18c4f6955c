"""Positions in logs: each type of message is read by its definition, or refused.

Oracle: messages that the libraries of ROS and Foxglove write, with numbers that the test chose. Every type that these
libraries have is tried, so that a new one must be put into the table or be refused.
"""

import importlib
import os
import pkgutil
from pathlib import Path
from typing import Any

import foxglove_schemas_protobuf
import numpy as np
import pytest
from google.protobuf.message import Message
from mcap.well_known import SchemaEncoding
from mcap.writer import IndexType
from mcap.writer import Writer as McapWriter
from mcap_protobuf.schema import build_file_descriptor_set
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mjsheaf.errors import InputError
from mjsheaf.recordings import read_positions
from mjsheaf.recordings.cf import EARTH
from mjsheaf.recordings.logs import POSITIONS

SECOND = 10**9
START = 1_700_000_000
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
HEADER = "std_msgs/Header header\n"
EXTRA = {
    "px4_msgs/msg/VehicleLocalPosition": "uint64 timestamp\nbool xy_valid\nbool z_valid\n"
    "float32 x\nfloat32 y\nfloat32 z",
    "px4_msgs/msg/VehicleOdometry": "uint64 timestamp\nuint8 pose_frame\nfloat32[3] position\nfloat32[4] q",
    "px4_msgs/msg/VehicleGlobalPosition": "uint64 timestamp\nfloat64 lat\nfloat64 lon\nfloat32 alt",
    "px4_msgs/msg/TrajectorySetpoint": "uint64 timestamp\nfloat32 x\nfloat32 y\nfloat32 z",
    "geographic_msgs/msg/GeoPoint": "float64 latitude\nfloat64 longitude\nfloat64 altitude",
    "geographic_msgs/msg/GeoPointStamped": HEADER + "geographic_msgs/GeoPoint position",
    "geographic_msgs/msg/GeoPose": "geographic_msgs/GeoPoint position\ngeometry_msgs/Quaternion orientation",
    "geographic_msgs/msg/GeoPoseStamped": HEADER + "geographic_msgs/GeoPose pose",
    "gps_msgs/msg/GPSStatus": "int16 status",
    "gps_msgs/msg/GPSFix": HEADER + "gps_msgs/GPSStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude",
    "gps_common/msg/GPSStatus": "int16 status",
    "gps_common/msg/GPSFix": HEADER
    + "gps_common/GPSStatus status\nfloat64 latitude\nfloat64 longitude\nfloat64 altitude",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms",
    "team_msgs/msg/State": HEADER + "geometry_msgs/Vector3 position\ngeometry_msgs/Vector3 velocity",
    "team_msgs/msg/Flat": HEADER + "float64 x\nfloat64 y",
}
for _name, _text in EXTRA.items():
    ROS2.register(get_types_from_msg(_text, _name))


def member_value(path: str, k: int) -> Any:
    """Return what message k has in a member: a vehicle at (1 + k, 2 + 2 k, 3), or that many 1e-5 degrees and metres."""
    last = path.split(".")[-1]
    if last in ("sec", "secs"):
        return START + k
    if last == "timestamp":
        return (START + k) * 10**6
    numbers = {"x": 1.0 + k, "y": 2.0 + 2.0 * k, "z": 3.0, "w": 1.0}
    numbers |= {"latitude": 60.0 + 2e-5 * k, "longitude": 10.0 + 1e-5 * k, "altitude": 3.0}
    numbers |= {"lat": 60.0 + 2e-5 * k, "lon": 10.0 + 1e-5 * k, "alt": 3.0, "position": 3.0}
    return numbers.get(last, 1 if last in ("pose_frame", "xy_valid", "z_valid") else 0)


def build(store: Any, name: str, k: int, change: dict[str, Any] | None = None, path: str = "") -> Any:
    """Build message k of a type of ROS, with one element in each list; `change` replaces members by path."""

    def value(kind: Any, where: str) -> Any:
        node, detail = kind
        if change and where in change:
            return change[where]
        if node == Nodetype.NAME:
            return build(store, detail, k, change, where)
        if node == Nodetype.BASE:
            if detail[0] == "string":
                return {"child_frame_id": "boat"}.get(where.split(".")[-1], "map")
            number = member_value(where, k)
            return number if detail[0].startswith("float") else (detail[0] == "bool" and bool(number)) or int(number)
        inner, length = detail
        if inner[0] == Nodetype.BASE and inner[1][0] != "string":
            numbers = [1.0 + k, 2.0 + 2.0 * k, 3.0] if where == "position" and length == 3 else [0.0] * (length or 1)
            return np.array(numbers, dtype={"octet": "uint8", "char": "uint8"}.get(inner[1][0], inner[1][0]))
        return [value(inner, where) for _ in range(length or 1)]

    fields = store.fielddefs[name][1]
    return store.types[name](**{field: value(kind, f"{path}.{field}".lstrip(".")) for field, kind in fields})


def write_ros2(
    path: Path, name: str, changes: list[dict[str, Any]] | None = None, plugin: Any = StoragePlugin.MCAP
) -> str:
    with Bag2(path, version=9, storage_plugin=plugin) as bag:
        topic = bag.add_connection("/topic", name, typestore=ROS2)
        for k, change in enumerate(changes or [{}] * 3):
            message = build(ROS2, name, k, change)
            bag.write(topic, (2 * START + 5 * k) * SECOND, ROS2.serialize_cdr(message, name))
    return str(path)


def write_ros1(path: Path, name: str) -> str:
    with Bag1(path) as bag:
        topic = bag.add_connection("/topic", name, typestore=ROS1)
        for k in range(3):
            bag.write(topic, (START + k) * SECOND, ROS1.serialize_ros1(build(ROS1, name, k), name))
    return str(path)


def fill(message: Message, k: int) -> Message:
    """Fill every member of a message in protobuf, with one element in each list."""
    for field in message.DESCRIPTOR.fields:
        repeated = field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED
        target = getattr(message, field.name)
        if (
            field.message_type is not None
            and field.message_type.full_name == "google.protobuf.Timestamp"
            and not repeated
        ):
            target.FromNanoseconds((START + k) * SECOND)
        elif field.message_type is not None:
            if field.message_type is not message.DESCRIPTOR and field.message_type.full_name.startswith("foxglove"):
                fill(target.add() if repeated else target, k)
        elif field.type == field.TYPE_STRING and not repeated:
            frames = {"child_frame_id": "boat", "body_frame_id": "boat"}
            setattr(message, field.name, frames.get(field.name, "map"))
        elif field.type in (field.TYPE_DOUBLE, field.TYPE_FLOAT) and not repeated:
            setattr(message, field.name, member_value(field.name, k))
    return message


FOXGLOVE: dict[str, type[Message]] = {}
for _module in pkgutil.iter_modules(foxglove_schemas_protobuf.__path__):
    if _module.name.endswith("_pb2"):
        _loaded = importlib.import_module(f"foxglove_schemas_protobuf.{_module.name}")
        FOXGLOVE |= {f"foxglove.{name}": getattr(_loaded, name) for name in _loaded.DESCRIPTOR.message_types_by_name}


def write_foxglove(path: Path, messages: list[Message], summary: bool = True, start: int = 2 * START) -> str:
    none = {"index_types": IndexType.NONE, "use_summary_offsets": False, "use_statistics": False}
    plain: dict[str, Any] = {} if summary else none
    repeat: dict[str, Any] = {"repeat_channels": summary, "repeat_schemas": summary}
    with path.open("wb") as file:
        writer = McapWriter(file, **plain, **repeat)
        writer.start()
        name, data = messages[0].DESCRIPTOR.full_name, build_file_descriptor_set(type(messages[0])).SerializeToString()
        channel = writer.register_channel(
            "/topic", "protobuf", writer.register_schema(name, SchemaEncoding.Protobuf, data)
        )
        for k, message in enumerate(messages):
            time = (start + 5 * k) * SECOND
            writer.add_message(channel, log_time=time, publish_time=0, data=message.SerializeToString())
        writer.finish()
    return str(path)


def expected_rows(name: str, clocked: bool) -> np.ndarray:
    """The rows of three messages as `build` and `fill` write them, in axes east, north, up."""
    k = np.arange(3.0)
    time = k if clocked else 5.0 * k
    kind = POSITIONS[name]
    if "latitude" in kind.coordinates or "lat" in kind.coordinates:
        metre = np.radians(1.0) * EARTH * 1e-5
        return np.column_stack([time, metre * k * np.cos(np.radians(60.0)), 2.0 * metre * k, 0 * k + 3.0])
    x, y, z = 1.0 + k, 2.0 + 2.0 * k, 0 * k + 3.0
    if kind.axes in ("ned", "pose_frame"):
        x, y, z = y, x, -z
    return np.column_stack([time, x, y, z][: 3 if kind.coordinates == ("x", "y") else 4])


ALL_ROS2 = sorted(name for name in ROS2.fielddefs if not name.startswith("team_msgs"))
ALL_ROS1 = sorted(ROS1.fielddefs)


@pytest.mark.long
@pytest.mark.parametrize("axes", [None, "enu"])
def test_every_type_is_read_by_its_definition_or_refused(axes: Any, tmp_path: Path) -> None:
    """All types of ROS 1 and 2 and of Foxglove; with `axes` a type that is no position is refused all the same."""
    read: set[str] = set()
    for number, name in enumerate([*ALL_ROS2, *ALL_ROS1, *FOXGLOVE]):
        key, ros1 = name.replace("/msg/", "/"), number >= len(ALL_ROS2)
        if name in FOXGLOVE:
            path = write_foxglove(tmp_path / f"{number}.mcap", [fill(FOXGLOVE[name](), k) for k in range(3)])
        elif ros1:
            path = write_ros1(tmp_path / f"{number}.bag", name)
        else:
            path = write_ros2(tmp_path / str(number), name)
        if key not in POSITIONS:
            if key != "px4_msgs/TrajectorySetpoint" or axes is None:
                with pytest.raises(
                    InputError, match=r"^[^\n]* (have no position of one vehicle; expected|axes: missing)"
                ):
                    read_positions(path, axes=axes)
            continue
        if axes is not None:
            continue
        read.add(key)
        origin = [60.0, 10.0] if {"latitude", "lat"} & set(POSITIONS[key].coordinates) else None
        rows = np.array(read_positions(path, origin=origin))
        clocked = bool(POSITIONS[key].stamp) or (ros1 and name not in FOXGLOVE)
        np.testing.assert_allclose(rows, expected_rows(key, clocked), atol=1e-6, err_msg=name)
    assert axes is not None or read == set(POSITIONS), "a type of the table is never tried"


STAMPED = "geometry_msgs/msg/PoseStamped"
FIX = "sensor_msgs/msg/NavSatFix"
LOCAL = "px4_msgs/msg/VehicleLocalPosition"
ODOMETRY = "px4_msgs/msg/VehicleOdometry"
TIME = ROS2.types["builtin_interfaces/msg/Time"]
ENU = [[0, 1, 2, 3], [1, 2, 4, 3], [2, 3, 6, 3]]
NED = [[0, 2, 1, -3], [1, 4, 2, -3], [2, 6, 3, -3]]
LOGGED = [[5.0 * k, 1 + k, 2 + 2 * k, 3] for k in range(3)]


def stamps(*times: float) -> list[dict[str, Any]]:
    return [{"header.stamp": TIME(int(t), round(t % 1 * SECOND))} for t in times]


@pytest.mark.parametrize(
    ("name", "changes", "fields", "expected"),
    [
        (STAMPED, [{"header.frame_id": "/world_ned"}] * 3, {}, NED),
        (STAMPED, [{"header.frame_id": "/world_ned"}] * 3, {"axes": "enu"}, ENU),
        (STAMPED, [{"header.frame_id": "planned"}] * 3, {}, ENU),
        (STAMPED, [{}] * 3, {"axes": "ned"}, NED),
        (STAMPED, [{}] * 3, {"time": "log"}, LOGGED),
        (STAMPED, stamps(0, 0, 0), {}, LOGGED),
        (STAMPED, stamps(0, 1, 2), {}, ENU),  # a simulation begins at 0
        (STAMPED, stamps(0.5, 0.6, 0.7), {}, [[0, 1, 2, 3], [0.1, 2, 4, 3], [0.2, 3, 6, 3]]),
        (STAMPED, stamps(0, 5, 0), {}, "time: 1 of 3 messages have no stamp; expected log"),
        (STAMPED, stamps(0, 0, 0), {"time": "stamp"}, "time: messages of type .*PoseStamped have no stamps here"),
        (STAMPED, stamps(10, 12, 12), {}, r"time: position 2 of /topic is of 12\.0+ s, after one of 12\.0+ s; .* log"),
        (STAMPED, [{"header.frame_id": "map"}, {"header.frame_id": "odom"}], {}, "several frames, map, odom; expected"),
        (STAMPED, [{"header.frame_id": "base_link"}] * 3, {}, "relative to base_link, which moves"),
        (STAMPED, [{"header.frame_id": "odom_FRD"}] * 3, {}, "relative to odom_FRD, which moves or points another way"),
        (STAMPED, [{"header.frame_id": "cam_optical_frame"}] * 3, {}, "relative to cam_optical_frame, which moves"),
        (STAMPED, [{"header.frame_id": "cam_optical_frame"}] * 3, {"axes": "enu"}, ENU),
        (FIX, [{"status.status": -1}, {}, {}], {"origin": [60, 10]}, expected_rows("sensor_msgs/NavSatFix", True)[1:]),
        (FIX, [{"latitude": np.nan}, {}, {}], {"origin": [60, 10]}, expected_rows("sensor_msgs/NavSatFix", True)[1:]),
        (FIX, [{"altitude": np.nan}] * 3, {"origin": [60, 10]}, expected_rows("sensor_msgs/NavSatFix", True)[:, :3]),
        (FIX, [{"status.status": -1}] * 3, {"origin": [60.0, 10.0]}, "none of the 3 messages of /topic has a position"),
        (LOCAL, [{}] * 3, {}, NED),
        (LOCAL, [{}, {}, {}, {"xy_valid": False}], {}, NED),
        (LOCAL, [{}, {}, {}, {"z_valid": False}], {}, NED),
        (ODOMETRY, [{}] * 3, {}, NED),
        (ODOMETRY, [{}, {}, {}, {"position": np.full(3, np.nan, np.float32)}], {}, NED),
        (ODOMETRY, [{"pose_frame": 2}] * 3, {}, "axes: missing; pose_frame of /topic is not NED"),
        (ODOMETRY, [{"pose_frame": 2}] * 3, {"axes": "ned"}, NED),
        ("team_msgs/msg/State", [{}] * 3, {}, "axes: missing; messages of type team_msgs/msg/State .* position is"),
        ("team_msgs/msg/State", [{}] * 3, {"axes": "enu"}, ENU),
        ("team_msgs/msg/Flat", [{}] * 3, {"axes": "enu"}, [row[:3] for row in ENU]),
        ("geometry_msgs/msg/Twist", [{}] * 3, {"axes": "enu"}, "type geometry_msgs/msg/Twist have no position"),
        ("nav_msgs/msg/Odometry", [{}] * 3, {"frame": "boat"}, ENU),
        ("nav_msgs/msg/Odometry", [{}] * 3, {"frame": "ship"}, "/topic has no position of 'ship'; expected boat"),
    ],
)
def test_time_frame_and_axes_decide(
    name: str, changes: list[dict[str, Any]], fields: dict[str, Any], expected: Any, tmp_path: Path
) -> None:
    path = write_ros2(tmp_path / "bag", name, changes)
    if isinstance(expected, str):
        with pytest.raises(InputError, match=f"^[^\n]*bag: [^\n]*{expected}"):
            read_positions(path, **fields)
        return
    expected = np.array(expected, dtype=float)
    expected[:, 0] -= expected[0, 0]
    np.testing.assert_allclose(read_positions(path, **fields), expected, atol=1e-6)


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_messages_that_repeat_one_whole_count_once(plugin: Any, tmp_path: Path) -> None:
    same = {"header.stamp": TIME(START, 0), "pose.position.x": 1.0, "pose.position.y": 2.0}
    path = write_ros2(tmp_path / "bag", STAMPED, [same, same, {}, {}], plugin)
    assert [row[0] for row in read_positions(path)] == [0.0, 2.0, 3.0]


def test_a_transform_between_moving_frames_is_no_position_in_the_world(tmp_path: Path) -> None:
    name = "tf2_msgs/msg/TFMessage"
    pairs = [("map", "odom"), ("odom", "hull"), ("hull", "mast")]
    path = tmp_path / "bag"
    with Bag2(path, version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        topic = bag.add_connection("/tf", name, typestore=ROS2)
        for k in range(3):
            parts = []
            for parent, child in pairs:
                change = {"header.frame_id": parent, "child_frame_id": child}
                parts.append(build(ROS2, "geometry_msgs/msg/TransformStamped", k, change))
            bag.write(topic, k * SECOND, ROS2.serialize_cdr(ROS2.types[name](transforms=parts), name))
    assert np.allclose(read_positions(str(path), frame="hull"), ENU)
    with pytest.raises(InputError, match="frame: mast is relative to hull, which moves"):
        read_positions(str(path), frame="mast")
    with pytest.raises(InputError, match="frame: missing; /tf has several; expected hull, mast, odom"):
        read_positions(str(path))


@pytest.mark.parametrize("summary", [True, False])
def test_a_log_needs_no_summary(summary: bool, tmp_path: Path) -> None:
    messages = [fill(FOXGLOVE["foxglove.PoseInFrame"](), k) for k in range(3)]
    path = write_foxglove(tmp_path / "a.mcap", messages, summary)
    np.testing.assert_array_equal(read_positions(path), ENU)
    np.testing.assert_array_equal(read_positions(path, topic="/topic", time="log"), LOGGED)
    with pytest.raises(InputError, match="there is no '/other'; expected /topic"):
        read_positions(path, topic="/other")
    whole = Path(path).read_bytes()
    for size in range(0, len(whole), 50):
        (tmp_path / "cut.mcap").write_bytes(whole[:size])
        with pytest.raises(InputError, match=r"cut\.mcap: cannot be read"):
            read_positions(str(tmp_path / "cut.mcap"))


@pytest.mark.parametrize("encoding", ["ros1", "json"])
def test_an_mcap_that_was_converted_from_ros_1_is_read(encoding: str, tmp_path: Path) -> None:
    name = "geometry_msgs/msg/PoseStamped"
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        text = ROS1.generate_msgdef(name)[0].encode()
        schema = writer.register_schema(name.replace("/msg", ""), SchemaEncoding.ROS1, text)
        channel = writer.register_channel("/topic", encoding, schema)
        for k in range(3):
            data = bytes(ROS1.serialize_ros1(build(ROS1, name, k), name))
            writer.add_message(channel, log_time=k * 5 * SECOND, publish_time=0, data=data)
        writer.finish()
    if encoding == "ros1":
        np.testing.assert_array_equal(read_positions(str(tmp_path / "a.mcap")), ENU)
    else:
        with pytest.raises(InputError, match="topic: /topic is encoded as json; expected protobuf, cdr or ros1"):
            read_positions(str(tmp_path / "a.mcap"))


@pytest.mark.parametrize("place", ["a.mcap", "a.csv", "a.nc", "bag/pipe"])
def test_a_pipe_is_refused_before_it_blocks(place: str, tmp_path: Path) -> None:
    path = tmp_path / place
    path.parent.mkdir(exist_ok=True)
    os.mkfifo(path)
    if place.startswith("bag"):
        (path.parent / "metadata.yaml").write_text("")
        path = path.parent
    with pytest.raises(InputError, match="is a pipe or a device"):
        read_positions(str(path))
