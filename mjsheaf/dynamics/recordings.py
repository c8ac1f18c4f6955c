"""Recorded positions: rows t, x, y[, z] out of CSV, netCDF, MCAP and bags of ROS.

Times of a table and of netCDF without a date are those of the run. Others count from the first row.
"""

import csv
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError, shortened

Rows = list[list[float]]

_COLUMNS = {"t": "t", "time": "t", "time_s": "t", "x": "x", "y": "y", "z": "z"}
_SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "milliseconds": 1e-3, "min": 60.0}
_SECONDS |= {"minute": 60.0, "minutes": 60.0, "h": 3600.0, "hour": 3600.0, "hours": 3600.0, "days": 86400.0}
_METRES = {"m": 1.0, "metre": 1.0, "metres": 1.0, "meter": 1.0, "meters": 1.0, "km": 1000.0}
_STANDARD = {f"projection_{axis}_coordinate": axis for axis in "xy"} | {"height": "z", "altitude": "z"}
_PARTS = ("transform", "pose", "position", "translation", "point")
MAX_ROWS = 200_000
"""Maximum number of rows; a scenario with more could not be read again."""


def read_positions(path: str, topic: str | None = None, frame: str | None = None) -> Rows:
    """Read the rows of a file or of a bag's directory.

    Args:
        path: CSV table, netCDF (.nc), MCAP, or bag of ROS (.bag, .db3, directory).
        topic: Topic of a log; the agent or target in a run's result.nc. None if there is only one.
        frame: Frame of which a message with several transforms is read, its child frame.

    Raises:
        InputError: The file cannot be read, or does not hold positions; the message names the file and what is missing.
    """
    name = shortened(path, 100) or "''"
    place = Path(path)
    read: Callable[[Path, str | None, str | None], Rows] = _READERS.get(place.suffix.lower(), _read_table)
    if (place / "metadata.yaml").is_file():
        read = _read_bag
    try:
        os.stat(path)  # also refuses an empty path, which Path takes for the working directory
        rows = read(place, topic, frame)
    except OSError as error:
        raise InputError(f"{name}: {error.strerror or f'cannot be read: {error}'}") from None
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    except ImportError as error:
        raise InputError(f"{name}: needs {error.name}, which is not installed: pip install 'mjsheaf[mcap]'") from None
    except Exception as error:  # damaged files raise many kinds of exceptions in their readers
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{name}: cannot be read: {shortened(reason, 200)}") from None
    if len(rows) > MAX_ROWS:
        raise InputError(f"{name}: has {len(rows)} positions; expected at most {MAX_ROWS}, so leave some out")
    return rows


def _read_table(path: Path, topic: str | None, frame: str | None) -> Rows:
    """Read a table of numbers, with or without a header."""
    _refuse_selection(topic, frame)
    with path.open(newline="", encoding="utf-8-sig") as file:
        lines = [(k, row) for k, row in enumerate(csv.reader(file), 1) if "".join(row).strip()]
    places: list[int] = []
    if lines:
        places = _columns(lines[0][1])
        if not all(map(_is_number, lines[0][1])):
            lines.pop(0)
    rows = []
    for number, row in lines:
        if not all(at < len(row) and _is_number(row[at]) for at in places):
            shown = shortened(",".join(row))
            raise InputError(f"line {number}: expected a number in each column, not {shown!r}")
        rows.append([float(row[at]) for at in places])
    return rows


def _columns(first: list[str]) -> list[int]:
    """Return the columns of t, x, y and z in a table with this first line."""
    if all(map(_is_number, first)):
        return list(range(len(first)))
    header = [_COLUMNS.get(title.strip().lower()) for title in first]
    if not {"t", "x", "y"} <= set(header):
        raise InputError("expected a table of numbers with columns t, x, y, and in space z")
    return [header.index(column) for column in "txyz" if column in header]


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _read_netcdf(path: Path, topic: str | None, frame: str | None) -> Rows:
    """Read a run's result.nc, or a trajectory with CF's names."""
    import xarray as xr

    _refuse_selection(None, frame)
    with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as dataset:
        if "agent_position" in dataset:
            places = _of_vehicle(dataset, topic)
        else:
            _refuse_selection(topic, None)
            places = np.column_stack(list(_coordinates(dataset)))
        if "time" not in dataset or dataset["time"].dims != ("time",):
            raise InputError("expected a coordinate time")
        words = str(dataset["time"].attrs.get("units", "s")).split()
        if not words or words[0] not in _SECONDS:
            raise InputError(f"time is in {' '.join(words)!r}; expected seconds, minutes, hours or days")
        time = np.asarray(dataset["time"].values, np.float64)
        if "since" in words:
            time = time - time[:1]
        return _finite_rows(np.column_stack([_SECONDS[words[0]] * time, places]))


def _of_vehicle(dataset: Any, vehicle: str | None) -> Array:
    """Return the positions of one agent or target of a run, shape (T, n), m."""
    known = {str(x): (kind, k) for kind in ("agent", "target") for k, x in enumerate(dataset[kind].values)}
    if vehicle not in known:
        raise InputError(f"topic: {vehicle!r} is no agent or target of this run; expected {', '.join(known)}")
    kind, k = known[vehicle]
    places = dataset[f"{kind}_position"].values[:, k]
    return np.asarray(places[:, ~np.isnan(places).all(axis=0)])


