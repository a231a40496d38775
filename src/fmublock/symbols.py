"""What equations call a variable: its symbol, as LaTeX writes it."""

import re

_LETTERS = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi|omega|"
    "varphi|varpi|ell|Gamma|Delta|Theta|Lambda|Xi|Phi|Psi|Omega"
)
"""Those that have a name in LaTeX."""
_ACCENTS = ("hat", "bar")
_WORDS = ("max", "min", "measured", "available")
"""Words that may stand below a symbol; another one makes an attribute a name, as `x_L_start`."""


def symbol_of(attribute: str, dimensions: int = 0) -> str:
    r"""The symbol that an attribute is, such as `\hat{x}` of x_hat; empty where it is a word.

    One letter, or the name of a Greek one, with what stands below it, as `M_BS` and `alpha_RL`; `_hat` and
    `_bar` are accents, `_ref` is a star. Arrays have an index for each of their `dimensions`.
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
