"""Shared fixtures."""

import fcntl
import gc
import hashlib
import os
import pickle
import re
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import xarray as xr
from hypothesis import settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tests.commands import Answer, Published

settings.register_profile("fast", deadline=None, derandomize=True, max_examples=20)
settings.register_profile("all", deadline=None, derandomize=False, print_blob=True, max_examples=100)
settings.load_profile("fast")  # `make test-all` uses --hypothesis-profile=all


ALSO_SHOWN = ("noisy_harbour", "paper_delay", "paper_half_lost", "swarm_radio_shadow")
"""Scenarios that ship and are others over links, or large: what is tried of each one is tried of them with the long."""


@pytest.hookimpl(tryfirst=True)  # before tests are selected by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as long what continuous integration leaves out; what is long is slow, too.

    That is all of some scenarios, and slow tests, but for the first example of those that are marked `slow(first=True)`
    and all examples with `slow(each=True)`, as where each is of another scenario.
    """
    for item in items:
        if not {*re.split(r"[\[\]-]", item.name)}.isdisjoint(ALSO_SHOWN):
            item.add_marker(pytest.mark.long)
    begun: set[str] = set()
    for item in items:
        mark, test = item.get_closest_marker("slow"), item.nodeid.partition("[")[0]
        if mark and not mark.kwargs.get("each") and not item.get_closest_marker("long"):
            if test in begun or not mark.kwargs.get("first"):
                item.add_marker(pytest.mark.long)
            begun.add(test)
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)


def pytest_collection_finish() -> None:
    """Look for garbage rarely, and not among the tests themselves: that took a twentieth of the time."""
    gc.set_threshold(10_000, 10, 10)
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _plain_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """No colours and a known width, whatever terminal the tests run in."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "160")


@pytest.fixture(params=["mujoco", pytest.param("fused", marks=pytest.mark.slow)])
def engine(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A test of a vehicle that is alone runs on both engines."""
    monkeypatch.setattr("tests.loop.one_vehicle.ENGINE", request.param)


def draw_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs draw no plots and an empty page."""
    monkeypatch.setattr("mjsheaf.runs.publish._plots_of", lambda *_: {})
    for module in ("mjsheaf.page.page", "mjsheaf.runs.publish"):
        monkeypatch.setattr(f"{module}.page_of", lambda *_, **__: b"")


@pytest.fixture
def without_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs draw no plots and an empty page, which take longer than a short run does."""
    draw_nothing(monkeypatch)


@pytest.fixture
def in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python carries out runs on ideal kinematics.

    A few periods of a loop that no other test has take less than compiling it.
    """
    from mjsheaf.compile.tiers import Tiered
    from mjsheaf.loop import ideal

    monkeypatch.setattr(ideal, "_run", Tiered(ideal._run, seconds=1e3, numbers=float("inf"), records=True))


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> "list[Figure]":
    """The figures that are written meanwhile, in place of their files."""
    figures: list[Figure] = []
    monkeypatch.setattr("mjsheaf.show.plots.write_figure", lambda figure, file, form: figures.append(figure))
    return figures


@pytest.fixture(scope="module")
def running_browser() -> Iterator[Any]:
    """A real browser without a network; see `tests/page/browser.py`."""
    from tests.page.browser import open_browser

    with open_browser() as opened:
        yield opened


@pytest.fixture
def browser(running_browser: Any) -> Iterator[Any]:
    """The same, whose pages are closed after the test: each goes on drawing, without a GPU."""
    yield running_browser
    for context in running_browser.contexts:
        context.close()


@pytest.fixture(scope="session")
def mjsheaf() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line in a process of its own."""
    from tests.commands import command_line

    def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run(command_line(*arguments), capture_output=True, text=True, timeout=280, check=False)

    return run


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[], Any]], Any]:
    """`once(name, make)`: what `make` makes, once in a session, by the first test and process that asks.

    It is kept on the disk; everybody gets a copy.
    """
    own = tmp_path_factory.getbasetemp()
    folder = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "once"
    folder.mkdir(exist_ok=True)

    def get(name: str, make: Callable[[], Any]) -> Any:
        path = folder / f"{name}.pickle"
        with path.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                half = path.with_suffix(".half")
                half.write_bytes(pickle.dumps(make()))
                half.rename(path)
        return pickle.loads(path.read_bytes())

    return get


@pytest.fixture(scope="session")
def checked(once: Callable[[str, Callable[[], Any]], Any]) -> Callable[[str], Any]:
    """`checked(name)`: how `mjsheaf check NAME --json` ends for a scenario that ships, once in a session."""
    from tests.commands import answer_of

    return lambda name: once(f"check-{name}", lambda: answer_of("check", name, "--json"))


@pytest.fixture(scope="session")
def published(once: Callable[[str, Callable[[], Any]], Any], tmp_path_factory: pytest.TempPathFactory) -> "Published":
    """`published(name, backend)`: how `mjsheaf run NAME --expect` ended and its directory, once in a session.

    The run has its whole length. Its plots and its page, which take longer than it does, are those of `without_plots`.
    """
    from tests.commands import answer_of

    def run(name: str, backend: str) -> "tuple[Answer, Path]":
        out = tmp_path_factory.mktemp(f"{name}-{backend}") / "out"
        with pytest.MonkeyPatch.context() as without:
            draw_nothing(without)
            return answer_of("run", name, "--backend", backend, "--expect", "--no-video", "--out", out), out

    return lambda name, backend: once(f"{name}-{backend}", lambda: run(name, backend))


@pytest.fixture(scope="session")
def simulated(once: Callable[[str, Callable[[], Any]], Any], published: "Published") -> Callable[..., xr.Dataset]:
    """`simulated(name, backend, overrides)`: what `simulate` returns for a scenario that ships, once in a session."""
    from mjsheaf import load_scenario, simulate

    def run(name: str, backend: str, overrides: dict[str, object] | None = None) -> xr.Dataset:
        if not overrides:
            return xr.load_dataset(published(name, backend)[1] / "result.nc", engine="h5netcdf")
        digest = hashlib.sha256(repr(sorted(overrides.items())).encode()).hexdigest()[:12]
        data: xr.Dataset = once(f"{name}-{backend}-{digest}", lambda: simulate(load_scenario(name, overrides), backend))
        return data

    return run
