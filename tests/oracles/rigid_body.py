"""A rigid body and its attitude hold, after Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2011.

Section 3.3 has the mass matrix about an origin that is not the centre of mass. The hold is that of
`docs/mathematics.md`; its frequency and damping are the vehicle's own.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mjsheaf.vehicles.vehicle import Vehicle

Array = NDArray[np.float64]


def skew(a: Array) -> Array:
    """Return the matrix of a x (3, 3)."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def rigid_mass(vehicle: Vehicle) -> Array:
    """Return M_RB about the origin from mass, centre of mass and inertia, shape (6, 6)."""
    mS = vehicle.mass * skew(vehicle.centre_of_mass)
    return np.block([[vehicle.mass * np.eye(3), -mS], [mS, vehicle.inertia]])


def inertia_about_centre(vehicle: Vehicle) -> Array:
    """Return the inertia about the centre of mass, by the parallel-axis theorem, kg m^2, shape (3, 3)."""
    c = vehicle.centre_of_mass
    return np.asarray(vehicle.inertia - vehicle.mass * (c @ c * np.eye(3) - np.outer(c, c)))


def hold_moment(vehicle: Vehicle, R: Array, wanted: Array, rates: Array) -> Array:
    """Return J (k theta - b omega) toward an attitude, theta twice the vector part of the quaternion to it, N m."""
    hold = vehicle.hold
    theta = 2.0 * Rotation.from_matrix(R.T @ wanted).as_quat(canonical=True)[:3]
    J = inertia_about_centre(vehicle) + np.diag(vehicle.added_mass[3:])
    return np.asarray(J @ (hold.frequency**2 * theta - 2.0 * hold.damping * hold.frequency * rates))
