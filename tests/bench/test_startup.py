"""A command imports little before it starts, and a second process finds its kernels compiled."""

import json
import subprocess
import sys

import pytest

import mjsheaf

HEAVY = {
    "mujoco",
    "numba",
    "llvmlite",
    "matplotlib",
    "scipy",
    "numpy",
    "xarray",
    "networkx",
    "yaml",
    "PIL",
}

_COMMAND = """
import json, sys
from mjsheaf.cli import main
try:
    main({arguments!r})
except SystemExit as stopped:
    assert not stopped.code, stopped.code
print(json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})))
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


def last_line(code: str) -> list[object]:
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = json.loads(run.stdout.splitlines()[-1])
    assert isinstance(found, list)
    return found


@pytest.mark.slow(each=True)
@pytest.mark.parametrize(
    ("arguments", "may_load"),
    [
        (["--help"], set()),
        (["--version"], set()),
        (["run", "--help"], set()),
        (["list"], {"numpy", "scipy", "yaml", "numba", "llvmlite"}),
        (["schema"], {"numpy", "scipy", "yaml", "numba", "llvmlite"}),
        (["sweep", "--help"], set()),
    ],
    ids=lambda value: "-".join(sorted(value)) or "nothing",
)
def test_a_command_loads_only_what_it_needs(arguments: list[str], may_load: set[str]) -> None:
    assert HEAVY & set(last_line(_COMMAND.format(arguments=arguments))) <= may_load


@pytest.mark.long
def test_an_ideal_run_without_video_loads_no_drawing(tmp_path: object) -> None:
    """MuJoCo it does load: the files of the vehicles are checked by its compiler before anything is simulated."""
    arguments = [
        "run",
        "midpoint",
        "--backend",
        "ideal",
        "--no-video",
        "--set",
        "time.end=0.1",
        "--out",
        f"{tmp_path}/o",
    ]
    loaded = set(last_line(_COMMAND.format(arguments=arguments).replace('.partition(".")[0]', "")))
    assert not {"OpenGL", "imageio_ffmpeg", "scipy.signal"} & loaded


@pytest.mark.long
def test_an_ideal_simulation_in_python_loads_neither_mujoco_nor_plots() -> None:
    code = (
        "import json, sys, mjsheaf\nmjsheaf.simulate(mjsheaf.load_scenario('midpoint', {'time.end': 0.1}), 'ideal')\n"
    )
    loaded = set(last_line(code + "print(json.dumps(list(sys.modules)))"))
    assert not {"mujoco", "matplotlib"} & loaded


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.02, 0], ids=["held", "continuous"])
@pytest.mark.parametrize("backend", ["ideal", "physics"])
def test_a_second_process_compiles_nothing(backend: str, period: float) -> None:
    code = _SIMULATION.format(backend=backend, period=period)
    last_line(code)
    hits, misses = last_line(code)
    assert isinstance(hits, int)
    assert hits > 0
    assert misses == 0


def test_names_are_imported_when_first_used() -> None:
    assert set(mjsheaf.__all__) <= set(dir(mjsheaf))
    assert last_line("import json, sys, mjsheaf\nprint(json.dumps(['numpy' in sys.modules]))") == [False]
