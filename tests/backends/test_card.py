"""The card's kernel, as far as it can be tried without a card: it compiles, and without CUDA nothing of it is loaded.

What it computes is `run_world`, which `test_batch` runs on threads in the layout of a card, to the bits of runs alone.
numba-cuda's simulator runs kernels as plain Python on arrays of its own, which compiled functions do not take.
"""

import importlib.util
import subprocess
import sys
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from numba import typeof, types

from mjsheaf.errors import InputError
from mjsheaf.simulation.batch import Batch
from mjsheaf.simulation.card import arguments, kernel_function, place_of, require_card
from mjsheaf.simulation.fused import Fused
from tests.backends.test_batch import linked
from tests.builders import refused

H200 = (9, 0)  # compute capability


@pytest.mark.slow
def test_nothing_of_cuda_is_loaded_without_asking() -> None:
    code = (
        "import sys, mjsheaf.cli, mjsheaf.simulation.card, mjsheaf.studies.worlds as w;"
        "print([m for m in sys.modules if m.startswith(('numba.cuda', 'numba_cuda.', 'cuda.'))])"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"


def test_without_a_card_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with refused(InputError, "gpu", "numba-cuda", "pip"):
        require_card()


@pytest.mark.parametrize("number", [np.float64, np.float32])
def test_views_are_at_the_same_places_of_a_copy(number: type) -> None:
    """As on a card, of which only the address is known."""
    batch = Batch([Fused(linked(seed, 1.0).phases) for seed in range(3)], order="F", number=number)
    rows, seen = batch.rows, list[int]()
    copy = rows.values.copy(order="F")
    copy[:] = np.arange(copy.size).reshape(copy.shape)

    seeds, *parts, memory = rows.worlds
    assert seeds.tolist() == [0, 1, 2]
    for part in (*parts, memory.flat):
        there = np.asarray(SimpleNamespace(__array_interface__=place_of(part, rows.values, copy.ctypes.data)))
        assert there.shape == part.shape
        seen.extend(there.astype(np.int64).ravel().tolist())
    assert sorted(seen) == list(range(copy.size))  # every number once
    places = [place_of(part, rows.values, 0) for part in rows.worlds.memory.terms if isinstance(part, np.ndarray)]
    assert all(place["strides"][0] == copy.itemsize for place in places)  # neighbouring worlds


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="numba-cuda is not installed")
def test_the_kernel_compiles_for_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every kind of vehicle, terms and links: the whole law is in it. A card that is not there is named."""
    cuda, dispatcher, nvvm = (import_module(f"numba.cuda{name}") for name in ("", ".dispatcher", ".cudadrv.nvvm"))

    nvvm.NVVM()  # what compiles is there
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=H200))
    batch = Batch([Fused(linked(seed, 1.0).phases) for seed in range(2)], order="F")
    kinds = [typeof(tree) for tree in arguments(batch)]
    signature = types.void(*kinds, types.int64, types.int64)
    ptx, _ = cuda.compile(kernel_function(), signature, device=False, abi="numba", cc=H200)
    assert ".target sm_90" in ptx
    assert ptx.count("bar.sync") >= 2
    assert "ld.global.f64" in ptx
