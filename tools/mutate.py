"""Change the package in one place at a time, and list the changes that its tests do not notice.

    python tools/mutate.py law sheaf media checking/theorem checking/loop --sample 150 --seed 1

A mutant is the package with one change: another operator, comparison, constant or function, swapped arguments, a
statement left out. It is written into a copy of the tree and judged, without compilation, by those tests of its package
that execute the changed lines, the quickest first, until one fails. `coverage`, which has to be installed for that,
records in build/mutants which tests these are, for each file of tests, and again when that file has changed. Tests that
fail without compilation or take longer than --limit are left out. Verdicts are kept there, too: after new tests, only
survivors are judged again. Remove the directory when tests are gone or lines of the package have moved. An edit of the
package leaves most of a sample as it was: it depends on the seed and the text of each mutant.
"""

import argparse
import ast
import gc
import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "build" / "mutants"
TESTS = {"media": ["media"], "sheaf": ["sheaf", "team"], "law": ["law"], "checking": ["checking", "law"]}
"""Directories of tests that judge a package."""


def both_ways(pairs: dict[str, str]) -> dict[str, str]:
    """Return pairs and their reverse."""
    return pairs | {other: name for name, other in pairs.items()}


OPERATORS = both_ways({"Add": "Sub", "Mult": "Div", "And": "Or", "BitAnd": "BitOr", "Eq": "NotEq", "Is": "IsNot"})
OPERATORS |= both_ways({"In": "NotIn"}) | {"Pow": "Mult", "FloorDiv": "Div", "Mod": "FloorDiv"}
OPERATORS |= {"Lt": "LtE Gt", "LtE": "Lt GtE", "Gt": "GtE Lt", "GtE": "Gt LtE"}
"""Classes of `ast` that stand in the place of another."""
FUNCTIONS = both_ways({"min": "max", "minimum": "maximum", "argmin": "argmax", "sin": "cos", "floor": "ceil"})
FUNCTIONS |= both_ways({"any": "all", "zeros": "ones", "isfinite": "isnan", "hstack": "vstack"})
LEFT_OUT = {"abs", "sqrt", "exp", "log", "cumsum", "sorted", "reversed", "unique"}  # f(x) becomes x
UNCHANGED = {"annotation", "returns", "decorator_list", "bases"}  # fields of nodes
TIMED_OUT = 99
CLOCKS = ((signal.SIGPROF, signal.ITIMER_PROF, 1.0), (signal.SIGALRM, signal.ITIMER_REAL, 4.0))
"""Processor time, as the machine may have other work, and a multiple of it in real time for tests that wait."""
VERDICTS = {1: "killed", TIMED_OUT: "timed out", 0: "survived", 5: "without a test", 70: "crashed"}
"""By pytest's exit status; others are those of a package that cannot be imported."""


@dataclass(frozen=True)
class Mutant:
    """A change of one place.

    Attributes:
        file: File, relative to the root.
        line: Line of the place.
        lines: Lines of its statement, or of the head of a compound statement.
        place: First and last byte of the place.
        inside: True in the body of a function, which tests call; False where importing executes it.
        old, new: Text in the place.
        key: Text that no other mutant has, and that does not depend on other parts of the file.
    """

    file: str
    line: int
    lines: range
    place: tuple[int, int]
    inside: bool
    old: str
    new: str
    key: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {' '.join(self.old.split())}  ->  {self.new}"


def name_of(function: ast.AST) -> str:
    """Return the last name of what is called, '' if it has none."""
    return str(getattr(function, "attr", getattr(function, "id", "")))


def is_text(node: ast.AST) -> bool:
    """Return True for what is there for a reader or a type checker."""
    match node:
        case ast.JoinedStr() | ast.Import() | ast.ImportFrom() | ast.Expr(ast.Constant()):
            return True
        case ast.If(ast.Name(name)) | ast.Assign([ast.Name(name)]):
            return name in {"TYPE_CHECKING", "__all__"}
        case ast.Call(function):
            return name_of(function).endswith("Error") or "_logger" in ast.unparse(function)
    return False


