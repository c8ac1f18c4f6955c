"""Formulas as MathML, which every current browser draws itself: no script and no network.

A browser needs a font with mathematical tables, or roots do not join and braces grow. The site brings one along: STIX
Two Math, under the SIL Open Font License, reduced to the characters of formulas.
"""

import logging
import re
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from fontTools import subset
from fontTools.ttLib import TTFont
from latex2mathml.converter import convert
from sphinx.application import Sphinx

MATHML = "http://www.w3.org/1998/Math/MathML"
MACROS = {r"\face": r"\trianglelefteq", r"\R": r"\mathbb{R}", r"\F": r"\mathcal{F}", r"\Hm": r"\mathcal{H}"}
"""The paper's own commands, in standard LaTeX."""
FONT = "math.woff"
"""File in _static that site.css names."""

_FIXED = "‖|"  # bars that MathML would stretch to the height of their row
_CHARACTERS = (
    *((0x20, 0x7F), (0xA0, 0x100), (0x2B0, 0x400), (0x2000, 0x2150), (0x2190, 0x2400), (0x25A0, 0x25D0)),
    *((0x27C0, 0x2800), (0x1D400, 0x1D800)),
)


def translate(latex: str, *, block: bool) -> str:
    """Translate a formula to MathML."""
    for name, meaning in MACROS.items():
        latex = re.sub(re.escape(name) + r"(?![A-Za-z])", lambda _, meaning=meaning: meaning + " ", latex)
    ElementTree.register_namespace("", MATHML)
    root = ElementTree.fromstring(convert(latex.strip(), display="block" if block else "inline"))
    for operator in root.iter(f"{{{MATHML}}}mo"):
        if (operator.text or "") in _FIXED and "stretchy" not in operator.attrib:
            operator.set("stretchy", "false")
    return ElementTree.tostring(root, encoding="unicode")


def _inline(writer: Any, node: nodes.Element) -> None:
    writer.body.append(translate(node.astext(), block=False))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.Element) -> None:
    target = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    writer.body.append(f'<div class="formula"{target}>{translate(node.astext(), block=True)}</div>')
    raise nodes.SkipNode


def write_font(path: Path) -> None:
    """Write the font for formulas, without the characters that they do not use."""
    logging.getLogger("fontTools").setLevel(logging.WARNING)
    options = subset.Options(layout_features=["*"], name_IDs=["*"])
    chosen = subset.Subsetter(options)
    chosen.populate(unicodes=[code for first, end in _CHARACTERS for code in range(first, end)])
    with files("ziamath").joinpath("fonts/STIXTwoMath-Regular.ttf").open("rb") as file:
        font = TTFont(file, recalcTimestamp=False)
        chosen.subset(font)
        font.flavor = "woff"
        path.parent.mkdir(parents=True, exist_ok=True)
        font.save(path)


def _finish(app: Sphinx, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        write_font(Path(app.outdir) / "_static" / FONT)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("build-finished", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
