"""Formulas as MathML, which every current browser draws itself: no script, no fonts, no network.

docutils translates LaTeX; Sphinx has renderers that need MathJax or images.
"""

from typing import Any

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx

MACROS = {r"\face": r"\trianglelefteq", r"\R": r"\mathbb{R}", r"\F": r"\mathcal{F}", r"\Hm": r"\mathcal{H}"}
"""The paper's own commands; none is the beginning of another command that the pages use."""


def _translated(node: nodes.Element, *, block: bool) -> str:
    text = node.astext()
    for name in sorted(MACROS, key=len, reverse=True):
        text = text.replace(name + "{", MACROS[name] + " {").replace(name + "_", MACROS[name] + "_")
        text = text.replace(name + " ", MACROS[name] + " ").replace(name + "^", MACROS[name] + "^")
        text = text.replace(name + "\\", MACROS[name] + "\\")
    return str(latex2mathml.tex2mathml(text, as_block=block))


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
