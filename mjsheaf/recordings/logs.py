"""Positions in logs: the types of ROS 1 and 2, PX4 and Foxglove that are the position of one vehicle.

`POSITIONS` says for each type where its position, time and frame are, and along which axes, as its definition does.
Any other type of a known package is refused, whatever x, y and z it has: a velocity, a force and a list of points have
them too. A type of another package is read where the scenario names its axes.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mjsheaf.arrays import Array, IntArray
from mjsheaf.errors import InputError, listed
from mjsheaf.recordings import Axes, Rows, Selection
from mjsheaf.recordings.tables import arrange

_HEADER = ("header.stamp", "header.frame_id")
_FOXGLOVE = ("timestamp", "frame_id")
_XYZ = ("x", "y", "z")
_DEGREES = ("latitude", "longitude", "altitude")


class Kind(NamedTuple):
    """Type of message that is the position of one vehicle.

    Attributes:
        position: Member with the coordinates; the message itself if empty. Members of members are written a.b.
        stamp: Member with the time; empty if the type has none.
        frame: Member with the frame that the position is in; empty if the type has none.
        child: Member with the frame whose position it is; empty if the type has none.
        coordinates: Members of the position: x, y[, z] in m or latitude, longitude, altitude in degrees and m. Empty if
            it is an array.
        axes: Axes of x, y and z, unless the frame's name says otherwise; or the member that says it, 1 for NED.
        valid: Members that are false, or negative, where the message has no position.
    """

    position: str
    stamp: str = ""
    frame: str = ""
    child: str = ""
    coordinates: tuple[str, ...] = _XYZ
    axes: str = "enu"
    valid: tuple[str, ...] = ()


POSITIONS: dict[str, Kind] = {
    "geometry_msgs/Point": Kind(""),
    "geometry_msgs/Point32": Kind(""),
    "geometry_msgs/PointStamped": Kind("point", *_HEADER),
    "geometry_msgs/Pose": Kind("position"),
    "geometry_msgs/Pose2D": Kind("", coordinates=("x", "y")),
    "geometry_msgs/PoseStamped": Kind("pose.position", *_HEADER),
    "geometry_msgs/PoseWithCovariance": Kind("pose.position"),
    "geometry_msgs/PoseWithCovarianceStamped": Kind("pose.pose.position", *_HEADER),
    "geometry_msgs/Transform": Kind("translation"),
    "geometry_msgs/TransformStamped": Kind("transform.translation", *_HEADER, "child_frame_id"),
    "tf2_msgs/TFMessage": Kind("transform.translation", *_HEADER, "child_frame_id"),
    "tf/tfMessage": Kind("transform.translation", *_HEADER, "child_frame_id"),
    "nav_msgs/Odometry": Kind("pose.pose.position", *_HEADER, "child_frame_id"),
    "sensor_msgs/NavSatFix": Kind("", *_HEADER, coordinates=_DEGREES, valid=("status.status",)),
    "gps_common/GPSFix": Kind("", *_HEADER, coordinates=_DEGREES, valid=("status.status",)),
    "gps_msgs/GPSFix": Kind("", *_HEADER, coordinates=_DEGREES, valid=("status.status",)),
    "geographic_msgs/GeoPoint": Kind("", coordinates=_DEGREES),
    "geographic_msgs/GeoPointStamped": Kind("position", *_HEADER, coordinates=_DEGREES),
    "geographic_msgs/GeoPose": Kind("position", coordinates=_DEGREES),
    "geographic_msgs/GeoPoseStamped": Kind("pose.position", *_HEADER, coordinates=_DEGREES),
    "px4_msgs/VehicleLocalPosition": Kind("", "timestamp", axes="ned", valid=("xy_valid", "z_valid")),
    "px4_msgs/VehicleOdometry": Kind("position", "timestamp", coordinates=(), axes="pose_frame"),
    "px4_msgs/VehicleGlobalPosition": Kind(
        "", "timestamp", coordinates=("lat", "lon", "alt"), valid=("lat_lon_valid", "alt_valid")
    ),
    "foxglove.FrameTransform": Kind("translation", "timestamp", "parent_frame_id", "child_frame_id"),
    "foxglove.FrameTransforms": Kind("translation", "timestamp", "parent_frame_id", "child_frame_id"),
    "foxglove.LocationFix": Kind("", *_FOXGLOVE, coordinates=_DEGREES),
    "foxglove.Odometry": Kind("pose.position", *_FOXGLOVE, "body_frame_id"),
    "foxglove.Point3": Kind(""),
    "foxglove.Point3InFrame": Kind("point", *_FOXGLOVE),
    "foxglove.Pose": Kind("position"),
    "foxglove.PoseInFrame": Kind("pose.position", *_FOXGLOVE),
}
"""Types that are read, by package and name."""

_CLOSED = {re.split("[/.]", name)[0] for name in POSITIONS if not name.startswith("px4")} | {
    "actionlib", "actionlib_msgs", "diagnostic_msgs", "foxglove_msgs", "mavros_msgs", "rosgraph_msgs", "shape_msgs",
    "std_msgs", "stereo_msgs", "trajectory_msgs", "visualization_msgs",
}  # fmt: skip
"""Packages whose other types are no positions."""

_PARTS = ("transform", "pose", "position", "translation", "point")
_NED = re.compile(r"(^|[/_-])ned($|[/_-])", re.IGNORECASE)
_MOVING = re.compile(
    r"(^|[/_])(base(_footprint|_stabilized)?|\w*link|body|\w*optical(_frame)?|earth|ecef|frd|flu|nwu)$", re.IGNORECASE
)
_FIXED = re.compile(r"(^|[/_])(odom|map|world|earth|local_origin)$")

Part = tuple[int, Any]  # its time in the log, ns, and a message or a transform in it


def read_mcap(path: Path, selection: Selection) -> Rows:
    """Read an MCAP file with messages in protobuf, in CDR as ROS 2 writes them, or converted from a bag of ROS 1."""
    from mcap.reader import NonSeekingReader
    from mcap_protobuf.decoder import DecoderFactory

    decoders: list[Any] = [DecoderFactory(), _Ros1Decoder()]
    with path.open("rb") as file:
        # Not by the summary, which is optional, and whose checksum no reader compares.
        types: dict[str, set[tuple[str, str]]] = {}
        for schema, channel, _ in NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False):
            types.setdefault(channel.topic, set()).add((channel.message_encoding, schema.name if schema else ""))
        file.seek(0)
        reader = NonSeekingReader(file, validate_crcs=True, decoder_factories=decoders)
        topic = selection.choose(sorted(types))
        encodings = {encoding for encoding, _ in types[topic]}
        if encodings == {"cdr"}:
            return read_bag(path, selection)
        if not encodings <= {"protobuf", "ros1"}:
            raise InputError(
                f"topic: {topic} is encoded as {listed(sorted(encodings))}; expected protobuf, cdr or ros1"
            )
        name = _only_type(topic, {name for _, name in types[topic]})
        messages = reader.iter_decoded_messages(topics=[topic])
        return _rows(((message.log_time, decoded) for _, _, message, decoded in messages), name, topic, selection)


class _Ros1Decoder:
    """Decoder of messages of ROS 1 in MCAP, by the definitions in the file."""

    def decoder_for(self, encoding: str, schema: Any) -> Callable[[bytes], Any] | None:
        """Return the function that decodes messages of a schema; None if they are not of ROS 1."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        if encoding != "ros1" or schema is None:
            return None
        name = schema.name if "/msg/" in schema.name else schema.name.replace("/", "/msg/")
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(schema.data.decode(), name))
        return lambda data: store.deserialize_ros1(data, name)


