"""The pytest plugin in a project that knows nothing of it: it costs no import, takes no option, collects nothing.

Oracle: pytest without the plugin.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = """
import json, sys
def pytest_addoption(parser):
    parser.addoption("--seed", type=int); parser.addoption("--backend"); parser.addini("tight", "ours", default="7")
def pytest_sessionfinish(session):
    heavy = sorted({name.partition(".")[0] for name in sys.modules})
    ours = sorted(name for name in sys.modules if name.startswith("mjsheaf"))
    with open("loaded.json", "w") as file:
        json.dump([heavy, ours], file)
"""


@pytest.mark.slow(first=True)
def test_a_foreign_project_does_not_notice(tmp_path: Path) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_a.py").write_text("def test_a(request):\n    assert request.config.getoption('--seed') == 3\n")
    (tmp_path / "scenario.yaml").write_text("expect: {ideal: {tracking_error: 1}}\ntargets: []\n")
    (tmp_path / "broken.yaml").write_text("expect: [\n")
    base = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--seed", "3", "--backend", "theirs"]
    tails, loaded = [], []
    for plugin in (["-p", "no:mjsheaf.pytest_plugin"], ["-p", "mjsheaf.pytest_plugin"]):
        done = subprocess.run([*base, *plugin, "."], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout
        tails.append(done.stdout.splitlines()[0])
        loaded.append(json.loads((tmp_path / "loaded.json").read_text()))
    assert tails[0] == tails[1]
    assert loaded[1][1] in (
        ["mjsheaf", "mjsheaf._version", "mjsheaf.pytest_plugin"],
        ["mjsheaf", "mjsheaf.pytest_plugin"],
    )
    assert set(loaded[1][0]) - set(loaded[0][0]) <= {"mjsheaf"}