def others(operator: ast.AST) -> list[Any]:
    """Return what may stand in the place of an operator."""
    return [getattr(ast, name)() for name in OPERATORS.get(type(operator).__name__, "").split()]


def changes(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield a part of a node, or the node itself, and what may stand there instead."""
    match node:
        case ast.BinOp(left, operator, right):
            yield from ((node, ast.BinOp(left, other, right)) for other in others(operator))
            if isinstance(operator, ast.Sub | ast.Div | ast.MatMult | ast.Pow):
                yield node, ast.BinOp(right, operator, left)
        case ast.AugAssign(target, operator, value):
            yield from ((node, ast.AugAssign(target, other, value)) for other in others(operator))
            yield node, ast.Pass()
        case ast.Compare(left, [operator], [right]):
            yield from ((node, ast.Compare(left, [other], [right])) for other in others(operator))
        case ast.BoolOp(operator, values):
            yield from ((node, ast.BoolOp(other, values)) for other in others(operator))
            yield from ((node, value) for value in values)
        case ast.UnaryOp(ast.Not() | ast.USub(), operand) | ast.Attribute(operand, "T"):
            yield node, operand
        case ast.IfExp(_, body, otherwise) if not (is_text(body) or is_text(otherwise)):
            yield from ((node, body), (node, otherwise))
        case ast.Constant(bool() as value):
            yield node, ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield node, ast.Constant(1 - value if value in (0, 1) else 2 * value)
            if value:
                yield node, ast.UnaryOp(ast.USub(), ast.Constant(value))
        case ast.Slice(lower, upper, step):
            if lower:
                yield node, ast.Slice(None, upper, step)
            if upper:
                yield node, ast.Slice(lower, None, step)
        case ast.Call(function, arguments, keywords):
            if len(arguments) > 1 and name_of(function) not in FUNCTIONS:
                yield node, ast.Call(function, [arguments[1], arguments[0], *arguments[2:]], keywords)
            if name_of(function) in LEFT_OUT and arguments:
                yield node, arguments[0]
            for one in keywords:
                if not isinstance(getattr(one.value, "value", 0), str):
                    yield node, ast.Call(function, arguments, [other for other in keywords if other is not one])
        case ast.Name(name) if name in FUNCTIONS:
            yield node, ast.Name(FUNCTIONS[name])
        case ast.Attribute(owner, name) if name in FUNCTIONS:
            yield node, ast.Attribute(owner, FUNCTIONS[name])
        case ast.Return(ast.Compare() | ast.BoolOp() as value) | ast.If(value) | ast.While(value):
            yield value, ast.UnaryOp(ast.Not(), value)
        case ast.Return(ast.BinOp() | ast.Call() | ast.Name() | ast.Subscript() as value):
            if not name_of(getattr(value, "func", value))[:1].isupper():
                yield value, ast.UnaryOp(ast.USub(), value)
        case ast.comprehension(ifs=conditions):
            yield from ((condition, ast.Constant(True)) for condition in conditions)
        case ast.Assign([ast.Subscript() | ast.Attribute()]) | ast.Expr() | ast.Raise() | ast.Continue() | ast.Break():
            yield node, ast.Pass()


def walk(node: ast.AST, statement: ast.AST, inside: bool) -> Iterator[tuple[ast.AST, bool, ast.AST, ast.AST]]:
    """Yield a statement, `inside`, a part of it and what may stand there instead, for a node and all below it."""
    if is_text(node):
        return
    statement = node if isinstance(node, ast.stmt) else statement
    yield from ((statement, inside, part, new) for part, new in changes(node))
    for name, field in ast.iter_fields(node):
        if name not in UNCHANGED and not isinstance(node, ast.Raise):  # which holds a message
            below = inside or (isinstance(node, ast.FunctionDef) and name == "body")
            for child in field if isinstance(field, list) else [field]:
                if isinstance(child, ast.AST):
                    yield from walk(child, statement, below)


def mutants_of(file: Path) -> Iterator[Mutant]:
    """Yield all mutants of a file."""
    name = str(file.relative_to(ROOT))
    source = file.read_bytes()
    starts = [0]
    for text in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(text))
    same: Counter[str] = Counter()
    tree: Any = ast.parse(source)
    node: Any
    part: Any
    for node, inside, part, new in walk(tree, tree, False):
        if ast.unparse(part) == ast.unparse(new):
            continue
        place = starts[part.lineno - 1] + part.col_offset, starts[part.end_lineno - 1] + part.end_col_offset
        old = source[slice(*place)].decode()
        changed = ast.unparse(new)
        if isinstance(part, ast.expr) and not isinstance(part, ast.Slice):
            changed = f"({changed})"
        last = node.body[0].lineno - 1 if hasattr(node, "body") else node.end_lineno
        key = f"{name} {ast.unparse(node)[:200]} {old} {changed}"
        same[key] += 1
        lines = range(node.lineno, max(last, node.lineno) + 1)
        yield Mutant(name, part.lineno, lines, place, inside, old, changed, f"{key} {same[key]}")


def in_child(work: Callable[[], int]) -> int:
    """Return the status with which a new process ends that does this work."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    status = 70
    try:
        status = int(work())
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def processor_time() -> float:
    """Return the time that this process and its children have taken, s."""
    return sum(os.times()[:4])


class Recorder:
    """Plugin of pytest that keeps the time of each test, and the lines that it executes."""

    def __init__(self, limit: float) -> None:
        from coverage import Coverage

        self.limit = limit
        self.begun = 0.0
        self.seconds: dict[str, float] = {}
        self.left_out: dict[str, str] = {}
        self.measured = Coverage(data_file=None, include=[f"mjsheaf/{name}/*" for name in TESTS])
        self.measured.start()

    def pytest_runtest_protocol(self, item: Any) -> None:
        """Count what follows for this test, and leave it at the limit."""
        self.begun = processor_time()
        self.measured.switch_context(item.nodeid)
        for alarm, timer, seconds in CLOCKS:
            signal.signal(alarm, lambda *_: pytest.skip(f"longer than {self.limit:g} s"))
            signal.setitimer(timer, seconds * self.limit, self.limit)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, request: Any) -> Generator[None, Any, Any]:
        """Count the lines of a shared fixture for all tests of its module, class or session."""
        self.measured.switch_context(request.node.nodeid)
        result = yield
        self.measured.switch_context(request._pyfuncitem.nodeid)
        return result

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Note the time of a test that has ended, and of one that is left out the reason."""
        if report.outcome != "passed":
            self.left_out[report.nodeid] = str(report.longrepr)[-300:]
        if report.when == "teardown":
            for _, timer, _ in CLOCKS:
                signal.setitimer(timer, 0.0)
            self.seconds[report.nodeid] = processor_time() - self.begun

    def write(self, file: Path) -> None:
        """Keep the record of a file of tests: seconds by test, lines by test or module and file, reasons."""
        self.measured.stop()
        data = self.measured.get_data()
        lines: dict[str, dict[str, list[int]]] = {}
        for context in data.measured_contexts():
            data.set_query_context(context)
            found = {os.path.relpath(name): data.lines(name) or [] for name in data.measured_files()}
            lines[context] = {name: numbers for name, numbers in found.items() if numbers}
        seconds = {test: time for test, time in self.seconds.items() if test not in self.left_out}
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps({"seconds": seconds, "lines": lines, "left out": self.left_out}))


class Judge:
    """Plugin of pytest that ends the process at the first test that fails, or takes much longer than it did."""

    def __init__(self, seconds: dict[str, float]) -> None:
        self.seconds = seconds

    def pytest_runtest_protocol(self, item: Any) -> None:
        """Start the clocks."""
        for alarm, timer, seconds in CLOCKS:
            signal.signal(alarm, lambda *_: os._exit(TIMED_OUT))
            signal.setitimer(timer, 10.0 * seconds * (1.0 + self.seconds[item.nodeid]))

    def pytest_runtest_logreport(self, report: Any) -> None:
        """End with the name of a test that failed."""
        if report.failed:
            Path("killer.txt").write_text(report.nodeid)
            os._exit(1)


def run(items: list[Any], plugin: Any) -> int:
    """Run tests in order, in a process that has collected them; return 0, or 5 if there are none, as pytest does."""
    if not items:
        return 5
    items[0].config.pluginmanager.register(plugin)
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
    return 0


def functions_in(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of all functions in that of a module."""
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from functions_in(constant)


