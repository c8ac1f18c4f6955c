"""Shapes of vehicles in a page. Oracle: MuJoCo's own model of a vehicle's file, and the vertices in it."""

import base64
from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mjsheaf.show.solids import shapes_of
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from tests.builders import adding, altered


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("name", list_vehicles())
def test_solids_are_where_the_model_has_them(name: str) -> None:
    vehicle = load_vehicle(name)
    (kind, other), number = shapes_of([vehicle, vehicle, load_vehicle("hull" if name != "hull" else "wamv")])[0:2]
    assert number == [0, 0, 1]
    assert other["name"] != kind["name"] == name
    model = mujoco.MjModel.from_xml_path(str(vehicle.path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    seen = [g for g in range(model.ngeom) if model.geom_group[g] < 3 and model.geom_bodyid[g] > 0]
    assert len(kind["solids"]) == len(seen)
    places = np.array([solid["position"] for solid in kind["solids"]])
    there = data.geom_xpos[seen] - data.xpos[1]
    assert np.abs(places[np.lexsort(places.round(3).T)] - there[np.lexsort(there.round(3).T)]).max() < 1e-3
    assert (np.linalg.norm(there, axis=1) < kind["radius"]).all()
    assert any(solid["livery"] for solid in kind["solids"])
    assert kind["ahead"] == vehicle.steering.hand


def test_a_mesh_has_the_vertices_of_its_file(tmp_path: Path) -> None:
    """In the body frame, though MuJoCo keeps them about the mesh's own centre and axes."""
    corners = np.array(list(product((-1.3, 1.2), (-0.4, 0.4), (0.1, 0.8))))
    vertices = " ".join(f"{x:g}" for x in corners.ravel())
    geom = '<geom class="visual" type="mesh" mesh="hold" pos="0.3 0 0.1" euler="0 0 0.5" material="livery"/>'
    edit = adding(("asset", f'<mesh name="hold" vertex="{vertices}"/>'), ("worldbody/body", geom))
    (shape,), _ = shapes_of([load_vehicle(altered(tmp_path, "hull", edit))])
    (solid,) = [solid for solid in shape["solids"] if solid["shape"] == "mesh"]
    parts = (("vertices", "<f4"), ("faces", "<u4"))
    kept, faces = (np.frombuffer(base64.b64decode(solid[name]), kind) for name, kind in parts)
    own = Rotation.from_quat(np.roll(solid["quaternion"], -1)).apply(kept.reshape(-1, 3)) + solid["position"]
    wanted = Rotation.from_euler("z", 0.5).apply(corners) + np.array([0.3, 0.0, 0.1])
    away = np.linalg.norm(own[:, None] - wanted[None], axis=2)
    assert away.min(axis=0).max() < 1e-3
    assert away.min(axis=1).max() < 1e-3
    assert faces.max() < len(own)
    assert len(faces) == 3 * 12  # of a box
