"""What `run --video` takes beside drawing the same frames with a bare `mujoco.Renderer`, and what a draft takes.

The bare renderer draws the same model from the same states with the same camera, size and multisampling, without
shadows and reflections as ours. It draws no decoration and no writing, and encodes nothing.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from mjsheaf.bench.rows import Row, at_most, informs
from mjsheaf.errors import MjsheafError

WANTED = 1.15
"""Wanted: time of a run with its video, over that of bare drawing."""

_BARE_FRAMES = 40  # drawn before the run, and again after it


def measure(short: bool = False, end: float | None = None) -> dict[str, Any]:
    """Run `paper` on bodies with its video, 1280x720 at 30 frames a second.

    A child process does it, as MuJoCo's own renderer takes the variable MUJOCO_GL when it is imported.

    Args:
        short: the run's first 10 s instead of all 50 s. What does not depend on the length (plots, an arena, a film)
            then weighs more.
        end: another end of the run, s.

    Returns:
        `frames`; `run_s`: simulation, files, plots and video, in a process that has everything imported and compiled;
        `bare_s`: bare drawing of as many frames, from the mean of some before and after; `ratio`: of these two;
        `frame_ms` and `bare_ms`: of a frame, ours drawn and encoded; `frame_ratio`; `draft_s`: as `run_s`, of a draft.
        Empty, but for `reason`, where no OpenGL works.
    """
    from mjsheaf.video.gl import available_backend

    backend, reason = available_backend()
    if backend is None:
        return {"reason": reason}
    seconds = end or (10.0 if short else 50.0)
    code = f"from mjsheaf.bench.video import child; child({seconds})"
    found = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "MUJOCO_GL": backend}, capture_output=True, text=True
    )
    if found.returncode:
        raise MjsheafError(f"the video could not be measured: {found.stderr.strip().splitlines()[-1:]}")
    figures: dict[str, Any] = json.loads(found.stdout.strip().splitlines()[-1])
    return figures


def child(end: float) -> None:
    """Measure in this process and print JSON."""
    import mjsheaf
    from mjsheaf.filming import film_of, video_options
    from mjsheaf.runs.publish import execute
    from mjsheaf.video.draw import Painter

    scenario = mjsheaf.load_scenario("paper", {"time.end": min(end, 49.99)})
    first = mjsheaf.load_scenario("paper", {"time.end": 0.2})
    film, model = film_of(scenario, mjsheaf.simulate(scenario))
    drawn: dict[str, list[float]] = {}

    def run(of: Any, quality: str) -> float:
        drawn[quality] = []

        def progress(what: str, done: int, total: int) -> None:
            if what == "drawing video":
                drawn[quality].append(time.perf_counter())

        with tempfile.TemporaryDirectory() as folder:
            begun = time.perf_counter()
            execute(of, "physics", Path(folder) / "run", video=video_options(of, quality=quality), progress=progress)
            return time.perf_counter() - begun

    run(first, "good")
    with Painter(film, model, video_options(scenario)) as painter:
        before = _bare(painter)
    ours = run(scenario, "good")
    with Painter(film, model, video_options(scenario)) as painter:
        after = _bare(painter)
    bare = (before + after) / 2
    frames = len(drawn["good"])
    frame = (drawn["good"][-1] - drawn["good"][0]) / (frames - 1)
    draft = run(scenario, "draft")
    figures = {
        "frames": frames,
        "run_s": ours,
        "bare_s": bare * frames,
        "ratio": ours / (bare * frames),
        "frame_ms": 1e3 * frame,
        "bare_ms": 1e3 * bare,
        "frame_ratio": frame / bare,
        "draft_s": draft,
        "draft_frames": len(drawn["draft"]),
    }
    print(json.dumps(figures), flush=True)
    os._exit(0)  # some drivers' own clean-up complains when two contexts end


def _bare(painter: Any) -> float:
    """Time of a frame of MuJoCo's own renderer, s."""
    from mjsheaf.engine import mujoco
    from mjsheaf.video.renderer import COSTLY

    width, height = painter.model.vis.global_.offwidth, painter.model.vis.global_.offheight
    renderer = mujoco.Renderer(painter.model, height, width)
    for flag in COSTLY:
        renderer.scene.flags[flag.value] = False
    camera = mujoco.MjvCamera()
    numbers = range(0, len(painter.times), max(1, len(painter.times) // _BARE_FRAMES))
    seconds = 0.0
    for number in [*numbers[:3], *numbers]:
        if number == numbers[0]:
            seconds = 0.0  # the first few warm it up
        begun = time.perf_counter()
        _, view = painter.pose(number)
        camera.lookat, camera.distance = view.lookat, view.distance
        camera.azimuth, camera.elevation = view.azimuth, view.elevation
        renderer.update_scene(painter.data, camera)
        renderer.render()
        seconds += time.perf_counter() - begun
    renderer.close()
    return seconds / len(numbers)


def rows(figures: dict[str, Any]) -> list[Row]:
    """The figures of `measure` against what is wanted."""
    if "ratio" not in figures:
        return [informs("video", "run with video", None, note=figures["reason"])]
    frames, run, bare = figures["frames"], figures["run_s"], figures["bare_s"]
    what, note = f"run with {frames} frames, s", "bare mujoco.Renderer"
    return [
        at_most("video", what, run, bare, figures["ratio"], WANTED, note),
        at_most(
            "video", "a frame, drawn and encoded, ms", figures["frame_ms"], figures["bare_ms"], figures["frame_ratio"],
            WANTED, "the same, bare",
        ),
        informs("video", "the same run with a draft, s", figures["draft_s"], run, "quality good"),
    ]  # fmt: skip
