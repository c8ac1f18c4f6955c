"""The compiled code of the step in lanes is vector code: a change that makes it scalar again fails here."""

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mjsheaf.compile.jit import user_jit
from mjsheaf.loop.block import advance_lanes
from mjsheaf.loop.engine import new_log
from mjsheaf.loop.fused import Fused
from mjsheaf.loop.loop import NEVER
from mjsheaf.loop.system import on_engine
from mjsheaf.scenario import load_scenario

ARITHMETIC = re.compile(r"^\s+v?(?:add|sub|mul|div|sqrt|max|min|fn?m(?:add|sub)\d+)([ps]d)\s+(.*)$")
LABEL = re.compile(r"^([^\s.#][^:]*):$")  # of a function
CPU = Path("/proc/cpuinfo")


def alone(loop: Any, motion: Any, last: int, log: Any, bad: Any) -> Any:
    """Take a step with the vehicles before `last`."""
    return advance_lanes(loop, motion, 0, last, 0, 1, log, -1, bad)


@pytest.mark.slow
@pytest.mark.skipif(not CPU.exists() or "avx2" not in CPU.read_text(), reason="needs a processor with AVX2")
def test_most_operations_are_four_to_an_instruction() -> None:
    scenario = load_scenario("swarm", {"swarm.size": 17, "time.end": 0.1})
    loop, motion = Fused(on_engine(scenario.phases, "fused")).compiled
    compiled = user_jit(alone)
    assert compiled(loop, motion, 16, new_log(0, scenario.system.law, actuators=0), np.full(18, NEVER))
    (text,) = compiled.inspect_asm().values()
    functions: dict[str, Counter[int]] = {}
    name = ""
    for line in text.splitlines():
        if label := LABEL.match(line):
            name = label[1]
        elif found := ARITHMETIC.match(line):
            wide = 1 if found[1] == "sd" else 8 if "%zmm" in found[2] else 4 if "%ymm" in found[2] else 2
            functions.setdefault(name, Counter())[wide] += wide
    # What rarely happens is compiled apart, for a vehicle at a time: it is in functions of its own, or in the step's.
    operations = max(functions.values(), key=Counter.total)
    assert operations[4] + operations[8] > 3500
    assert operations[4] + operations[8] >= 0.8 * operations.total(), operations
