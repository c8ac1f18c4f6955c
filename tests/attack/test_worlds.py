"""Many worlds in one process: the same bits, no leak, whatever another one does.

Oracle: one world alone.
"""

import gc
from concurrent.futures import ThreadPoolExecutor

import psutil
import pytest

import mjsheaf
from mjsheaf.errors import MjsheafError

SCENARIO = mjsheaf.load_scenario("harbour", {"time.end": 1.0})


def bits(world: mjsheaf.World | None = None) -> tuple[bytes, bytes]:
    world = world or mjsheaf.World(SCENARIO)
    world.step(20)
    return world.data.qpos.tobytes(), world.data.qvel.tobytes()


def test_a_world_that_blew_up_leaves_the_others_alone() -> None:
    alone, other = bits(), mjsheaf.World(SCENARIO)
    wild = mjsheaf.World(SCENARIO)
    wild.data.qvel[:] = 1e30
    with pytest.raises(MjsheafError):
        wild.step(100)
    assert bits(other) == alone
    assert bits() == alone


def test_worlds_on_two_threads() -> None:
    with ThreadPoolExecutor(2) as pool:
        assert {*pool.map(lambda _: bits(), range(6))} == {bits()}


@pytest.mark.long
def test_fifty_worlds_side_by_side_and_one_after_another() -> None:
    alone = bits()
    worlds = [mjsheaf.World(SCENARIO) for _ in range(50)]
    assert {bits(world) for world in worlds} == {alone}
    worlds.clear()
    gc.collect()
    before = psutil.Process().memory_info().rss
    for _ in range(50):
        assert bits() == alone
    gc.collect()
    assert psutil.Process().memory_info().rss - before < 10e6