def _coordinates(dataset: Any) -> Iterator[Array]:
    """Return x, y and, where there is one, z over time, m."""
    found: dict[str, Any] = {}
    for name, variable in dataset.variables.items():
        axis = _STANDARD.get(str(variable.attrs.get("standard_name", "")), str(name).lower())
        if axis in ("x", "y", "z") and variable.dims == ("time",):
            found[axis] = variable
    if not {"x", "y"} <= set(found):
        raise InputError(
            "expected variables x, y, and in space z, over time alone, by these names or as projection_x_coordinate, "
            "projection_y_coordinate, height or altitude"
        )
    for axis in sorted(found):
        units = str(found[axis].attrs.get("units", "m"))
        if units not in _METRES:
            raise InputError(f"{axis} is in {units!r}; expected metres")
        yield _METRES[units] * np.asarray(found[axis].values, np.float64)


def _read_mcap(path: Path, topic: str | None, frame: str | None) -> Rows:
    """Read an MCAP file with messages in protobuf, or in CDR as ROS 2 writes them."""
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        channels = [] if summary is None else list(summary.channels.values())
        chosen = _choose({channel.topic for channel in channels}, topic)
        if any(channel.topic == chosen and channel.message_encoding == "cdr" for channel in channels):
            return _read_bag(path, chosen, frame)
        messages = reader.iter_decoded_messages(topics=[chosen])
        return _rows_of(((message.log_time, decoded) for _, _, message, decoded in messages), chosen, frame)


def _read_bag(path: Path, topic: str | None, frame: str | None) -> Rows:
    """Read a bag of ROS 1 or 2."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        chosen = _choose(set(reader.topics), topic)
        connections = [connection for connection in reader.connections if connection.topic == chosen]
        messages = reader.messages(connections=connections)
        decoded = ((time, reader.deserialize(data, own.msgtype)) for own, time, data in messages)
        return _rows_of(decoded, chosen, frame)


def _choose(known: set[str], topic: str | None) -> str:
    """Return the topic to read."""
    if topic is None and len(known) == 1:
        return next(iter(known))
    if topic not in known:
        given = "missing" if topic is None else f"there is no {topic!r}"
        raise InputError(f"topic: {given}; expected {', '.join(sorted(known)) or 'a log with a topic'}")
    return topic


def _rows_of(messages: Iterator[tuple[int, Any]], topic: str, frame: str | None) -> Rows:
    """Return the rows of a topic's messages, each with its time in the log, ns."""
    found = _select(messages, topic, frame)
    times = np.array([time for time, _ in found], dtype=np.int64)
    points = [_point(part) for _, part in found]
    places = [[float(point.x), float(point.y), float(point.z)] for point in points]
    seconds = (times - times[0]) / 1e9  # a product would miss the end of a run by rounding
    return _finite_rows(np.column_stack([seconds, places]))


def _select(messages: Iterator[tuple[int, Any]], topic: str, frame: str | None) -> list[tuple[int, Any]]:
    """Return the messages, or those of their transforms that have the frame, each with its time in the log, ns."""
    found = list(_parts(messages))
    frames = sorted({_frame(part) for _, part in found} - {""})
    known = "; expected " + ", ".join(frames) if frames else ""
    if frame is None and len(frames) > 1:
        raise InputError(f"frame: missing; {topic} has several{known}")
    if frame is not None:
        found = [(time, part) for time, part in found if _frame(part) == frame]
    if not found:
        raise InputError(f"frame: {topic} has no position of {frame!r}{known}")
    return found


def _parts(messages: Iterator[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    """Return the messages, or the transforms in them, each with its time."""
    for time, message in messages:
        for part in getattr(message, "transforms", [message]):
            yield time, part


def _frame(part: Any) -> str:
    return str(getattr(part, "child_frame_id", ""))


def _point(message: Any) -> Any:
    """Return the part of a message with x, y and z."""
    for name in _PARTS:
        if hasattr(message, name):
            return _point(getattr(message, name))
    if not all(hasattr(message, axis) for axis in "xyz"):
        kind = getattr(message, "__msgtype__", type(message).__name__)
        raise InputError(f"topic: messages of type {kind} have no position; expected poses, points or transforms")
    return message


def _finite_rows(rows: Array) -> Rows:
    if not np.isfinite(rows).all():
        k = int((~np.isfinite(rows)).any(axis=1).argmax())
        raise InputError(f"position {k} is not a number")
    found: Rows = rows.tolist()
    return found


def _refuse_selection(topic: str | None, frame: str | None) -> None:
    for field, value in (("topic", topic), ("frame", frame)):
        if value is not None:
            raise InputError(f"{field}: this kind of file has none; leave it out")


_READERS: dict[str, Callable[[Path, str | None, str | None], Rows]] = {
    ".nc": _read_netcdf,
    ".mcap": _read_mcap,
    ".bag": _read_bag,
    ".db3": _read_bag,
}
