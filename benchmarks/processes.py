"""Speed and memory of whole processes: how long a command takes to begin, a run with its video, and long runs."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.measuring import WANTED, Row, at_most, best, informs, timed
from mjsheaf.errors import MjsheafError

_FIRST_RUN = """
import mjsheaf
from time import perf_counter
scenario = mjsheaf.load_scenario("midpoint", {{"time.end": 0.1}})
begun = perf_counter()
mjsheaf.simulate(scenario, backend={backend!r})
print(perf_counter() - begun)
"""

# Linux counts the memory of the parent process as that of a new one, so a small process starts it.
_STARTER = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, usage = os.wait4(process.pid, 0)
process.returncode = os.waitstatus_to_exitcode(status)
print(process.returncode, usage.ru_maxrss)
"""


def _python(*arguments: str, **environment: str) -> str:
    """Run a Python process and return what it prints.

    Raises:
        MjsheafError: It failed.
    """
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, env={**os.environ, **environment}, check=False
    )
    if done.returncode:
        raise MjsheafError(f"python {arguments[:2]} exits with {done.returncode}: {done.stderr.strip()[-300:]}")
    return done.stdout


def startup(short: bool = False) -> list[Row]:
    """Measure whole processes by the clock, and first simulations in them, whose loops an earlier process compiled.

    The short version does not measure compiling.
    """
    rows = []
    for option in ("--help", "--version"):
        seconds = best(lambda option=option: _python("-m", "mjsheaf", option), 5 if short else 15)  # type: ignore[misc]
        what, wanted = f"mjsheaf {option}, s", WANTED["startup"]
        rows.append(at_most("startup", what, seconds, wanted, seconds / wanted, 1.0, "required time"))
    for backend in ("ideal", "physics"):
        code = _FIRST_RUN.format(backend=backend)
        _python("-c", code)  # compiles where no earlier process has
        seconds = min(float(_python("-c", code)) for _ in range(2))
        rows.append(informs("startup", f"first simulate() on {backend}, s", seconds))
    if not short:
        with tempfile.TemporaryDirectory() as folder:
            first, second = (best(lambda: _python("-c", code, NUMBA_CACHE_DIR=folder), 1) for _ in range(2))
        rows.append(informs("startup", "compiling, once on a machine, s", first - second))
    return rows


def memory(short: bool = False, ends: tuple[float, float] | None = None) -> list[Row]:
    """Measure the peak resident memory of `mjsheaf run midpoint`, 50 samples a second, in a process of its own.

    Args:
        short: True for runs of 200 and 2,000 s on ideal kinematics alone, not 1,000 and 10,000 s on both backends.
        ends: Other ends of the two runs, s.
    """
    ends = ends or ((200.0, 2000.0) if short else (1000.0, 10000.0))
    rows = []
    for backend in ("ideal",) if short else ("ideal", "physics"):
        peak_of(backend, 1.0)  # compiles what is not in the cache
        before, after = (peak_of(backend, end) for end in ends)
        what, note = f"peak of {ends[1]:g} s on {backend}, MB", f"the same of {ends[0]:g} s"
        rows.append(at_most("memory", what, after, before, after / before, WANTED["memory"], note))
    return rows


