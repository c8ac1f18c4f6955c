"""Vehicles larger than life, so that they can be seen across a formation a hundred times their size."""

import mujoco
import numpy as np

from mjsheaf.video.series import FloatArray, IntArray


def enlarge_vehicles(model: mujoco.MjModel, body_id: IntArray, scale: float) -> None:
    """Scale what is drawn of each vehicle about its root body's origin; the model is then for drawing only.

    Args:
        model: changed.
        body_id: the vehicles' root bodies. Shape (V,).
        scale: 1 leaves everything as it is.
    """
    if scale == 1:
        return
    bodies = np.flatnonzero(np.isin(model.body_rootid, body_id))
    parts = bodies[~np.isin(bodies, body_id)]  # a root body's own place is in qpos
    model.body_pos[parts] *= scale
    joints = np.isin(model.jnt_bodyid, parts)
    model.jnt_pos[joints] *= scale
    geoms = _geoms(model, body_id)
    model.geom_pos[geoms] *= scale
    model.geom_size[geoms] *= scale
    model.geom_rbound[geoms] *= scale
    sites = np.isin(model.site_bodyid, bodies)
    model.site_pos[sites] *= scale
    model.site_size[sites] *= scale
    # A mesh's size is in its vertices; one that the arena has too is scaled there as well.
    meshes = geoms[model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_MESH.value]
    for mesh in np.unique(model.geom_dataid[meshes]):
        start = model.mesh_vertadr[mesh]
        model.mesh_vert[start : start + model.mesh_vertnum[mesh]] *= scale


def vehicle_radius(model: mujoco.MjModel, body_id: IntArray) -> float:
    """Return a radius about a root body's origin that holds the largest vehicle, in m; at least 0.1 m."""
    # How far a body's origin can be from its root's, whichever way its joints turn; parents come before children.
    reach = np.zeros(model.nbody)
    for body in np.flatnonzero(np.isin(model.body_rootid, body_id) & ~np.isin(np.arange(model.nbody), body_id)):
        reach[body] = reach[model.body_parentid[body]] + np.linalg.norm(model.body_pos[body])
    geoms = _geoms(model, body_id)
    offsets: FloatArray = np.linalg.norm(model.geom_pos[geoms], axis=1)
    return float((reach[model.geom_bodyid[geoms]] + offsets + model.geom_rbound[geoms]).max(initial=0.1))


def _geoms(model: mujoco.MjModel, body_id: IntArray) -> IntArray:
    return np.flatnonzero(np.isin(model.body_rootid[model.geom_bodyid], body_id))
