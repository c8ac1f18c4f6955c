"""Sink that writes MCAP with Foxglove's protobuf schemas. Equal runs give equal bytes."""

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

import foxglove_schemas_protobuf.FrameTransforms_pb2 as transforms_pb2
import foxglove_schemas_protobuf.Log_pb2 as log_pb2
import foxglove_schemas_protobuf.SceneUpdate_pb2 as scene_pb2
import numpy as np
import xarray as xr
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.writer import Writer
from scipy.spatial.transform import Rotation

from mjsheaf.arrays import Array
from mjsheaf.export.log import ARROW, HALF_OPEN, PALETTE, TOPICS, WORLD, LogSink, Moment
from mjsheaf.loop.system import Phase
from mjsheaf.scenario import Scenario

MAX_FIELDS = 4000
"""Maximum number of labels with a field each; protobuf allows some 8,000 lists in a message."""

_FIELD = descriptor_pb2.FieldDescriptorProto
_UPRIGHT = {"w": 1.0}
_TURNS = 2.0**6  # steps of the components of an arrow's quaternion, and of the mantissa of its length


class Log(LogSink):
    """Sink that writes one MCAP file."""

    def __init__(self, path: Path, scenario: Scenario, phases: Sequence[Phase], attachment: Path) -> None:
        """Write to `path`; `attachment` is the scenario's file, read at the end."""
        super().__init__(path, scenario, phases, attachment)
        self._writer = Writer(self.file)

    def open(self, variables: Mapping[Any, xr.Variable], attrs: Mapping[str, Any]) -> None:
        """Prepare the content; nothing is written before the first sample."""
        super().open(variables, attrs)
        self._kinds = make_messages(self.labels, self.vectors)

    def write(self, chunk: xr.Dataset) -> None:
        """Write the samples of a chunk."""
        super().write(
            chunk.assign({name: (chunk[name].dims, _significant(chunk[name].values)) for name in self.labels})
        )

    def write_moment(self, moment: Moment) -> None:
        """Write poses, scene and values of a sample."""
        poses = transforms_pb2.FrameTransforms()
        stamp = self._stamp
        for frame, pose in self.placed(moment):
            place = {"translation": _point(pose), "rotation": _quaternion(pose[3:])}
            poses.transforms.add(timestamp=stamp, parent_frame_id=WORLD, child_frame_id=frame, **place)
        self._send("/tf", poses)
        self._send("/scene", self._scene(moment))
        for topic, kind in self._kinds.items():
            message = kind()
            for variable in kind.DESCRIPTOR.fields:
                values = moment.values[variable.name]
                if variable.message_type is None:
                    _set_numbers(message, variable.name, values)
                    continue
                for field, value in zip(variable.message_type.fields, values, strict=True):
                    _set_numbers(getattr(message, variable.name), field.name, value)
            self._send(f"/{topic}", message)

    def write_log(self, level: str, words: str) -> None:
        """Write a message, of level INFO or ERROR, at the time of the last sample."""
        number = log_pb2.Log.Level.Value(level)
        self._send("/log", log_pb2.Log(timestamp=self._stamp, level=number, message=words, name="mjsheaf"))

    def finish(self) -> None:
        """Write the scenario and the index."""
        self._writer.add_attachment(0, 0, "scenario.yaml", "application/yaml", self.attachment.read_bytes())
        self._writer.finish()

    @property
    def _stamp(self) -> Timestamp:
        """Time of the last sample."""
        stamp = Timestamp()
        stamp.FromNanoseconds(self.last)
        return stamp

    def _send(self, topic: str, message: Any) -> None:
        """Write a message at the time of the last sample."""
        self._writer.write_message(topic, message, self.last, self.last)

    def _scene(self, moment: Moment) -> Any:
        """Return edges, desired positions and arrows; each of them replaces the one before."""
        message, stamp = scene_pb2.SceneUpdate(), self._stamp
        edges = message.entities.add(frame_id=WORLD, id="edges", timestamp=stamp)
        goals = message.entities.add(frame_id=WORLD, id="goals", timestamp=stamp)
        for level in np.unique(moment.levels).tolist():
            ends, indices = np.unique(moment.edges[moment.levels == level], return_inverse=True)
            edges.lines.add(
                type=LinePrimitive.LINE_LIST,
                pose={"orientation": _UPRIGHT},
                thickness=2.0,
                scale_invariant=True,
                points=[_point(place) for place in moment.poses[ends].tolist()],
                color=_colour(PALETTE[level]),
                indices=indices.ravel().tolist(),
            )
        for owner, place in zip(moment.owners.tolist(), moment.goals.tolist(), strict=True):
            goals.spheres.add(
                pose={"position": _point(place), "orientation": _UPRIGHT},
                size=_point([2.0 * float(self.radii[owner])] * 3),
                color=_colour([*self.colours[owner], HALF_OPEN]),
            )
        # The arrow of each vehicle's flow is in the vehicle's frame: its start need not be written.
        arrows = [
            message.entities.add(frame_id=frame, id=f"flow {frame}", frame_locked=True).arrows for frame in self.frames
        ]
        turns = Rotation.from_quat(moment.poses[moment.drifting, 3:])
        quaternions, lengths = turn_along(turns.inv().apply(moment.flow))
        for vehicle, quaternion, length in zip(moment.drifting.tolist(), quaternions, lengths, strict=True):
            arrows[vehicle].add(
                pose={"orientation": _quaternion(quaternion)},
                shaft_length=0.75 * length,
                shaft_diameter=0.0625,
                head_length=0.25 * length,
                head_diameter=0.1875,
                color=_colour(ARROW),
            )
        return message

    def write_vehicles(self) -> None:
        """Write the shapes of all vehicles, which move with their frames."""
        message = scene_pb2.SceneUpdate()
        for frame, solids in zip(self.frames, self.solids, strict=True):
            entity = message.entities.add(frame_id=frame, id=frame, frame_locked=True, timestamp=self._stamp)
            for solid in solids:
                pose = {"position": _point(solid.pose.tolist()), "orientation": _quaternion(solid.pose[3:].tolist())}
                shape = {"pose": pose, "color": _colour(solid.colour)}
                size = _point(solid.size.tolist())
                if solid.shape == "triangles":
                    entity.triangles.add(points=[_point(corner) for corner in solid.points.tolist()], **shape)
                elif solid.shape == "cylinder":
                    entity.cylinders.add(size=size, bottom_scale=1.0, top_scale=1.0, **shape)
                elif solid.shape == "box":
                    entity.cubes.add(size=size, **shape)
                else:
                    entity.spheres.add(size=size, **shape)
        self._send("/vehicles", message)


