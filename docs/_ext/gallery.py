"""Pages of the scenarios: what each teaches, its replay, its numbers, its file."""

import html
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import fields
import replays

from mjsheaf.results.metrics import MEASURES
from mjsheaf.scenario import Scenario, list_scenarios, load_scenario
from mjsheaf.scenario.load import read_scenario

REPOSITORY = Path(__file__).resolve().parents[2]
_WORKING = {"lost_thruster": " and working thrusters"}
MORE = "Variations"
REFUSED = "Where an assumption fails"
SECTIONS = {
    "Start here": ("paper", "certified", "harbour", "otters", "quads", "swarm"),
    "Better laws": (
        *("harbour_feedforward", "otters_feedforward", "quads_feedforward", "paper_feedforward", "steady_current"),
    ),
    "Noise, delay and failures": (
        *("harbour_lost_hexarotor", "noisy_harbour", "swarm_radio_shadow", "paper_delay", "paper_half_lost"),
        "noisy_odometry",
    ),
    "Formations that change, vehicles that keep apart": ("narrow_gate", "harbour_piers", "swap", "paper_safe"),
    MORE: ("midpoint", "surface_tracks_air", "local_frames", "altitude_anchor", "tetrahedron"),
    REFUSED: ("split_team", "unseen_target", "singular_flow", "lost_thruster", "air_tracks_surface"),
}
"""Scenarios in the order of the gallery, by section."""
_WORDS = [name.replace("_", " ") for name in MEASURES]


def publish(extra: Path) -> None:
    """Make the replays, and copy them and the pictures to where the site takes them from."""
    replays.make_all()
    for kind, file, suffix in (("replays", "report.html", "html"), ("pictures", "picture.jpg", "jpg")):
        to = extra / kind
        shutil.rmtree(to, ignore_errors=True)
        to.mkdir(parents=True)
        for name in replays.shown():
            if (replays.replay_of(name) / file).is_file():
                shutil.copy(replays.replay_of(name) / file, to / f"{name}.{suffix}")


def ordered(names: Iterable[str]) -> dict[str, list[str]]:
    """Sort scenarios into the sections of the gallery, the most interesting first; refused ones are in the last one.

    A scenario that no section lists comes at the end of the last section but one.
    """
    known = list(names)
    listed = {name for section in SECTIONS.values() for name in section}
    found = {title: [name for name in section if name in known] for title, section in SECTIONS.items()}
    for name in known:
        if name not in listed:
            found[REFUSED if label_of(name) else MORE].append(name)
    return {title: section for title, section in found.items() if section}


def label_of(name: str) -> str:
    """Return why a scenario has a label in the gallery: `run` refuses it. Empty for all others."""
    return "refused" if Scenario.model_validate(read_scenario(name)).expect.refused else ""


def cards() -> str:
    """Return a tile for each scenario, section by section (picture, name, what it shows), and the pages' order."""
    lines = []
    sections = ordered(list_scenarios())
    for title, names in sections.items():
        lines += [f"## {title}\n", '<div class="tiles">', *(_card(name) for name in names), "</div>\n"]
    pages = [f"../generated/gallery/{name}" for names in sections.values() for name in names]
    return "\n".join([*lines, "```{toctree}", ":hidden:", "", *pages, "```", ""])


def _card(name: str) -> str:
    summary = html.escape(Scenario.model_validate(read_scenario(name)).summary)
    label = label_of(name)
    mark = f' <em class="label">{label}</em>' if label else ""
    return (
        f'<a class="tile" href="../generated/gallery/{name}.html">{_picture(name, "..")}'
        f"<span><code>{name}</code>{mark}<br>{summary}</span></a>"
    )


def _picture(name: str, root: str) -> str:
    if name not in replays.shown() or not (replays.replay_of(name) / "picture.jpg").is_file():
        return ""
    alt = f"One moment of {name} on MuJoCo bodies"
    return f'<img src="{root}/pictures/{name}.jpg" alt="{alt}" width="720" height="406" loading="lazy">'


