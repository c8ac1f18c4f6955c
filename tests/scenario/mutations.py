"""Scenario files with something wrong about them: trees and texts, mutated by draws of hypothesis."""

import copy
import json
import math
import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mjsheaf.errors import ScenarioError
from mjsheaf.files import read_yaml
from mjsheaf.scenario import list_scenarios, load_scenario
from tests.strategies import tried

TREES, TEXTS, RUNS = tried(460, 20), tried(160, 20), 12
"""How many different mutated files, at least, are tried for each scenario that ships: as trees, as texts, run."""

LONGEST = 30.0
"""s; a file takes milliseconds."""

FUZZ = settings(
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.data_too_large],
)

Tree = Any
Pick = Callable[[int], int]
"""A whole number below another, drawn."""

VALUES: list[Any] = [
    None, True, False, 0, 1, -1, 2, 3, 5, 0.5, -0.0, 1e-320, 1e-12, 1e9, 1.000001e9, -1e9, 1e308, 10**30, -(10**400),
    math.nan, math.inf, -math.inf, "", " ", "x", "A1", "T1", "zz", "1", "nan", "null", "~", "=", "<<", "é", "\u200b",
    "漢字", "🚤", "\0", "\x1b[2J", "\ud800", "\r\n", "a" * 5000, "{}", "%s", "{0}", "../../etc/passwd.yaml",
    "/etc/x.yaml", "boat.yaml", "\0.yaml", "~/.ssh/id.yaml", "hull", "hull.xml", "shared", "identity", "local_frame",
    "polygon", "line", "explicit", "waypoints", "lissajous", "static", "surface", "volume", [], {}, [[]], [{}],
    {"": 1}, [1, 2], [1, 2, 3], [1, 2, 3, 4], [1e9, -1e9], [0, 0], [0, 0, 0], [[1, 0], [0, 1]], [[1, 2], [3]], [[0]],
    [[1e9]], [["A1", "T1"]], ["A1", "A1"], ["A1"], ["T1", "A1"], {"between": ["A1", "T1"]}, {"kind": "static"},
    {"kind": "waypoints"}, {"bound": 1}, {"bound": 1e9, "frequencies": [1e9, 1e-9], "components": 64},
    {"dimension": 3, "drift": [1, 2, 3]}, {"dimension": 2, "core": 0, "sources": [{"centre": [0, 0], "alpha": 1e9}]},
    {"size": 3, "about": "T1"}, {"size": 4, "about": "T1", "graph": "k_regular", "degree": 3},
    {"tail": [[1, 0]], "head": [[1, 0, 0]]}, {"layout": [[1, 0], [0, 1]]}, {"layout": [[1e9, 1], [1, 1e-9]]},
    {"id": "A9", "position": [0, 0]}, list(range(50)), "x: y", "- a", "# c", "'", '"', "0x10", 0x10, "1_0",
    "2026-01-01", "yes",
]  # fmt: skip
KEYS = [
    "", "x", "id", "name", "kind", "shape", "position", "agents", "swarm", "__class__", "<<", "=", "é", "\x1b[31m",
    "\ud83d", "a.b", "0", "null", "map", "weight", "between", "vehicle", "end", "seed", "k" * 3000,
]  # fmt: skip
SNIPPETS = [
    b"&a ", b"*a", b"&a [*a, *a]", b"!!python/object/apply:os.system ['true']", b"!!python/name:os.system ",
    b"!!binary |", b"!!set {a}", b"!x ", b"<<: *a", b"---\n", b"...\n", b"%YAML 1.1\n", b"%TAG ! tag:x,2026:\n",
    b"? ", b"? [a]\n: b\n", b": ", b"- ", b"|", b">-\n", b"#", b"\t", b"\n\t- ", b"\n", b"\r", b"\0", b"\x85",
    b"\xe2\x80\xa8", b"\xff\xfe", b"\xef\xbb\xbf", b"[" * 200, b"{" * 200, b"]" * 5, b"}", b"'", b'"', b'"\\x00"',
    b'"\\ud800"', b'"\\U0010ffff"', b"@", b"`", b"%", b",", b"0x" + b"f" * 4000, b"9" * 4400, b"1e999", b".nan",
    b"-.inf", b"0o17", b"1:30", b"= ", b"{a: 1, a: 2}", b"[1, [2, [3", b"a: &x [1]\nb: [*x, *x]\n", b"- " * 60,
    b"a: " * 3, b"\xc3\x28", b"\xed\xa0\x80", b"\x1b[2J",
]  # fmt: skip