def patch(file: Path) -> None:
    """Give the functions of a module that is in memory the code that its file has now."""
    codes = functions_in(compile(file.read_bytes(), str(file), "exec"))
    present = {(code.co_qualname, code.co_firstlineno): code for code in codes}
    gc.unfreeze()  # as pytest's session has frozen them
    for function in [one for one in gc.get_objects() if isinstance(one, FunctionType)]:
        code = function.__code__
        if code.co_filename == str(file):
            function.__code__ = present.get((code.co_qualname, code.co_firstlineno), code)


class Session:
    """Plugin of pytest that, once tests are collected, records and judges in children that have them in memory.

    Attributes:
        copy: Copy of the tree, the present directory.
        package: Package below mjsheaf.
        mutants: Mutants that are to be judged.
        limit: Time that a test may take, s.
    """

    def __init__(self, copy: Path, package: str, mutants: list[Mutant], limit: float) -> None:
        self.copy = copy
        self.package = package
        self.mutants = mutants
        self.limit = limit
        self.items: dict[str, Any] = {}

    def pytest_runtestloop(self, session: Any) -> bool:
        """Record what is missing, judge, and run nothing else."""
        self.items = {item.nodeid: item for item in session.items}
        for file, kept in records_of(self.package):
            if not kept.exists() or kept.stat().st_mtime < file.stat().st_mtime:
                in_child(partial(self.record, f"{file.relative_to(ROOT)}::", kept))
        for mutant in self.mutants:
            self.judge(mutant)
        return True

    def record(self, prefix: str, kept: Path) -> int:
        """Run the tests of a file, and keep what they execute."""
        recorder = Recorder(self.limit)
        run([item for name, item in self.items.items() if name.startswith(prefix)], recorder)
        recorder.write(kept)
        return 0

    def judge(self, mutant: Mutant) -> None:
        """Run the tests of a mutant, and add the verdict to the file of all."""
        seconds = tests_of(mutant)
        names = sorted(seconds.keys() & self.items.keys(), key=lambda name: seconds[name])
        file = self.copy / mutant.file
        source = file.read_bytes()
        first, last = mutant.place
        file.write_bytes(source[:first] + mutant.new.encode() + source[last:])
        Path("killer.txt").write_text("")

        def work() -> int:
            if mutant.inside:
                patch(file)
                return run([self.items[name] for name in names], Judge(seconds))
            Path("names.txt").write_text("\n".join(names))
            pytest_alone = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "@names.txt"]
            return subprocess.run(pytest_alone, check=False).returncode

        code = in_child(work)
        file.write_bytes(source)
        verdict = VERDICTS.get(code, "killed" if code >= 0 else "timed out")
        found = {"verdict": verdict, "tests": len(names), "status": code, "by": Path("killer.txt").read_text()}
        with (KEPT / "verdicts.txt").open("a") as verdicts:
            verdicts.write(json.dumps({"key": mutant.key, "mutant": str(mutant), **found}) + "\n")


