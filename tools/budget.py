"""Check the size of the package against the limits in pyproject.toml, table `tool.budget`.

Statements are counted with `ast`, without docstrings. Run by `make lint`. `--table` prints the packages, `--list` the
long functions.
"""

import ast
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def is_docstring(node: ast.stmt) -> bool:
    """Return True for a string that stands alone."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def count_statements(tree: ast.AST) -> int:
    """Count the statements below a node."""
    return sum(isinstance(node, ast.stmt) and not is_docstring(node) for node in ast.walk(tree))


def function_lengths(tree: ast.AST) -> Iterator[tuple[int, str, int]]:
    """Yield (lines, name, first line) of each function."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield (node.end_lineno or node.lineno) - node.lineno + 1, node.name, node.lineno


def main() -> int:
    """Compare the counts with their limits; return 1 if one is exceeded."""
    limits = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["budget"]
    files = sorted((ROOT / "mjsheaf").rglob("*.py"))
    statements: Counter[str] = Counter()
    lines: Counter[str] = Counter()
    lengths = []
    for file in files:
        text = file.read_text(encoding="utf-8")
        tree = ast.parse(text)
        place = file.relative_to(ROOT)
        package = place.parts[1] if len(place.parts) > 2 else "(top)"
        statements[package] += count_statements(tree)
        lines[package] += text.count("\n")
        lengths += [(length, f"{place}:{line} {name}") for length, name, line in function_lengths(tree)]
    if "--table" in sys.argv[1:]:
        for package, number in statements.most_common():
            print(f"{package:12} {number:6} statements {lines[package]:6} lines")
    too_long = sorted({length for length in lengths if length[0] > limits["function_lines"]}, reverse=True)
    density = sum(lines.values()) / sum(statements.values())
    found = {
        "statements": sum(statements.values()),
        "files": len(files),
        "long_functions": len(too_long),
    }
    exceeded = [
        f"{name} is {number}, at most {limits[name]}" for name, number in found.items() if number > limits[name]
    ]
    if density < limits["lines_per_statement"]:
        exceeded.append(f"lines_per_statement is {density:.3f}, at least {limits['lines_per_statement']}")
    print(", ".join(f"{name} {number}" for name, number in found.items()) + f", lines_per_statement {density:.3f}")
    if exceeded:
        print("budget exceeded:", "; ".join(exceeded), file=sys.stderr)
    if found["long_functions"] > limits["long_functions"] or "--list" in sys.argv[1:]:
        print("long functions:", *(f"  {number:4} {where}" for number, where in too_long), sep="\n", file=sys.stderr)
    return int(bool(exceeded))


if __name__ == "__main__":
    sys.exit(main())