def make_messages(labels: Mapping[str, Sequence[str]], vectors: Collection[str]) -> dict[str, Any]:
    """Make a class of messages for each topic of `TOPICS`, with a field for each variable that a run has.

    The field of a variable is a number, or has a field for each of its labels, named like the label, with _ for
    characters that protobuf does not allow. Fields of `vectors` have several numbers. A variable with more labels than
    protobuf allows fields is a list of numbers in the order of its labels.
    """
    file = descriptor_pb2.FileDescriptorProto(name="mjsheaf.proto", package="mjsheaf", syntax="proto3")
    for topic, variables in TOPICS.items():
        message = file.message_type.add(name=topic.title())
        for k, variable in enumerate(name for name in variables if name in labels):
            own = message.field.add(name=variable, number=k + 1, type=_FIELD.TYPE_FLOAT, label=_FIELD.LABEL_OPTIONAL)
            if len(labels[variable]) > MAX_FIELDS:
                own.label = _FIELD.LABEL_REPEATED
            elif labels[variable]:
                own.type = _FIELD.TYPE_MESSAGE
                own.type_name = f".mjsheaf.{variable}"
                of_labels = file.message_type.add(name=variable)
                names = set[str]()
                several = _FIELD.LABEL_REPEATED if variable in vectors else _FIELD.LABEL_OPTIONAL
                for n, label in enumerate(labels[variable]):
                    plain = re.sub(r"\W", "_", label, flags=re.ASCII)
                    candidates = chain([plain], (f"{plain}_{m}" for m in count(2)))
                    name = next(name for name in candidates if name not in names)
                    names.add(name)
                    of_labels.field.add(name=name, number=n + 1, type=_FIELD.TYPE_FLOAT, label=several)
    classes = message_factory.GetMessages([file], descriptor_pool.DescriptorPool())
    kinds = {topic: classes[f"mjsheaf.{topic.title()}"] for topic in TOPICS}
    return {topic: kind for topic, kind in kinds.items() if kind.DESCRIPTOR.fields}


def _set_numbers(message: Any, field: str, values: Array) -> None:
    """Set a field that is one number, or a list of numbers."""
    if values.ndim:
        getattr(message, field).extend(values.ravel().tolist())
    else:
        setattr(message, field, float(values))


def _significant(values: Array, steps: float = 2.0**12) -> Array:
    """Round the mantissas of values, to a relative error of at most 1 / steps, so that they compress well."""
    with np.errstate(over="ignore", invalid="ignore"):
        mantissa, exponent = np.frexp(values)
        return np.asarray(np.ldexp(np.rint(mantissa * steps) / steps, exponent))


def turn_along(velocities: Array) -> tuple[list[list[float]], list[float]]:
    """Return the rounded quaternion x, y, z, w that turns the x axis along each velocity, and the velocity's norm."""
    speed = np.linalg.norm(velocities, axis=1)
    quaternions = np.zeros((len(velocities), 4))
    quaternions[:, 1] = -velocities[:, 2]
    quaternions[:, 2] = velocities[:, 1]
    quaternions[:, 3] = speed + velocities[:, 0]
    quaternions[quaternions[:, 3] <= 1e-6 * speed] = [0.0, 0.0, 1.0, 0.0]
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return (np.rint(quaternions * _TURNS) / _TURNS).tolist(), _significant(speed, _TURNS).tolist()


def _point(place: Sequence[float]) -> dict[str, float]:
    return {"x": place[0], "y": place[1], "z": place[2]}


def _quaternion(quaternion: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyzw", quaternion, strict=True))


def _colour(rgba: Any) -> dict[str, float]:
    return dict(zip("rgba", map(float, rgba), strict=True))
