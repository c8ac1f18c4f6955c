"""Every example runs, and so does the notebook, which has no output in it; the site runs each of them too."""

import json
import runpy
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

from tests.builders import REPOSITORY
from tests.strategies import long

EXAMPLES = REPOSITORY / "examples"
QUICK = ("01_sheaf.py", "02_own_scenario.py", "05_own_law.py")


@pytest.fixture(autouse=True)
def _without_a_display(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    "name", [*QUICK, *(long(p.name) for p in sorted(EXAMPLES.glob("*.py")) if p.name not in QUICK)]
)
def test_example_runs(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    if "estimator" in name:
        pytest.importorskip("stonesoup")
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    plt.close("all")
    assert capsys.readouterr().out or name == "09_plots.py"


@pytest.mark.slow
def test_notebook_is_clean_and_runs() -> None:
    notebook = json.loads((EXAMPLES / "first_steps.ipynb").read_text())
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert notebook["nbformat"] == 4
    assert len(code) >= 3
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    names: dict[str, Any] = {}
    for cell in code:
        exec(compile("".join(cell["source"]), "first_steps.ipynb", "exec"), names)
    plt.close("all")
    assert names["record"]["ok"] is True
