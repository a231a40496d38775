"""Convert equations to MathML, which browsers typeset without a script."""

import re
from html import unescape

from latex2mathml.converter import convert

_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(html: str, **_: object) -> str:
    """Typeset the formulas between $ or $$."""

    def typeset(found: re.Match[str]) -> str:
        return convert(unescape(found[3]).strip(), display="block" if found[2] == "[" else "inline")

    return _EQUATION.sub(typeset, html)