def copy_tree(target: Path) -> Path:
    """Copy what tests need."""
    unneeded = shutil.ignore_patterns(".*", "build", "dist", "node_modules")
    shutil.copytree(ROOT, target, ignore=unneeded, symlinks=True)
    return target


@cache
def load(file: Path) -> Any:
    """Read a record."""
    return json.loads(file.read_text()) if file.exists() else {"seconds": {}, "lines": {}}


def load_verdicts() -> dict[str, dict[str, Any]]:
    """Return the last verdict on each mutant by its key."""
    file = KEPT / "verdicts.txt"
    return {one["key"]: one for one in map(json.loads, file.read_text().splitlines() if file.exists() else ())}


def records_of(package: str) -> Iterator[tuple[Path, Path]]:
    """Yield the files of tests that judge a package, and where their records are."""
    for directory in TESTS[package]:
        for file in sorted((ROOT / "tests" / directory).glob("test_*.py")):
            yield file, KEPT / directory / f"{file.stem}.json"


def tests_of(mutant: Mutant) -> dict[str, float]:
    """Return the seconds of the tests that execute a mutant's lines, or any line of its file if importing does."""
    selected: dict[str, float] = {}
    for _, kept in records_of(mutant.file.split("/")[1]):
        record = load(kept)
        met = {context: {*files.get(mutant.file, ())} for context, files in record["lines"].items()}
        contexts = [one for one, lines in met.items() if lines & {*mutant.lines} or (lines and not mutant.inside)]
        executing = tuple(contexts)  # names of tests, or the beginning of those of a whole file
        selected |= {test: time for test, time in record["seconds"].items() if test.startswith(executing)}
    return selected


