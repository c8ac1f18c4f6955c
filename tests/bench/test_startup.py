"""A command imports little before it starts, and a second process finds its kernels compiled."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.commands import IDEAL, python

HEAVY = {"mujoco", "numba", "llvmlite", "matplotlib", "scipy", "numpy", "xarray", "networkx", "yaml", "PIL", "pydantic"}

_COMMANDS = """
import json, sys
from mjsheaf.cli import main
loaded = []
for arguments in {commands!r}:
    try:
        main(arguments)
    except SystemExit as stopped:
        assert not stopped.code, stopped.code
    loaded.append(sorted(sys.modules))
print(json.dumps(loaded))
"""

_SIMULATION = """
import json, sys
import mjsheaf
from numba.core.dispatcher import Dispatcher
scenario = mjsheaf.load_scenario("midpoint", {{"time.end": 0.1, "controller.control_period": {period}}})
mjsheaf.simulate(scenario, backend={backend!r})
kernels = {{
    id(value): value
    for name, module in list(sys.modules.items()) if name.startswith("mjsheaf")
    for value in vars(module).values() if isinstance(value, Dispatcher)
}}
count = lambda of: sum(sum(getattr(kernel.stats, of).values()) for kernel in kernels.values())
print(json.dumps([count("cache_hits"), count("cache_misses")]))
"""


def last_line(code: str) -> list[Any]:
    done = python(code)
    assert done.returncode == 0, done.stderr
    found: list[Any] = json.loads(done.stdout.splitlines()[-1])
    return found


@pytest.mark.parametrize(
    ("commands", "may_load"),
    [
        ([["--help"], ["--version"]], set()),
        ([["run", "--help"], ["sweep", "--help"]], {"pydantic"}),
        ([["list"], ["schema"]], {"numpy", "scipy", "yaml", "numba", "llvmlite", "pydantic"}),
    ],
    ids=["help", "help on a command", "list"],
)
def test_a_command_loads_only_what_it_needs(commands: list[list[str]], may_load: set[str]) -> None:
    for command, modules in zip(commands, last_line(_COMMANDS.format(commands=commands)), strict=True):
        assert HEAVY & {name.partition(".")[0] for name in modules} <= may_load, command


@pytest.mark.long
def test_an_ideal_run_without_video_loads_no_drawing(tmp_path: Path) -> None:
    """MuJoCo it does load: the files of the vehicles are checked by its compiler before anything is simulated."""
    run = ["run", "midpoint", *IDEAL, "--out", str(tmp_path / "o")]
    (loaded,) = last_line(_COMMANDS.format(commands=[run]))
    assert not {"OpenGL", "imageio_ffmpeg", "scipy.signal"} & set(loaded)


@pytest.mark.long
def test_an_ideal_simulation_in_python_loads_neither_mujoco_nor_plots() -> None:
    run = "mjsheaf.simulate(mjsheaf.load_scenario('midpoint', {'time.end': 0.1}), 'ideal')"
    loaded = last_line(f"import json, sys, mjsheaf\n{run}\nprint(json.dumps(list(sys.modules)))")
    assert not {"mujoco", "matplotlib"} & set(loaded)


@pytest.mark.slow(first=True)
@pytest.mark.parametrize("period", [0.02, 0], ids=["held", "continuous"])
@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_a_second_process_compiles_nothing(backend: str, period: float) -> None:
    code = _SIMULATION.format(backend=backend, period=period)
    hits, misses = last_line(code)
    if misses:  # the first process compiled
        hits, misses = last_line(code)
    assert hits > 0
    assert misses == 0