def peak_of(backend: str, end: float, *options: str) -> float:
    """Return the peak resident memory of a run of `midpoint` to time `end`, s, in MB; without options, with no video.

    Raises:
        MjsheafError: The run failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        where = ["--backend", backend, "--out", str(Path(folder) / "run")]
        command = ["run", "midpoint", *where, "--set", f"time.end={end:g}", *(options or ["--no-video"])]
        code, peak = map(int, _python("-c", _STARTER, sys.executable, "-m", "mjsheaf", *command).split())
    if code:
        raise MjsheafError(f"mjsheaf {' '.join(command)} exits with {code}")
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, kilobytes elsewhere
    return peak * unit / 1e6


def video(short: bool = False, end: float | None = None) -> list[Row]:
    """Measure `run --video` next to drawing the same frames with a bare `mujoco.Renderer`, and a draft.

    The bare renderer draws the same model from the same states with the same camera, size and multisampling, without
    shadows and reflections as ours. It draws no symbols and no text, and encodes nothing. The run is `paper` on
    bodies, 1280x720 at 30 frames a second, in a process that has everything imported and compiled: MuJoCo's renderer
    takes the variable MUJOCO_GL when it is imported.

    Args:
        short: True for the run's first 10 s instead of all 50 s. What does not depend on the length (plots, an arena, a
            model for the video) then weighs more.
        end: Another end of the run, s.
    """
    from mjsheaf.video.gl import available_backend

    backend, reason = available_backend()
    if backend is None:
        return [informs("video", "run with video", None, note=reason)]
    code = f"from benchmarks.processes import time_video; time_video({end or (10.0 if short else 50.0)})"
    root = Path(__file__).resolve().parents[1]  # where `benchmarks` is found
    t = json.loads(_python("-c", code, MUJOCO_GL=backend, PYTHONPATH=str(root)).strip().splitlines()[-1])
    frames, run, bare = t["frames"], t["run_s"], t["frames"] * t["bare_s"]
    frame, bare_frame = 1e3 * t["frame_s"], 1e3 * t["bare_s"]
    drawn, most = "a frame, drawn and encoded, ms", WANTED["video"]
    return [
        at_most("video", f"run with {frames} frames, s", run, bare, run / bare, most, "bare mujoco.Renderer"),
        at_most("video", drawn, frame, bare_frame, frame / bare_frame, most, "the same, bare"),
        informs("video", "the same run with a draft, s", t["draft_s"], run, "quality good"),
    ]


def time_video(end: float) -> None:
    """Time a run with its video in this process, and print JSON: `frames`; in s `run_s`, `draft_s`, and of a frame
    `frame_s` and, from the mean of some before and after, `bare_s`.
    """
    import mjsheaf
    from mjsheaf.runs.publish import execute
    from mjsheaf.video.draw import Painter
    from mjsheaf.video.film import film_of, video_options

    scenario = mjsheaf.load_scenario("paper", {"time.end": min(end, 49.99)})
    film, model = film_of(scenario, mjsheaf.simulate(scenario))
    drawn: list[float] = []

    def run(of: Any, quality: str) -> float:
        drawn.clear()

        def progress(what: str, done: int, total: int) -> None:
            if what == "drawing video":
                drawn.append(perf_counter())

        with tempfile.TemporaryDirectory() as folder:
            place, options = Path(folder) / "run", video_options(of, quality=quality)
            return timed(lambda: execute(of, "physics", place, video=options, progress=progress))[1]

    def bare() -> float:
        with Painter(film, model, video_options(scenario)) as painter:
            return _bare_frame(painter)

    run(mjsheaf.load_scenario("paper", {"time.end": 0.2}), "good")
    before, ours = bare(), run(scenario, "good")
    found = {"frames": len(drawn), "run_s": ours, "frame_s": (drawn[-1] - drawn[0]) / (len(drawn) - 1)}
    print(json.dumps({**found, "bare_s": (before + bare()) / 2, "draft_s": run(scenario, "draft")}), flush=True)
    os._exit(0)  # some drivers' own clean-up complains when two contexts end


def _bare_frame(painter: Any) -> float:
    """Time of a frame of MuJoCo's own renderer, s."""
    from mjsheaf.mujoco_import import mujoco
    from mjsheaf.video.scene import COSTLY

    width, height = painter.model.vis.global_.offwidth, painter.model.vis.global_.offheight
    renderer = mujoco.Renderer(painter.model, height, width)
    for flag in COSTLY:
        renderer.scene.flags[flag.value] = False
    camera = mujoco.MjvCamera()
    numbers = range(0, len(painter.times), max(1, len(painter.times) // 40))  # some 40 frames
    seconds = []
    for number in [*numbers[:3], *numbers]:  # the first few warm it up
        begun = perf_counter()
        _, view = painter.pose(number)
        camera.lookat, camera.distance = view.lookat, view.distance
        camera.azimuth, camera.elevation = view.azimuth, view.elevation
        renderer.update_scene(painter.data, camera)
        renderer.render()
        seconds.append(perf_counter() - begun)
    renderer.close()
    return sum(seconds[-len(numbers) :]) / len(numbers)
