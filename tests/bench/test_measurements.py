"""Rows of measurements have verdicts that follow from their numbers. Speed itself is not tested."""

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks import peers, processes, simulations
from benchmarks.measuring import TOPICS, Row, at_least, at_most, informs, run_bench
from mjsheaf.errors import InputError
from mjsheaf.loop.session import ENGINES
from tests.builders import refused
from tests.strategies import long


def test_a_row_says_whether_its_bound_holds() -> None:
    assert at_most("t", "w", 1.0, 2.0, 0.5, 0.5).met
    assert not at_most("t", "w", 1.0, 2.0, 0.51, 0.5).met
    assert at_least("t", "w", 1.0, 2.0, 4.0, 4.0).met
    assert not at_least("t", "w", 1.0, 2.0, 3.9, 4.0).met
    assert informs("t", "w", 1.0, 4.0).ratio == 0.25
    assert informs("t", "w", None).ratio is None


@pytest.mark.parametrize(
    ("topic", "measure", "named"),
    [
        ("loop", lambda: simulations.loop(True, sizes=(2, 4)), ["17 vehicles", "3 vehicles", "5 vehicles"]),
        pytest.param(
            "assembly", lambda: simulations.assembly(size=5), ["6 vehicles"], marks=pytest.mark.slow(each=True)
        ),
        long("fused", lambda: simulations.fused(True, sizes=(20, 40, 60)), ["49980 steps", "21 tilted", "41 tilted"]),
        long("threads", lambda: simulations.threads(True, sizes=(20, 40), ends=(0.11, 0.11)), []),
        long(
            "peers",
            lambda: peers.peers(True, sizes=(13,)),
            [*ENGINES, *(f"{peer}, measured elsewhere" for peer in peers.PEERS)],
        ),
        long("startup", lambda: processes.startup(True), []),
    ],
)
def test_rows_of_a_topic_have_verdicts(topic: str, measure: Callable[[], list[Row]], named: list[str]) -> None:
    """Of small measurements, which name what they measured; more threads give the same bits."""
    rows = measure()
    told = " ".join(f"{row.what} {row.note}" for row in rows)
    assert rows
    assert all(words in told for words in named)
    assert "DIFFER" not in told
    for row in rows:
        assert row.topic == topic
        assert row.ours is not None
        assert row.ours > 0.0
        assert (row.met is None) == (row.wanted == "")
        if row.wanted:
            assert row.ratio is not None
            kind, bound = row.wanted.rsplit(" ", 1)
            assert row.met == {"at most": row.ratio <= float(bound), "at least": row.ratio >= float(bound)}[kind]
    if topic == "loop":  # the time a vehicle takes in a swarm, over that in a smaller one
        assert rows[3].ratio == pytest.approx((rows[2].ours or 0.0) / 5 / ((rows[1].ours or 0.0) / 3))


def test_peers_that_another_python_has_are_measured_in_the_same_run(tmp_path: Path) -> None:
    """It is handed the sizes; one that is none, or fails, is an error in one line."""
    python = tmp_path / "python"
    python.write_text("""#!/bin/sh\necho '{"crazyflow": {"13": 1.0}}'\n""")
    python.chmod(0o755)
    assert peers.measured_peers(str(python), (13,), True) == {"crazyflow": {13: 1.0}}
    assert peers.measured_peers(sys.executable, (13,), True) == {}
    with refused(InputError, "no-such-python"):
        peers.measured_peers("no-such-python", (13,), True)
    for silent in ("/bin/false", "/bin/true", "/bin/echo"):
        with refused(InputError, silent):
            peers.measured_peers(silent, (13,), True)
    with refused(InputError, "--peers", "topic"):
        run_bench(["hardware"], peers=sys.executable)


def test_every_topic_has_its_measurement() -> None:
    assert all(callable(getattr(import_module(module), topic)) for topic, module in TOPICS.items())
