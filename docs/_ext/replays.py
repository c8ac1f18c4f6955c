"""The replay of every scenario, a picture of it and its numbers, made when the site is built.

They are kept in build/replays and made again when the scenario, a vehicle, the program or a package that computes or
draws has changed. `make docs REPLAYS="paper swap"` makes those alone: other pages are without.
"""

import hashlib
import json
import os
import shutil
from concurrent.futures import Future, ProcessPoolExecutor
from functools import cache
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from mjsheaf.scenario import list_scenarios

REPOSITORY = Path(__file__).resolve().parents[2]
KEPT = REPOSITORY / "build" / "replays"
RUN_AS = {
    "air_tracks_surface": ("--allow-drift", {}),
    "lost_thruster": ("--set agents.A2.effectiveness=null", {"agents.A2.effectiveness": None}),
}
"""Scenarios that are refused as they stand: with which option, and override, their page shows a run."""

_RUN_BY = ("mujoco", "numpy", "scipy", "numba", "matplotlib")
_PICTURE: dict[str, Any] = {"width": 900, "height": 406, "fps": 1, "quality": "good"}
_MOMENT = 0.4  # of the run, that the picture shows


def shown() -> list[str]:
    """Names of the scenarios whose pages have a replay."""
    return os.environ.get("REPLAYS", "").split() or list(list_scenarios())


def replay_of(name: str) -> Path:
    """The directory with a scenario's `report.html`, `summary.json` and, where OpenGL works, `picture.jpg`."""
    return KEPT / name


@cache
def begin() -> list[Future[None]]:
    """Begin to make what is missing or stale, on every core: the examples, which run one by one, leave cores idle."""
    stale = [name for name in shown() if not _is_fresh(name)]
    if not stale:
        return []
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    pool = ProcessPoolExecutor(min(len(stale), os.cpu_count() or 1), get_context("spawn"))
    made = [pool.submit(make, name) for name in stale]
    pool.shutdown(wait=False)
    return made


def make_all() -> None:
    """Make what is missing or stale; return when all is there."""
    for made in begin():
        made.result()


def make(name: str) -> None:
    """Run a scenario on bodies, and keep what its page shows."""
    from mjsheaf import load_scenario, simulate
    from mjsheaf.page.page import page_of
    from mjsheaf.runs.publish import account_of

    option, changes = RUN_AS.get(name, ("", {}))
    scenario = load_scenario(name, changes)
    result = simulate(scenario, allow_drift=option == "--allow-drift")
    summary, bounds, _ = account_of(scenario, scenario.phases, result)
    summary = summary | {"origin": name}
    again = f"mjsheaf run {name} {option}".strip(), ""
    page = page_of(scenario, scenario.phases, result, summary, bounds, notes=summary["notes"], again=again)
    to = replay_of(name)
    shutil.rmtree(to, ignore_errors=True)
    to.mkdir(parents=True)
    (to / "report.html").write_bytes(page)
    (to / "summary.json").write_text(json.dumps(summary))
    _draw(scenario, result, to / "picture.jpg")
    print(f"replay of {name}", flush=True)
    (to / "key").write_text(_key(name))


def _draw(scenario: Any, dataset: Any, path: Path) -> None:
    """One frame of the run's video; nothing where no OpenGL is there to draw with."""
    from mjsheaf.video.draw import Painter
    from mjsheaf.video.film import film_of, video_options
    from mjsheaf.video.gl import available_backend

    if available_backend()[0] is None:
        return
    film, model = film_of(scenario, dataset)
    with Painter(film, model, video_options(scenario, **_PICTURE)) as painter:
        frame = painter.draw(int(_MOMENT * len(painter.times)))()
        frame.crop((frame.width - 720, 0, *frame.size)).save(path, quality=82)


def _is_fresh(name: str) -> bool:
    key = replay_of(name) / "key"
    return key.is_file() and key.read_text() == _key(name)


def _key(name: str) -> str:
    file = (REPOSITORY / "scenarios" / f"{name}.yaml").read_bytes()
    return hashlib.sha256(file + program()).hexdigest()


@cache
def program() -> bytes:
    """A digest of all that makes a replay, but the scenario: the program, the vehicles and what they are run by."""
    found = hashlib.sha256(" ".join(f"{name} {version(name)}" for name in _RUN_BY).encode())
    for directory, pattern in (("mjsheaf", "*.*"), ("models", "*")):
        for path in sorted((REPOSITORY / directory).rglob(pattern)):
            if path.is_file() and path.suffix in (".py", ".js", ".css", ".html", ".xml", ".yaml"):
                found.update(path.read_bytes())
    found.update(Path(__file__).read_bytes())
    return found.digest()


def summary_of(name: str) -> dict[str, Any]:
    """Read the summary.json of a run."""
    found: dict[str, Any] = json.loads((replay_of(name) / "summary.json").read_text())
    return found
