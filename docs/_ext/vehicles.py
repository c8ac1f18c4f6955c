"""The page of vehicles: numbers out of their files, a picture, the response to a step, and speed against thrust."""

import hashlib
import shutil
from pathlib import Path
from typing import Any

import fields
import matplotlib.pyplot as plt
import mujoco
import numpy as np
import replays

import mjsheaf
from mjsheaf.vehicles.effects import authority_of
from mjsheaf.vehicles.loading import list_vehicles, load_vehicle
from mjsheaf.vehicles.vehicle import Vehicle
from mjsheaf.video.camera import View
from mjsheaf.video.gl import available_backend
from mjsheaf.video.scene import Renderer

_STEP = 1.0  # m/s, forward


def page(directory: Path) -> str:
    """Markdown of all vehicles; figures are written to the directory, all again when the program has changed."""
    key = hashlib.sha256(Path(__file__).read_bytes() + replays.program()).hexdigest()
    kept = directory / "key"
    if not kept.is_file() or kept.read_text() != key:
        shutil.rmtree(directory, ignore_errors=True)
    directory.mkdir(parents=True, exist_ok=True)
    text = "\n".join(_section(load_vehicle(name), directory) for name in list_vehicles())
    kept.write_text(key)
    return text


def _section(vehicle: Vehicle, directory: Path) -> str:
    d, can, tau = vehicle.description, vehicle.capability, vehicle.reduced_model().tau
    rows = [
        ("mass", "kg", f"{vehicle.mass:g}"),
        ("thrusters", "", f"{len(vehicle.actuators)}"),
        ("pushes", "", authority_of(vehicle).describe()),
        ("forward thrust", "N", _limit(can.forward_thrust)),
        ("forward speed", "m/s", _limit(can.forward_speed)),
        ("speed in the slowest direction", "m/s", _limit(can.least_speed)),
        ("time constant of the controlled velocity", "s", " ".join(f"{t:.3g}" for t in dict.fromkeys(tau.round(3)))),
        ("linear drag: surge, sway, heave", "N s/m", _triple(vehicle.drag)),
        ("quadratic drag: surge, sway, heave", "N s^2/m^2", _triple(vehicle.quadratic_drag[:3])),
        ("added mass: surge, sway, heave", "kg", _triple(vehicle.added_mass[:3])),
        ("rate of the autopilot k_v", "1/s", f"{vehicle.rate:g}" if vehicle.rate else "none"),
    ]
    if vehicle.windage.any():
        rows.append(("force of a wind of 10 m/s: ahead, abeam", "N", _triple(100.0 * vehicle.windage[:2])))
    table = "\n".join(f"| {what} | {unit} | {value} |" for what, unit, value in rows)
    lines = [f"## {vehicle.name}\n", f"{fields.prose(d.summary[:1].upper() + d.summary[1:])}.\n"]
    lines += [f"Numbers: {fields.prose(d.source)}.\n"] if d.source else []
    if _draw(vehicle, directory / f"{vehicle.name}_picture.png"):
        lines.append(f"![{vehicle.name}](../generated/vehicles/{vehicle.name}_picture.png)\n")
    lines += ["| | | |", "|---|---|---|", table, ""]
    if not vehicle.actuators:
        return "\n".join(lines)
    _plot(vehicle, directory / f"{vehicle.name}.svg")
    lines.append(
        f"![Step response, and speed against thrust, of {vehicle.name}](../generated/vehicles/{vehicle.name}.svg)\n"
    )
    return "\n".join(lines)


def _limit(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}" if np.isfinite(value) else "no limit"


def _triple(values: Any) -> str:
    return ", ".join(f"{v:.4g}" for v in values)


def _plot(vehicle: Vehicle, path: Path) -> None:
    """Forward velocity after a step of 1 m/s, and steady forward speed against thrust."""
    if path.is_file():
        return
    time, speed = _step_response(vehicle)
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 2.6), layout="constrained")
    left.plot(time, speed)
    left.axhline(_STEP, color="grey", linewidth=0.8)
    left.set(xlabel="time (s)", ylabel="forward speed (m/s)", title=f"command of {_STEP:g} m/s from rest")
    fastest = vehicle.capability.forward_speed
    v = np.linspace(0.0, fastest if np.isfinite(fastest) else 10.0, 100)
    right.plot(vehicle.drag[0] * v + vehicle.quadratic_drag[0] * v**2, v)
    right.set(xlabel="forward thrust (N)", ylabel="steady forward speed (m/s)", title="thrust that drag takes")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def _step_response(vehicle: Vehicle) -> tuple[Any, Any]:
    """Time, s, and forward speed of the controlled point, m/s, of one vehicle that is commanded to 1 m/s from rest."""
    start = [0.0, 0.0, 10.0][: vehicle.dimension]
    scenario = mjsheaf.load_scenario(
        {
            "name": "step",
            "time": {"end": 5.0},
            "agents": [{"id": "A1", "position": start, "vehicle": vehicle.name}],
            "targets": [{"id": "T1", "position": start}],
            "sensing": [["A1", "T1"]],
        }
    )
    command = np.array([[_STEP, 0.0, 0.0]])
    result = mjsheaf.simulate(scenario, controller=lambda t, sample: command)
    return result.time.values, result.agent_velocity.values[:, 0, 0]


def _draw(vehicle: Vehicle, path: Path) -> bool:
    """Draw a vehicle; False where no OpenGL is there to draw with."""
    if path.is_file():
        return True
    backend, _ = available_backend()
    if backend is None:
        return False
    spec = mujoco.MjSpec.from_file(str(vehicle.path))
    spec.worldbody.add_light(pos=[0, 0, 10], dir=[0.2, 0.3, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
    spec.visual.headlight.ambient = [0.5, 0.5, 0.5]
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[1, 1, 1], rgb2=[0.8, 0.88, 0.95], width=64, height=384,
    )  # fmt: skip
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    lookat = data.geom_xpos.mean(axis=0)
    view = View(lookat=lookat, distance=1.5 * model.stat.extent, azimuth=145.0, elevation=-25.0, fovy=45.0)
    renderer = Renderer(model, 480, 320, backend, 0)
    try:
        renderer.draw(data, view, lambda scene: []).save(path)
    finally:
        renderer.close()
    return True
