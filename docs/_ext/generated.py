"""Pages made from the program and its files when the site is built: references, vehicles, the gallery of scenarios."""

import inspect
import re
from collections.abc import Sized
from pathlib import Path
from typing import Any

import fields
import typer
import vehicles
import yaml
from sphinx.application import Sphinx

from mjsheaf.cli.main import app as command_line
from mjsheaf.scenario import Scenario, list_scenarios
from mjsheaf.scenario.load import read_scenario
from mjsheaf.studies.schema import StudyFile
from mjsheaf.vehicles.vehicle import VehicleDescription

DOCS = Path(__file__).resolve().parents[1]
REPOSITORY = DOCS.parent
_ERRORS = ("mean_disagreement", "tracking_error", "formation_error", "centering_error")


def lesson_of(path: Path) -> str:
    """The comment at the head of a file, as a paragraph."""
    lines = []
    for line in path.read_text().splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").rstrip())
    return fields.prose(" ".join(lines))


def scenario_page(name: str) -> str:
    """The page of a scenario: its lesson, what is expected of it, how to run it, its file."""
    path = REPOSITORY / "scenarios" / f"{name}.yaml"
    s = Scenario.model_validate(read_scenario(name))
    refused = s.expect.refused
    lines = [f"# {name}\n", f"{s.summary[:1].upper()}{s.summary[1:]}.\n", lesson_of(path) + "\n"]
    end = f"{s.time.end - s.time.start:g} s"
    dimensions = sorted({len(a.position) for a in s.agents})
    where = " and ".join({2: "in the plane", 3: "in space"}[n] for n in dimensions)
    lines.append(
        f"{_count(s.agents, 'agent')} {where}, {_count(s.targets, 'target')}, {end}, gain {s.controller.gain:g} 1/s.\n"
    )
    if refused:
        lines.append(f"`mjsheaf run {name}` refuses, and its reason contains: {refused}.\n")
    else:
        lines += ["Largest errors at the end, which a test holds (m):\n", *_expected(s), ""]
    command = "check" if refused else "run"
    lines += ["```sh", f"mjsheaf {command} {name}", "```\n", "## The file\n"]
    lines += [f"```{{literalinclude}} ../../../scenarios/{name}.yaml", ":language: yaml", "```\n"]
    return "\n".join(lines)


def _count(things: Sized, name: str) -> str:
    return f"{len(things)} {name}{'s' if len(things) != 1 else ''}"


def _expected(s: Scenario) -> list[str]:
    rows = ["| | " + " | ".join(name.replace("_", " ") for name in _ERRORS) + " |", "|---" * 5 + "|"]
    for backend in ("ideal", "physics"):
        bounds = getattr(s.expect, backend)
        if bounds is not None:
            values = (getattr(bounds, name) for name in _ERRORS)
            rows.append(f"| {backend} | " + " | ".join("" if v is None else f"{v:g}" for v in values) + " |")
    return rows


def gallery_table() -> str:
    """A row for each scenario."""
    rows = ["| Scenario | What it shows |", "|---|---|"]
    for name in list_scenarios():
        summary = yaml.safe_load((REPOSITORY / "scenarios" / f"{name}.yaml").read_text()).get("summary", "")
        rows.append(f"| [`{name}`](../generated/gallery/{name}.md) | {fields.prose(summary)} |")
    return "\n".join(rows) + "\n"


def _shown(argument: Any) -> str:
    return str(argument.metavar or argument.name.upper())


def commands_page() -> str:
    """Every command with its arguments and options."""
    lines = []
    for name, command in sorted(typer.main.get_command(command_line).commands.items()):  # type: ignore[attr-defined]
        if command.hidden:
            continue
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join([f"mjsheaf {name}", *(_shown(p) for p in arguments)])
        lines += [f"## mjsheaf {name}\n", f"`{usage}`\n", fields.prose(inspect.cleandoc(command.help or "")) + "\n"]
        for p in command.params:
            names = (
                ", ".join(f"`{o}`" for o in (*p.opts, *p.secondary_opts))
                if p.param_type_name == "option"
                else f"`{_shown(p)}`"
            )
            text = fields.prose(" ".join((getattr(p, "help", None) or "").split()))
            lines += [names, f": {text or 'see above'}\n"]
    return "\n".join(lines)


def write(path: Path, text: str) -> None:
    """Write a file where it is new, so that what is unchanged is not read again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text() != text:
        path.write_text(text)


def generate(_: Sphinx) -> None:
    """Write all pages below generated/."""
    to, examples = DOCS / "generated", fields.known_examples()
    for name, model in (("scenario", Scenario), ("vehicle", VehicleDescription), ("study", StudyFile)):
        write(to / f"{name}_fields.md", fields.reference(model, name, examples))
    shipped = set(list_scenarios())
    for stale in (to / "gallery").glob("*.md"):
        if stale.stem not in shipped:
            stale.unlink()
    for name in shipped:
        write(to / "gallery" / f"{name}.md", scenario_page(name))
    write(to / "gallery_fields.md", gallery_table())
    write(to / "commands_fields.md", commands_page())
    write(to / "vehicles_fields.md", vehicles.page(to / "vehicles"))
    changes = re.sub(r"\A# .*\n", "", (REPOSITORY / "CHANGELOG.md").read_text())
    write(to / "changes_fields.md", changes)


def setup(app: Sphinx) -> dict[str, bool]:
    """Generate pages before Sphinx looks for them."""
    app.connect("builder-inited", generate)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
