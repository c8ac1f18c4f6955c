"""Formulas as MathML, which every current browser draws itself: no script, no fonts, no network.

docutils translates LaTeX; Sphinx has renderers that need MathJax or images.
"""

import html
import re
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx

MATHML = "http://www.w3.org/1998/Math/MathML"
ACCENTS = {"˙": "˙", "_": "¯", "~": "~", "^": "^"}
"""Of docutils, and as they are drawn."""
MACROS = {r"\face": r"\trianglelefteq", r"\R": r"\mathbb{R}", r"\F": r"\mathcal{F}", r"\Hm": r"\mathcal{H}"}
"""The paper's own commands, and what docutils knows."""


def _translated(node: nodes.Element, *, block: bool) -> str:
    text = node.astext()
    for name, meaning in MACROS.items():
        text = re.sub(re.escape(name) + r"(?![A-Za-z])", lambda _, meaning=meaning: meaning + " ", text)
    return _with_indices(str(latex2mathml.tex2mathml(text, as_block=block)))


def _with_indices(mathml: str) -> str:
    """Put the index of an accented letter beside it; docutils puts it below, as limits of a sum."""
    ElementTree.register_namespace("", MATHML)
    known = re.sub(r"&(?!lt;|gt;|amp;)\w+;", lambda entity: html.unescape(entity[0]), mathml)
    root = ElementTree.fromstring(known)
    for node in root.iter(f"{{{MATHML}}}munderover"):
        letter, index, accent = node
        if accent.tag == f"{{{MATHML}}}mo" and accent.text in ACCENTS:
            node.tag = f"{{{MATHML}}}msub"
            accented = ElementTree.Element(f"{{{MATHML}}}mover", {"accent": "true"})
            accented.extend([letter, accent])
            accent.text = ACCENTS[accent.text]
            node[:] = [accented, index]
    return ElementTree.tostring(root, encoding="unicode")


def _inline(writer: Any, node: nodes.Element) -> None:
    writer.body.append(_translated(node, block=False))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.Element) -> None:
    target = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    writer.body.append(f'<div class="formula"{target}>{_translated(node, block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer `mathml`."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