def read_bag(path: Path, selection: Selection) -> Rows:
    """Read a bag of ROS 1 or 2."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        topic = selection.choose(sorted(reader.topics))
        connections = [connection for connection in reader.connections if connection.topic == topic]
        name = _only_type(topic, {connection.msgtype for connection in connections})
        messages = reader.messages(connections=connections)
        decoded = ((time, reader.deserialize(data, own.msgtype)) for own, time, data in messages)
        return _rows(decoded, name, topic, selection)


def _only_type(topic: str, names: set[str]) -> str:
    if len(names) > 1:
        raise InputError(f"topic: {topic} has messages of several types, {', '.join(sorted(names))}; expected one")
    return next(iter(names))


def _rows(messages: Iterator[Part], name: str, topic: str, selection: Selection) -> Rows:
    """Return the rows of a topic's messages of the type with this name."""
    kind = POSITIONS.get(name.replace("/msg/", "/").replace("foxglove_msgs/", "foxglove."))
    parts = [(time, part) for time, message in messages for part in getattr(message, "transforms", [message])]
    if kind is None:
        kind = _custom(parts, name, selection)
    parts = _select(parts, kind, topic, selection.frame)
    axes = _axes(parts, kind, topic, selection)
    count = len(parts)
    parts = [(time, part) for time, part in parts if all(_is_valid(part, member) for member in kind.valid)]
    places = np.array([_coordinates(part, kind) for _, part in parts], dtype=np.float64)
    if len(places) and kind.coordinates != _XYZ:  # members that are NaN where they are not known
        known = np.flatnonzero(np.isfinite(places[:, :2] if kind.coordinates else places).all(axis=1))
        parts = [parts[k] for k in known]
        places = places[known]
    if not len(places):
        raise InputError(f"topic: none of the {count} messages of {topic} has a position, by their own flags")
    times, places = _rising(_times(parts, kind, name, selection), places, topic, selection)
    names = _XYZ if "x" in kind.coordinates or not kind.coordinates else ("latitude", "longitude", "up")
    columns = dict(zip(names, places.T, strict=False))
    if "up" in columns and np.isnan(columns["up"]).any():  # no altitude
        del columns["up"]
    # A quotient, because a product would miss the end of a run by rounding.
    return arrange(np.asarray((times - times[0]) / 1e9), columns, selection, axes)


