"""`make bench`, or `python -m benchmarks [TOPIC]...`: measure speed, with a reference next to each number."""

import argparse
import json
import sys
from collections.abc import Sequence

from benchmarks.measuring import TOPICS, run_bench
from mjsheaf.cli.options import make_console, make_table, progress_bars
from mjsheaf.errors import MjsheafError


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the topics and print a table, about two minutes for all; return the exit code."""
    parser = argparse.ArgumentParser("benchmarks", description=main.__doc__)
    parser.add_argument("topics", nargs="*", metavar="TOPIC", help=", ".join(TOPICS))
    parser.add_argument("--json", action="store_true", help="print figures and table as JSON")
    parser.add_argument("--full", action="store_true", help="more repetitions and larger sizes; minutes more")
    parser.add_argument("--peers", metavar="PYTHON", help="Python that has crazyflow or gym-pybullet-drones installed")
    chosen = parser.parse_args(arguments)
    try:
        with progress_bars(lines=None if chosen.json else "stdout") as bars:
            found = run_bench(chosen.topics, short=not chosen.full, peers=chosen.peers, progress=bars)
    except MjsheafError as error:
        print(f"mjsheaf: {error}", file=sys.stderr)
        return 2
    if chosen.json:
        print(json.dumps(found, indent=2))
        return 0
    machine = found["machine"]
    title = f"mjsheaf {machine['mjsheaf']} on {machine['processors']} processors, MuJoCo {machine['mujoco']}"
    figures = ("ours", "reference", "ratio")
    headings = ("", "", *figures, "required", "met", "reference is")
    table = make_table(*headings, numbers=figures, fixed=headings[:-1], title=title, box=None, padding=(0, 1))
    topic = ""
    for row in found["rows"]:
        numbers = ("-" if row[name] is None else f"{row[name]:.3g}" for name in figures)
        met = {True: "yes", False: "NO", None: ""}[row["met"]]
        first = "" if row["topic"] == topic else row["topic"]
        table.add_row(first, row["what"], *numbers, row["wanted"], met, row["note"])
        topic = row["topic"]
    console = make_console()
    if not console.is_terminal:
        console.width = 150  # columns
    console.print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
