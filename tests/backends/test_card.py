"""Tests of the GPU kernel that need no GPU: it compiles, and without CUDA nothing of it is loaded.

The kernel runs `run_world`, which `test_batch` runs on threads in a GPU's layout, with the bits of separate runs.
numba-cuda's simulator runs kernels as plain Python on arrays of its own, which compiled functions do not take.
"""

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import typeof, types
from numpy.typing import NDArray

from mjsheaf.arrays import Array
from mjsheaf.errors import InputError
from mjsheaf.simulation import card
from mjsheaf.simulation.batch import Batch, run_world
from mjsheaf.simulation.card import arguments, kernel_function, place_of, require_card
from mjsheaf.simulation.fused import Fused
from mjsheaf.simulation.gate import ThreadTeam
from mjsheaf.simulation.rows import leaves_of
from tests.backends.test_batch import WILD, linked
from tests.builders import refused

H200 = (9, 0)  # compute capability


@pytest.mark.slow
def test_nothing_of_cuda_is_loaded_without_asking() -> None:
    code = (
        "import sys, mjsheaf.cli, mjsheaf.simulation.card, mjsheaf.studies.batches as w;"
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
    """Array known only by its address, as on a GPU."""
    batch = Batch([Fused(linked(seed, 1.0).phases) for seed in range(3)], order="F", number=number)
    rows, seen = batch.rows, list[int]()
    copy = rows.values.copy(order="F")
    copy[:] = np.arange(copy.size).reshape(copy.shape)

    loop = rows.loop
    np.testing.assert_array_equal(loop.params.control.law.links.seed, [0, 1, 2])
    whole, parts = list[Array](), list[Array]()
    for leaf in leaves_of(loop):
        if getattr(leaf.value, "base", None) is rows.values and leaf.value.size:
            (parts if ".memory." in leaf.path else whole).append(leaf.value)
    for part in (*whole, loop.state.memory.flat, loop.state.memory.evaluated):
        there = np.asarray(SimpleNamespace(__array_interface__=place_of(part, rows.values, copy.ctypes.data)))
        assert there.shape == part.shape
        seen.extend(there.astype(np.int64).ravel().tolist())
    assert sorted(seen) == list(range(copy.size))  # every number once
    places = [place_of(part, rows.values, 0) for part in (*whole, *parts)]
    assert all(place["strides"][0] == copy.itemsize for place in places)  # neighbouring worlds


class CardArray:
    """GPU array: a copy, accessed by its address."""

    def __init__(self, values: NDArray[Any]) -> None:
        self.values = values.copy(order="K")

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        return self.values.__array_interface__

    def copy_to_host(self, values: NDArray[Any]) -> None:
        assert values.strides == self.values.strides
        values[...] = self.values


class Card:
    """Fake of numba.cuda whose kernel is `run_world` on this machine, in separate memory."""

    to_device = CardArray

    def __init__(self, take: Any) -> None:
        self.take = take
        self.launches: list[tuple[tuple[int, ...], int, int]] = []

    def as_cuda_array(self, described: Any) -> CardArray:
        seen = object.__new__(CardArray)
        seen.values = np.asarray(SimpleNamespace(__array_interface__=described.__cuda_array_interface__))
        return seen

    def synchronize(self) -> None: ...

    def __getitem__(self, shape: Any) -> Callable[..., None]:
        (blocks, (worlds, members)) = shape

        def launch(*given: Any) -> None:
            *trees, begin, end = given
            loop, motion, goal, scores, nothing = map(here, trees)
            self.launches.append(((blocks, worlds, members), begin, end))
            thread_team = ThreadTeam(members)
            for w in range(len(scores.bound)):
                own = self.take(loop, w)

                def work(member: int, gate: Any, w: int = w, own: Any = own) -> None:
                    run_world(own, motion, goal, scores, nothing, w, True, begin, end, member, members, gate)

                thread_team.run(work)
            thread_team.close()

        return launch


def here(tree: Any) -> Any:
    """Convert a tree of GPU arrays to arrays of this machine."""
    if isinstance(tree, tuple):
        values = tuple(map(here, tree))
        return type(tree)._make(values) if hasattr(tree, "_make") else values
    return tree.values if isinstance(tree, CardArray) else tree


@pytest.mark.slow
def test_what_is_sent_to_a_card_and_comes_back_is_what_threads_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """In another memory, by addresses alone and in several launches; one world blows up."""
    scenarios = [linked(0, 1.0), linked(1, 2.0), linked(2, WILD)]
    on_card, on_threads = (Batch([Fused(one.phases) for one in scenarios], order="F") for _ in range(2))
    fake = Card(on_card.rows.take)
    monkeypatch.setattr(card, "import_module", lambda name: fake)
    monkeypatch.setattr(card, "_kernel", lambda take: fake)
    monkeypatch.setattr(card, "require_card", lambda: None)
    monkeypatch.setattr(Batch, "chunk", 10)
    on_threads.run()
    assert list(card.run_on_card(on_card)) == [0, 1, 2]
    assert on_card.outcomes() == on_threads.outcomes()
    assert on_card.outcomes()[2].message
    np.testing.assert_array_equal(on_card.rows.values[:2], on_threads.rows.values[:2])  # the third ends anyhow
    T = on_card.goal.samples
    assert [span[1:] for span in fake.launches] == [(k, min(k + 10, T)) for k in range(0, T, 10)]
    assert {shape for shape, _, _ in fake.launches} == {(1, 32, 4)}


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("numba_cuda") is None, reason="numba-cuda is not installed")
def test_the_kernel_compiles_for_a_card(monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel contains every kind of vehicle, terms and links. The error names the missing GPU."""
    cuda, dispatcher, nvvm = (import_module(f"numba.cuda{name}") for name in ("", ".dispatcher", ".cudadrv.nvvm"))

    nvvm.NVVM()  # what compiles is there
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=H200))
    batch = Batch([Fused(linked(seed, 1.0).phases) for seed in range(2)], order="F")
    kinds = [typeof(tree) for tree in arguments(batch)]
    signature = types.void(*kinds, types.int64, types.int64)
    ptx, _ = cuda.compile(kernel_function(batch.rows.take), signature, device=False, abi="numba", cc=H200)
    assert ".target sm_90" in ptx
    assert ptx.count("bar.sync") >= 2
    assert "ld.global.f64" in ptx
