"""A script, `probe.py BACKEND`: draw a small picture with one GL backend; exit 0 if it shows something.

It stands alone, and is run in a child process, because a bad driver may end the process.
"""

import os
import sys
from importlib import import_module


def main(backend: str) -> None:
    """Draw a white ball on a black background and look at the pixels."""
    import mujoco
    import numpy as np

    try:
        context = import_module(f"mujoco.{backend}").GLContext(64, 64)
        context.make_current()
    except AttributeError as error:
        # PyOpenGL has None where it does not find a library, and fails when that is used.
        raise RuntimeError("its library is not installed") from error
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
    model.vis.global_.offwidth = model.vis.global_.offheight = 64
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    scene = mujoco.MjvScene(model, 10)
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL.value, scene)
    renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, renderer)
    pixels = np.zeros((64, 64, 3), np.uint8)
    rectangle = mujoco.MjrRect(0, 0, 64, 64)
    mujoco.mjr_render(rectangle, scene, renderer)
    mujoco.mjr_readPixels(pixels, None, rectangle, renderer)
    if np.ptp(pixels) < 50:
        raise RuntimeError("it draws an empty picture")


if __name__ == "__main__":
    try:
        main(sys.argv[1])
    except Exception as error:
        print(str(error).strip() or type(error).__name__, file=sys.stderr, flush=True)
        os._exit(1)
    # Leave without running the drivers' own clean-up, which is where some of them crash.
    os._exit(0)