def _custom(parts: list[Part], name: str, selection: Selection) -> Kind:
    """Return where messages of a type that is not known have their position, if the scenario says that they do."""
    shown = name.rpartition(".")[2]
    if re.split("[/.]", name)[0] in _CLOSED or not parts:
        raise InputError(f"topic: messages of type {shown} have no position of one vehicle; expected {_accepted()}")
    part, position = parts[0][1], ""
    while not all(hasattr(_member(part, position), axis) for axis in "xy"):
        inner = next((member for member in _PARTS if hasattr(_member(part, position), member)), None)
        if inner is None:
            raise InputError(f"topic: messages of type {shown} have no position of one vehicle; expected {_accepted()}")
        position = f"{position}.{inner}".lstrip(".")
    if selection.axes is None:
        raise InputError(
            f"axes: missing; messages of type {shown} do not say along which axes {position or 'the position'} is; "
            "expected enu (x east, y north, z up) or ned (x north, y east, z down)"
        )
    stamp, frame = _HEADER if hasattr(part, "header") else ("", "")
    child = "child_frame_id" if hasattr(part, "child_frame_id") else ""
    planar = not hasattr(_member(part, position), "z")
    return Kind(position, stamp, frame, child, coordinates=_XYZ[:2] if planar else _XYZ)


def _accepted() -> str:
    """Return the types that are read, in words."""
    packages: dict[str, list[str]] = {}
    for name in POSITIONS:
        package, kind = re.split("[/.]", name)
        packages.setdefault(package, []).append(kind)
    return "; ".join(f"{package} {', '.join(kinds)}" for package, kinds in packages.items())


def _select(parts: list[Part], kind: Kind, topic: str, frame: str | None) -> list[Part]:
    """Return the parts whose position is that of a frame, where there are several."""
    children = [str(_member(part, kind.child)).lstrip("/") if kind.child else "" for _, part in parts]
    frames = sorted(set(children) - {""})
    known = "; expected " + ", ".join(frames) if frames else ""
    if frame is None and len(frames) > 1:
        raise InputError(f"frame: missing; {topic} has several{known}")
    if frame is not None:
        parts_of_frame = [part for part, child in zip(parts, children, strict=True) if child == frame.lstrip("/")]
        parents = {str(_member(part, kind.frame)).lstrip("/") for _, part in parts_of_frame}
        moving = sorted(parent for parent in parents if parent in frames and not _FIXED.search(parent))
        if moving:
            raise InputError(f"frame: {frame} is relative to {moving[0]}, which moves; expected a frame in a fixed one")
        parts = parts_of_frame
    if not parts:
        raise InputError(f"frame: {topic} has no position of {frame!r}{known}" if frame else f"topic: {topic} is empty")
    return parts


