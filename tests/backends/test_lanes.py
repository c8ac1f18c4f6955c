"""The compiled code of the step in lanes is vector code: a change that makes it scalar again fails here."""

import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

RUN = """
from mjsheaf import load_scenario, simulate
simulate(load_scenario("swarm", {"swarm.size": 17, "time.end": 0.1}), engine="fused", threads=1)
"""
ARITHMETIC = re.compile(r"^\s+v?(?:add|sub|mul|div|sqrt|max|min|fn?m(?:add|sub)\d+)([ps]d)\s+(.*)$")


CPU = Path("/proc/cpuinfo")


@pytest.mark.slow
@pytest.mark.skipif(not CPU.exists() or "avx2" not in CPU.read_text(), reason="needs a processor with AVX2")
def test_most_operations_are_four_to_an_instruction(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_DUMP_ASSEMBLY": "1"}
    text = subprocess.run([sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, check=True)
    lines = iter(text.stdout.splitlines())
    assert any("advance_lanes" in line and line.startswith("_ZN") for line in lines)
    operations = Counter[int]()
    for line in lines:
        if line.startswith(".Lfunc_end"):
            break
        if found := ARITHMETIC.match(line):
            wide = 1 if found[1] == "sd" else 8 if "%zmm" in found[2] else 4 if "%ymm" in found[2] else 2
            operations[wide] += wide
    assert operations[4] + operations[8] > 2000
    assert operations[4] + operations[8] >= 0.8 * sum(operations.values()), operations