def judge_all(package: str, mutants: list[Mutant], limit: float) -> int:
    """Collect the tests of a package in a copy of the tree, and judge its mutants there."""
    with tempfile.TemporaryDirectory() as scratch:
        copy = copy_tree(Path(scratch) / "copy")
        os.chdir(copy)
        sys.path.insert(0, str(copy))
        os.environ |= {"NUMBA_DISABLE_JIT": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(copy)}
        sys.dont_write_bytecode = True  # a mutant written in the same second has the same stamp
        resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
        output = os.open(KEPT / "output.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        tests = [f"tests/{directory}" for directory in TESTS[package]]
        plugin = Session(copy, package, mutants, limit)
        return int(pytest.main([*tests, "-q", "-s", "-p", "no:cacheprovider", "-m", "not long"], plugins=[plugin]))


def main() -> int:
    """Judge a sample, and print a table and the survivors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("packages", nargs="+", metavar="PACKAGE", help="directory below mjsheaf")
    parser.add_argument("--sample", type=int, default=150, help="number of mutants")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--limit", type=float, default=20.0, help="s that a test may take")
    parser.add_argument("--list", action="store_true", help="print the sample only")
    options = parser.parse_args()
    files = [file for package in options.packages for file in sorted((ROOT / "mjsheaf" / package).rglob("*.py"))]
    mutants = [mutant for file in files for mutant in mutants_of(file)]
    print(f"{options.sample} of {len(mutants)} mutants, seed {options.seed}")
    mutants.sort(key=lambda one: hashlib.sha256(f"{options.seed} {one.key}".encode()).digest())
    sample = sorted(mutants[: options.sample], key=lambda one: (one.file, one.place))
    if options.list:
        print(*sample, sep="\n")
        return 0
    if find_spec("coverage") is None:
        parser.error("coverage is missing, which records what tests execute: pip install coverage")
    KEPT.mkdir(parents=True, exist_ok=True)
    for package in TESTS:
        chosen = [mutant for mutant in sample if mutant.file.split("/")[1] == package]
        known = load_verdicts()
        pending = [mutant for mutant in chosen if known.get(mutant.key, {}).get("verdict") != "killed"]
        in_child(partial(judge_all, package, pending, options.limit))
        verdicts = [load_verdicts().get(mutant.key, {"verdict": "crashed"})["verdict"] for mutant in chosen]
        print(f"{package}: {len(chosen)} mutants,", *(f"{verdicts.count(one)} {one}" for one in sorted(set(verdicts))))
        print(
            *(f"    {one}: {mutant}" for mutant, one in zip(chosen, verdicts, strict=True) if one != "killed"), sep="\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
