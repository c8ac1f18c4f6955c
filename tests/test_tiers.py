"""Functions that run in Python at first: the same bits as compiled, and compiled once they have enough to do."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

import mjsheaf
from mjsheaf.compile import tiers
from mjsheaf.compile.jit import Held
from tests.commands import COMPILED, python

COUNT = f"""{COMPILED}
import mjsheaf
from mjsheaf.compile import tiers

take = tiers.Tiered._take
tiers.Tiered._take = lambda self, kinds, _: take(self, kinds, 0.02 * (self.compiled.py_func.__name__ == "_follow"))
mjsheaf.check(mjsheaf.load_scenario("midpoint"), trial=False)
print(*compiled)
"""
"""Print the functions that a check compiles if one takes a time that no machine decides, and the others none."""


def leaves(tree: Any) -> Iterator[Any]:
    if isinstance(tree, tuple):
        for part in tree:
            yield from leaves(part)
    else:
        yield tree


@pytest.mark.slow
@pytest.mark.parametrize("name", ["midpoint", "harbour"])
def test_python_and_compiled_code_agree_to_the_bit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: dict[str, int] = {}

    def call_both(self: tiers.Tiered, *arguments: Any) -> Any:
        values = tuple(x.value if isinstance(x, Held) else x for x in arguments)
        arrays = [x for x in leaves(values) if isinstance(x, np.ndarray) and x.flags.writeable]
        before = [x.copy() for x in arrays]
        with np.errstate(all="ignore"):
            result = tiers.in_python(self.compiled)(*tiers._as_records(values))
        by_python = [x.tobytes() for x in arrays]
        for x, value in zip(arrays, before, strict=True):
            x[...] = value
        expected = self.compiled(*arguments)
        assert [x.tobytes() for x in arrays] == by_python, self.compiled.py_func.__qualname__
        for x, y in zip(leaves((expected,)), leaves((result,)), strict=True):
            assert x is y or np.asarray(x).tobytes() == np.asarray(y, dtype=np.asarray(x).dtype).tobytes()
        function = self.compiled.py_func.__qualname__
        calls[function] = calls.get(function, 0) + 1
        return expected

    monkeypatch.setattr(tiers.Tiered, "__call__", call_both)
    mjsheaf.check(mjsheaf.load_scenario(name, {"time.end": 3.0}), trial=False)
    assert {"_answer", "_follow", "apply_forces"} <= set(calls)


@pytest.mark.long
def test_first_checks_compile_little_and_a_later_one_what_took_time(tmp_path: Path) -> None:
    def compiled() -> set[str]:
        done = python(COUNT, NUMBA_CACHE_DIR=str(tmp_path))
        assert done.returncode == 0, done.stderr
        return set(done.stdout.split())

    slow = {"_answer", "_follow", "evaluate_law", "apply_forces"}
    assert not slow & compiled()
    (times,) = tmp_path.rglob("targets._follow.*.used")
    first = times.read_text().split()
    assert not slow & compiled()
    assert times.read_text().split()[: len(first)] == first  # a second process adds its own
    assert len(times.read_text().split()) > len(first)
    with times.open("a") as file:
        file.write("1000\n")  # as many processes would
    later = compiled()
    assert slow & later == {"_follow", "evaluate_law"}  # which it calls
    assert not {"_feed_forward", "relax", "send"} & later  # of stages that the team does not have


@pytest.mark.parametrize(
    ("text", "total"), [(None, 0.0), ("", 0.0), ("0.5\n1.25\n", 1.75), ("0.5\n0.", 0.5), ("x", np.inf)]
)
def test_times_of_processes_add_up(tmp_path: Path, text: str | None, total: float) -> None:
    file = tmp_path / "f.used"
    if text is not None:
        file.write_text(text)
    assert tiers._total_time(file) == total


def test_python_leaves_large_calls_to_compiled_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And writes no times without a cache."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tiers, "_NOTICEABLE", 1e-9)

    @numba.njit
    def total(x):
        s = 0.0
        for i in range(x.shape[0]):
            s += x[i]
        return s

    function = tiers.Tiered(total, numbers=10)
    assert function(np.ones(10)) == 10.0
    assert not total.signatures
    assert not list(tmp_path.iterdir())
    assert function(np.ones(11)) == 11.0
    assert total.signatures
