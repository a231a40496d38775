"""Derive a variable's LaTeX symbol from its attribute."""

import re

_LETTERS = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi|omega|"
    "varphi|varpi|ell|Gamma|Delta|Theta|Lambda|Xi|Phi|Psi|Omega"
)
"""Greek letters with a LaTeX command."""
_ACCENTS = ("hat", "bar")
_WORDS = ("max", "min", "measured", "available")
"""Words that may be subscripts; any other word makes an attribute a plain name, such as `x_L_start`."""


def symbol_of(attribute: str, dimensions: int = 0) -> str:
    r"""Return the symbol of an attribute, such as `\hat{x}` for x_hat; empty if the attribute is a word.

    A symbol is a letter, or the name of a Greek one, with subscripts, such as `M_BS` and `alpha_RL`. `_hat`
    and `_bar` are accents, `_ref` is a star. Arrays have an index for each of their `dimensions`.
    """
    head, *below = attribute.split("_")
    symbol = head if len(head) == 1 else f"\\{head}" if _LETTERS.fullmatch(head) else ""
    if not symbol or any(len(part) > 3 and part not in _WORDS and not part.isupper() for part in below):
        return ""
    for accent in _ACCENTS:
        if accent in below:
            below.remove(accent)
            symbol = f"\\{accent}{{{symbol}}}"
    star = "^*" if "ref" in below else ""
    below = [part for part in below if part != "ref"] + list("ijk"[:dimensions])
    if len(below) > 3:
        return ""
    index = ",".join(below)
    return symbol + (f"_{index}" if len(index) == 1 else f"_{{{index}}}" if index else "") + star