def _axes(parts: list[Part], kind: Kind, topic: str, selection: Selection) -> Axes:
    """Return the axes of x, y and z, from the motion, the type, or the name of the frame."""
    parents = sorted({str(_member(part, kind.frame)).lstrip("/") for _, part in parts} if kind.frame else {""})
    if len(parents) > 1:
        raise InputError(
            f"topic: positions of {topic} are relative to several frames, {listed(parents)}; expected one, so split "
            "the log by frame"
        )
    if selection.axes is not None or "latitude" in kind.coordinates:
        return selection.axes or "enu"
    if _MOVING.search(parents[0]):
        raise InputError(
            f"topic: positions of {topic} are relative to {parents[0]}, which moves or points another way; expected a "
            "frame that is fixed, or axes: enu or ned if it is"
        )
    if kind.axes == "pose_frame":
        if any(getattr(part, "pose_frame", None) != 1 for _, part in parts):  # 1 is PX4's POSE_FRAME_NED
            raise InputError(
                f"axes: missing; pose_frame of {topic} is not NED in all messages; expected enu or ned, if it points so"
            )
        return "ned"
    return "ned" if kind.axes == "ned" or _NED.search(parents[0]) else "enu"


def _times(parts: list[Part], kind: Kind, name: str, selection: Selection) -> IntArray:
    """Return the times of messages, ns: their stamps if they have any, unless the motion says otherwise."""
    received = np.array([time for time, _ in parts], dtype=np.int64)
    stamps = np.array([_nanoseconds(part, kind.stamp) for _, part in parts] if kind.stamp else received, dtype=np.int64)
    stamped = bool(kind.stamp and stamps.any())
    if selection.time == "log" or (selection.time is None and not stamped):
        return received
    if not stamped:
        raise InputError(f"time: messages of type {name} have no stamps here; expected log")
    unset = int((stamps[1:] == 0).sum())  # a simulation may begin at 0
    if unset:
        raise InputError(f"time: {unset} of {len(stamps)} messages have no stamp; expected log, or stamps in all")
    return stamps


def _rising(times: IntArray, places: Array, topic: str, selection: Selection) -> tuple[IntArray, Array]:
    """Return times and positions without repetitions of a whole message."""
    same = (np.diff(times) == 0) & (np.nan_to_num(places[1:]) == np.nan_to_num(places[:-1])).all(axis=1)
    fresh = np.append(True, ~same)
    times, places = times[fresh], places[fresh]
    steps = np.diff(times)
    if (steps <= 0).any():
        k = int((steps <= 0).argmax())
        number = int(np.flatnonzero(fresh)[k + 1])
        other = "stamp" if selection.time == "log" else "log"
        after, before = (f"{times[i] / 1e9:.9f} s" for i in (k + 1, k))
        raise InputError(
            f"time: position {number} of {topic} is of {after}, after one of {before}; expected times that rise: "
            f"time: {other}, or a log in which no clock was set back"
        )
    return times, places


def _nanoseconds(part: Any, member: str) -> int:
    """Return a stamp, ns: seconds and nanoseconds in two members, or PX4's microseconds."""
    stamp = _member(part, member)
    for seconds, rest in (("sec", "nanosec"), ("seconds", "nanos")):
        if hasattr(stamp, seconds):
            return int(getattr(stamp, seconds)) * 10**9 + int(getattr(stamp, rest))
    return int(stamp) * 1000


def _coordinates(part: Any, kind: Kind) -> list[float]:
    position = _member(part, kind.position)
    found = [getattr(position, name) for name in kind.coordinates] if kind.coordinates else position
    return [float(value) for value in found]


def _is_valid(part: Any, member: str) -> bool:
    """Return False if a flag says that there is no position: false, or a fix of NavSatStatus below 0."""
    try:
        flag = _member(part, member)
    except AttributeError:  # of a definition that has no such flag
        return True
    return bool(flag >= 0) if member == "status.status" else bool(flag)


def _member(part: Any, path: str) -> Any:
    """Return a member of a message, members of members written a.b; the message itself for an empty path."""
    for name in path.split(".") if path else ():
        part = getattr(part, name)
    return part
