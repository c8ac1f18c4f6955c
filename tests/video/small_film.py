"""A run of three agents and two targets, small enough to be drawn in a test."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from mjsheaf.video import Film

AGENTS, TARGETS = 3, 2


def make_model() -> mujoco.MjModel:
    """Five free bodies, each a box with a ball on a hinge, over a translucent plane."""
    bodies = "".join(
        f"""
        <body name="vehicle{number}"><freejoint/>
          <geom name="box{number}" type="box" size="1 .5 .3" rgba="{number % 2} .5 .2 1"/>
          <body pos="2 0 0"><joint type="hinge"/><geom name="ball{number}" size=".2" pos=".5 0 0"/></body>
        </body>"""
        for number in range(AGENTS + TARGETS)
    )
    return mujoco.MjModel.from_xml_string(
        f"""
        <mujoco>
          <asset><texture type="skybox" builtin="gradient" rgb1=".7 .8 .9" rgb2=".1 .1 .2" width="32" height="192"/></asset>
          <worldbody>
            <light directional="true" dir="0 0 -1"/>
            <geom name="water" type="plane" size="0 0 1" rgba=".1 .4 .6 .5"/>{bodies}
          </worldbody>
        </mujoco>"""  # noqa: E501
    )


def make_film(model: mujoco.MjModel, duration: float = 2.0, samples: int = 41, **changes: Any) -> Film:
    """Agents circle on the water, targets 10 m below them; `changes` replaces fields."""
    time = np.linspace(0.0, duration, samples)
    vehicles = AGENTS + TARGETS
    phase = time[:, None] + 2 * np.pi * np.arange(vehicles) / vehicles
    positions = np.stack([20 * np.cos(phase), 20 * np.sin(phase), np.zeros_like(phase)], axis=-1)
    positions[:, AGENTS:, 2] = -10
    quaternions = np.stack([np.cos(phase / 2), 0 * phase, 0 * phase, np.sin(phase / 2)], axis=-1)
    bodies = np.array([model.body(f"vehicle{number}").id for number in range(vehicles)])
    film = Film(
        name="small",
        subtitle="made up",
        time=time,
        agent_ids=["A1", "A2", "A3"],
        target_ids=["T1", "T2"],
        positions=positions,
        quaternions=quaternions,
        qpos_address=model.jnt_qposadr[model.body_jntadr[bodies]],
        body_id=bodies,
        harmonic_extension=positions[:, :AGENTS] + [3.0, 0.0, 0.0],
        group=np.array([0, 0, 1, 2, 2]),
        group_names=["pair", "single", "targets"],
        colours=np.array([[0.2, 0.6, 1.0], [1.0, 0.6, 0.2], [1.0, 0.3, 0.3]]),
        edges=[(0, 1, "communication"), (1, 2, "communication"), (0, 3, "sensing"), (2, 4, "sensing")],
        error_name="mean |eta|",
        error=10.0 * np.exp(-time),
        error_unit="m",
        surface="water",
    )
    return replace(film, **changes)