class Pairs(list[tuple[Any, Any]]):
    """A mapping that may have a key twice."""


def try_files(strategy: st.SearchStrategy[bytes], least: int, check: Callable[[bytes], None]) -> None:
    """Check files drawn from a strategy, each once, and see that their number is the promised one."""
    tried: set[bytes] = set()

    @settings(FUZZ, max_examples=least * 3 // 2)  # a good fifth of the mutations come out alike
    @given(strategy)
    def each(data: bytes) -> None:
        if data not in tried:
            check(data)
            tried.add(data)  # only now: what fails is checked again, and must fail again

    each()
    assert len(tried) >= least


def load_or_refuse(data: bytes, folder: Path) -> None:
    """Load a file: it is valid, or refused in words that a terminal can show."""
    path = folder / "scenario.yaml"
    path.write_bytes(data)
    with in_time(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            load_scenario(path)
        except ScenarioError as error:
            told = str(error)
            assert told.startswith(f"{path}: ")
            assert len(f"{path}: ") < len(told) < 2_000
            assert all(c.isprintable() or c in "\n\t" for c in told), told


@contextmanager
def in_time() -> Iterator[None]:
    def late(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"took more than {LONGEST} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@cache
def base(name: str) -> dict[str, Any]:
    """A scenario that ships, with two agents and two targets at most: quicker to read, and breaks as easily."""
    raw = read_yaml(list_scenarios()[name])
    kept = {item["id"] for field in ("agents", "targets") for item in raw.get(field, [])[:2]}
    for field in ("agents", "targets"):
        if field in raw:
            raw[field] = [item for item in raw[field] if item["id"] in kept]
    for field in ("communication", "sensing", "target_edges"):
        ends = [(edge if isinstance(edge, list) else edge["between"], edge) for edge in raw.get(field, [])]
        raw[field] = [edge for (tail, head), edge in ends if {tail, head} <= kept]
    for edge in raw.get("communication", []):  # their formations may be gone
        if isinstance(edge, dict) and edge.pop("measures", "") == "range":
            edge |= {"measures": "range", "offset": [5.0]}
    for medium, flow in raw.get("flow", {}).items():
        if "path" in flow:  # a file of data is not a part of a scenario's text
            raw["flow"][medium] = {"dimension": 2, "drift": [0.1, 0.0]}
    raw["anchors"] = [item for item in raw.get("anchors", []) if item["agent"] in kept]
    groups = [{**group, "members": [m for m in group["members"] if m in kept]} for group in raw.get("formations", [])]
    legal = [group for group in groups if len(group["members"]) == 2 and group["shape"] in ("polygon", "line")]
    raw["formations"] = [group for group in legal if group.get("about", "T1") in kept]
    raw.pop("target_formation", None)
    for field in raw.get("flow", {}).values():
        field.update({kind: parts[:1] for kind, parts in field.items() if kind in ("sources", "vortices", "channels")})
    if "swarm" in raw:
        raw["swarm"]["size"] = 4
    if "events" in raw:  # of those who are left
        lost = raw["agents"][1]["id"] if "agents" in raw else "S2"
        raw["events"] = [{"time": 1, "set": {"controller.gain": 0.5}}, {"time": 2, "lose": lost}]
    return {field: value for field, value in raw.items() if value != []}


@st.composite
def mutated_tree(draw: st.DrawFn, whole: Tree) -> bytes:
    """YAML of a tree with one to three of its nodes mutated."""
    tree = copy.deepcopy(whole)
    for _ in range(draw(st.sampled_from([1, 1, 2, 3]))):
        nodes = _nodes(tree)
        holder, key = nodes[draw(st.integers(0, len(nodes) - 1))]
        _OPERATIONS[draw(st.integers(0, len(_OPERATIONS) - 1))](holder, key, lambda n: draw(st.integers(0, n - 1)))
    return _written(tree).encode("utf-8", errors="surrogatepass")


@st.composite
def mutated_text(draw: st.DrawFn, data: bytes) -> bytes:
    for _ in range(draw(st.sampled_from([1, 1, 2, 3]))):
        at = draw(st.integers(0, len(data)))
        kind = draw(
            st.sampled_from(["snippet", "snippet", "cut", "truncate", "line", "bytes", "twice", "indent", "utf16"])
        )
        if kind == "snippet":
            data = data[:at] + draw(st.sampled_from(SNIPPETS)) + data[at:]
        elif kind == "cut":
            data = data[:at] + data[at + draw(st.integers(1, 60)) :]
        elif kind == "truncate":
            data = data[:at]
        elif kind == "bytes":
            data = data[:at] + draw(st.binary(min_size=1, max_size=6)) + data[at + 1 :]
        elif kind == "utf16":
            data = data.decode("utf-8", errors="replace").encode("utf-16")
        else:
            lines = data.split(b"\n")
            k = at % len(lines)
            new = {"line": [], "twice": [lines[k], lines[k]], "indent": [b" " * (at % 7) + lines[k]]}[kind]
            data = b"\n".join([*lines[:k], *new, *lines[k + 1 :]])
    return data


def _nodes(tree: Tree) -> list[tuple[Any, Any]]:
    """Return the place of every value: (mapping or list, key)."""
    found, waiting = [], [tree]
    while waiting:
        holder = waiting.pop()
        keys = holder if isinstance(holder, dict) else range(len(holder))
        for key in keys:
            found.append((holder, key))
            if isinstance(holder[key], dict | list) and not isinstance(holder[key], Pairs):
                waiting.append(holder[key])
    return found


def _replace(holder: Any, key: Any, pick: Pick) -> None:
    holder[key] = copy.deepcopy(VALUES[pick(len(VALUES))])


def _delete(holder: Any, key: Any, pick: Pick) -> None:
    del holder[key]


def _rename(holder: Any, key: Any, pick: Pick) -> None:
    if isinstance(holder, dict):
        holder[KEYS[pick(len(KEYS))]] = holder.pop(key)


def _add(holder: Any, key: Any, pick: Pick) -> None:
    value = copy.deepcopy(VALUES[pick(len(VALUES))])
    if isinstance(holder, dict):
        holder[KEYS[pick(len(KEYS))]] = value
    else:
        holder.insert(key, value)


def _double(holder: Any, key: Any, pick: Pick) -> None:
    if isinstance(holder, list):
        holder += [holder[key]] * (1 + pick(5))
    elif isinstance(holder[key], dict) and holder[key]:
        pairs = list(holder[key].items())
        holder[key] = Pairs([*pairs, pairs[pick(len(pairs))]])


def _bury(holder: Any, key: Any, pick: Pick) -> None:
    for _ in range(pick(80)):
        holder[key] = [holder[key]] if pick(2) else {"x": holder[key]}


def _scale(holder: Any, key: Any, pick: Pick) -> None:
    if type(holder[key]) in (int, float) and abs(holder[key]) < 1e300:
        holder[key] = holder[key] * [-1, 0.0, 1e-9, 1e3, 1e7, 1e300][pick(6)]
    else:
        _replace(holder, key, pick)


_OPERATIONS = [*[_replace] * 4, *[_scale] * 6, _delete, _rename, _add, _double, _bury]


def _written(value: Any) -> str:
    if isinstance(value, dict | Pairs):
        pairs = value.items() if isinstance(value, dict) else value
        return "{" + ", ".join(f"{_written(str(k))}: {_written(v)}" for k, v in pairs) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_written, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0 else "-.inf"
    return json.dumps(value) if not isinstance(value, float) else repr(value)
