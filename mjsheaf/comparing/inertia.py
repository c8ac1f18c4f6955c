"""The time constant that inertia alone gives a vehicle."""

import numpy as np
from numpy.typing import NDArray

from mjsheaf.backends.physics import Vehicle

Array = NDArray[np.float64]


def inertial_tau(vehicle: Vehicle) -> Array:
    """M / (M k_v + D) of the controlled velocity along body axes at low speed, shape (n,), s; thrusters do not lag.

    `ReducedModel.tau` has their lag too.
    """
    rows = [0, 5] if vehicle.control == "hand_point" else [0, 1, 2][: vehicle.dimension]
    mass, drag = vehicle.moving_mass[rows], np.concatenate([vehicle.drag, vehicle.angular_drag])[rows]
    return np.asarray(mass / (mass * vehicle.rate + drag))