def page(name: str) -> str:
    """The page of one scenario."""
    s = Scenario.model_validate(read_scenario(name))
    option, _ = replays.RUN_AS.get(name, ("", {}))
    refused = s.expect.refused
    lines = [f"# {name}\n", f"{fields.prose(s.summary[:1].upper() + s.summary[1:])}.\n"]
    lines += [_picture(name, "../.."), "", lesson_of(name) + "\n", "```sh"]
    lines += [f"mjsheaf check {name}", f"mjsheaf run {name}{option and ' ' + option}", "```\n"]
    if refused:
        lines.append(f"`mjsheaf run {name}` refuses this scenario: {fields.prose(refused)}. ")
        if name in replays.shown():
            lines.append(f"Replay and numbers are from a run with `{option}`{_WORKING.get(name, '')}.\n")
    if name in replays.shown():
        summary = replays.summary_of(name)
        lines += ["## Replay\n", "Drag to turn the scene. Click a curve to jump to that moment.", *_open(name), ""]
        source = f'src="../../replays/{name}.html" title="Replay of {name}" loading="lazy"'
        lines.append(f'<iframe class="replay" {source}></iframe>\n')
        lines += ["## Numbers\n", *_facts(name, s), "", *_errors(s, summary), ""]
        notes = [note["text"] for note in summary["notes"]]
        if notes:
            lines += ["Warnings of `run`:\n", *(f"- {fields.prose(note)}" for note in notes), ""]
    lines += ["## The file\n", f"```{{literalinclude}} ../../../scenarios/{name}.yaml", ":language: yaml", "```\n"]
    return "\n".join(lines)


def _open(name: str) -> list[str]:
    return [f'<a href="../../replays/{name}.html">Open the replay in its own page</a>, the `report.html` of the run.']


def lesson_of(name: str) -> str:
    """The comment at the head of a scenario's file, as a paragraph."""
    lines = []
    for line in (REPOSITORY / "scenarios" / f"{name}.yaml").read_text().splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").rstrip())
    return fields.prose(" ".join(lines))


def _facts(name: str, s: Scenario) -> list[str]:
    by_dimension = {"planar": 2, "spatial": 3}
    count = {kind: sum(len(a.position) == n for a in s.agents) for kind, n in by_dimension.items()}
    agents = " and ".join(f"{n} {kind}" for kind, n in count.items() if n)
    row = [f"{agents} agent{'s' * (len(s.agents) > 1)}", f"{len(s.targets)} target{'s' * (len(s.targets) > 1)}"]
    row += [f"{s.time.end - s.time.start:g} s", f"gain {s.controller.gain:g} 1/s"]
    team = load_scenario(name, replays.RUN_AS.get(name, ("", {}))[1]).team.dirichlet
    return [", ".join(row) + (f"; the smallest eigenvalue of H is {_smallest(team):.3g}." if team.unique else ".")]


def _smallest(dirichlet: Any) -> float:
    from numpy.linalg import eigvalsh

    H = dirichlet.H
    return float(eigvalsh(H.toarray() if hasattr(H, "toarray") else H)[0])


def _errors(s: Scenario, summary: dict[str, Any]) -> list[str]:
    """Errors at the end of the run, and the bounds that a test holds both backends to."""
    final = summary["final"]
    rows = [f"| at the end, m | {' | '.join(_WORDS)} |", "|---" * (1 + len(MEASURES)) + "|"]
    rows += [f"| {who} | {_row(values)} |" for who, values in {"team": final, **final["groups"]}.items()]
    for backend, words in (("physics", "bodies"), ("ideal", "ideal kinematics")):
        bounds = getattr(s.expect, backend)
        if bounds is not None:
            rows.append(f"| a test holds on {words}, at most | {_row(bounds.model_dump())} |")
    return rows


def _row(values: dict[str, Any]) -> str:
    return " | ".join("" if values.get(n) is None else f"{values[n]:.3g}" for n in MEASURES)
