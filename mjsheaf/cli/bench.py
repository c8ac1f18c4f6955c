"""`mjsheaf bench`."""

import json

from rich.table import Table

from mjsheaf.bench.table import run_bench
from mjsheaf.cli.console import make_console
from mjsheaf.cli.progress import progress_bars

_WIDTH = 150  # columns, where the output is no terminal


def bench_command(topics: list[str], as_json: bool, full: bool) -> None:
    """Measure, and print a table or JSON."""
    with progress_bars() as progress:
        found = run_bench(topics, short=not full, progress=progress)
    if as_json:
        print(json.dumps(found, indent=2))
        return
    machine = found["machine"]
    title = f"mjsheaf {machine['mjsheaf']} on {machine['processors']} processors, MuJoCo {machine['mujoco']}"
    table = Table(title=title, title_justify="left", header_style="", box=None, padding=(0, 1))
    for heading in ("", "", "ours", "reference", "ratio", "wanted", "met", "reference is"):
        number = heading in ("ours", "reference", "ratio")
        table.add_column(heading, justify="right" if number else "left", no_wrap=heading != "reference is")
    topic = ""
    for row in found["rows"]:
        met = {True: "yes", False: "NO", None: ""}[row["met"]]
        numbers = (_number(row[name]) for name in ("ours", "reference", "ratio"))
        table.add_row(
            "" if row["topic"] == topic else row["topic"], row["what"], *numbers, row["wanted"], met, row["note"]
        )
        topic = row["topic"]
    console = make_console()
    if not console.is_terminal:
        console.width = _WIDTH
    console.print(table, highlight=False)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
