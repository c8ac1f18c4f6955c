"""Results have the same bits in any process, with any number of BLAS threads, hash seed and instruction set of numpy.

They do depend on the OpenBLAS kernels chosen for the processor; results of two kernels agree to rounding.
Oracle: the run in the process of the tests.
"""

import hashlib
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.commands import python

CODE = """
import hashlib, json, mjsheaf, numpy as np
found = {}
for name, backend in (("paper", "ideal"), ("harbour", "physics")):
    run = mjsheaf.simulate(mjsheaf.load_scenario(name, {"time.end": 0.5}), backend)
    for variable in ("agent_position", "harmonic_extension", "disagreement", "command"):
        found[f"{name} {variable}"] = np.nan_to_num(run[variable].values).ravel().tolist()
"""
CHECKED = """
check = json.dumps(mjsheaf.check(mjsheaf.load_scenario("midpoint")), sort_keys=True, default=str)
"""
PRINTED = """
print(json.dumps([found, hashlib.sha256(check.encode()).hexdigest()]))
"""


Found = tuple[dict[str, list[float]], str]


def found(check: str = CHECKED, **environment: str) -> Found:
    done = python(CODE + check + PRINTED, None, **environment)
    data, check = json.loads(done.stdout.splitlines()[-1])
    return data, check


@pytest.fixture
def usual(once: Callable[[str, Callable[[], Found]], Found]) -> Found:
    """Results in the process of the tests, as any of them is made."""

    def make() -> Found:
        names: dict[str, Any] = {}
        exec(CODE + CHECKED, names)
        return names["found"], hashlib.sha256(names["check"].encode()).hexdigest()

    return once("bits", make)


@pytest.mark.long
@pytest.mark.parametrize(
    "environment",
    [
        {
            "OPENBLAS_NUM_THREADS": "2",
            "PYTHONHASHSEED": "2",
            "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX",
        },
        {"OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "PYTHONHASHSEED": "1"},
    ],
)
def test_bits_do_not_depend_on_threads_seeds_or_numpys_instructions(environment: dict[str, str], usual: Found) -> None:
    assert found(**environment) == usual, environment


@pytest.mark.long
@pytest.mark.parametrize("environment", [{"OPENBLAS_CORETYPE": "Nehalem"}, {"NUMBA_CPU_NAME": "generic"}])
def test_another_processor_changes_no_more_than_rounding(environment: dict[str, str], usual: Found) -> None:
    other, _ = found(check="check = ''", **environment)
    for name, values in usual[0].items():
        scale = max(np.abs(values).max(), 1.0)
        np.testing.assert_allclose(other[name], values, rtol=0, atol=1e-9 * scale, err_msg=name)
