"""Typeset equations as SVG, which looks the same in every browser and needs neither script nor font."""

import re
from html import escape, unescape

import ziafont
import ziamath

_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)

_SIZE = 17.0
"""Size of the letters in px, near that of the text."""

ziafont.config.svg2 = False  # no symbols that one picture defines for the next


def on_page_content(html: str, **_: object) -> str:
    """Typeset the formulas between $ or $$."""
    return _EQUATION.sub(lambda found: _typeset(unescape(found[3]).strip(), found[2] == "["), html)


def _typeset(formula: str, is_block: bool) -> str:
    """Return a formula as SVG in the colour of the text, with its source as the description."""
    drawing = ziamath.Latex(formula, size=_SIZE, inline=not is_block, color="currentColor")
    place = "" if is_block else f' style="vertical-align: {drawing.getyofst():.2f}px"'
    svg = drawing.svg().replace("<svg", f'<svg role="img" aria-label="{escape(formula)}"{place}', 1)
    return f'<div class="equation">{svg}</div>' if is_block else svg
