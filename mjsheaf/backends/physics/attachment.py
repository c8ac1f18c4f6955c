"""A vehicle's MJCF made fit for the arena, where it must mean what it means when MuJoCo compiles it alone.

PyMJCF merges the compiler settings and options of what it attaches into those of the arena: a file in degrees would be
read in radians, and one with another gravity refused. So everything that such settings decide is written out.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from mjsheaf.backends.physics.vehicle import Vehicle
from mjsheaf.engine import mujoco, pymjcf
from mjsheaf.errors import InputError

_OF_THE_ARENA = ("compiler", "option", "size", "statistic", "visual")


def attachable(vehicle: Vehicle) -> mujoco.MjSpec:
    """Read a vehicle's file, fit to be attached.

    Orientations are in radians or quaternions, every body has the inertia of the compiled file, and what a vehicle
    cannot decide is gone: compiler settings, options, statistics, sizes and visuals, which are the arena's; keyframes,
    whose state has no free joint; and actuators with the sensors on them, as thrusters are made anew.

    Raises:
        InputError: PyMJCF cannot read the file, or not all of it.
    """
    mjcf = pymjcf()
    try:
        root = mjcf.from_path(str(vehicle.path))
    except (AttributeError, KeyError, OSError, RuntimeError, TypeError, ValueError) as error:  # its parser's own
        reason = error if isinstance(error, OSError) or not error.args else error.args[0]
        raise InputError(f"{vehicle.path}: PyMJCF cannot read it: {' '.join(str(reason).split())}") from None
    _write_orientations(root)
    _write_inertia(root, vehicle)
    for name in _OF_THE_ARENA:
        getattr(root, name).remove()
    on_actuators = [s for s in root.sensor.all_children() if "actuator" in s.get_attributes()]
    for element in [*on_actuators, *root.actuator.all_children(), *root.keyframe.all_children()]:
        element.remove()
    root.compiler.angle = "radian"
    kind = mujoco.MjSpec.from_string(root.to_xml_string(), assets=root.get_assets())
    for geom in kind.geoms:
        if "//unnamed" in geom.name:  # PyMJCF's own; a thousand vehicles compile faster without
            geom.name = ""
    return kind


def _write_orientations(root: Any) -> None:
    """Write angles in radians, and Euler angles, whose order of axes is a setting too, as quaternions."""
    unit = 1.0 if root.compiler.angle == "radian" else np.pi / 180.0  # MJCF's default is degrees
    sequence = root.compiler.eulerseq or "xyz"
    for element in _elements(root):
        attributes = element.get_attributes()
        if "axisangle" in attributes:
            element.axisangle = np.asarray(element.axisangle) * [1.0, 1.0, 1.0, unit]
        if "euler" in attributes:
            quaternion = np.empty(4)
            mujoco.mju_euler2Quat(quaternion, np.asarray(element.euler) * unit, sequence)
            del element.euler
            element.quat = quaternion


def _write_inertia(root: Any, vehicle: Vehicle) -> None:
    """Give every body the inertia that it has in the compiled file, from wherever it has it there."""
    bodies = root.find_all("body")  # in MuJoCo's order: depth first
    if len(bodies) != len(vehicle.inertials):
        raise InputError(
            f"{vehicle.path}: PyMJCF reads {len(bodies)} bodies of {len(vehicle.inertials)}; write each one out"
        )
    for body, inertial in zip(bodies, vehicle.inertials, strict=True):
        if body.inertial is not None:
            body.inertial.remove()
        body.add("inertial", **inertial)


def _elements(element: Any) -> Iterator[Any]:
    yield element
    for child in element.all_children():
        yield from _elements(child)
