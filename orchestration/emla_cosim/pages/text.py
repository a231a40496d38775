"""Convert values for JSON, and make text from files safe: visible, valid and of limited length."""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

_HIDDEN = re.compile(
    "[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f"  # control characters, which XML and HTML do not allow
    "\u061c\u200b\u200e\u200f\u2028-\u202e\u2060-\u2069\ufeff"  # invisible, or changing the direction
    "\ufdd0-\ufdef\ufffe\uffff\ud800-\udfff]"  # not characters
)


def make_visible(text: object) -> str:
    r"""Return the text with harmful and invisible characters written out, such as `\x1b` and `\u202e`."""
    return _HIDDEN.sub(_escape, str(text)).replace("\r", "\n")


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def shorten_text(text: str, most: int) -> str:
    """Shorten a text of more than `most` letters to its beginning and its end."""
    if len(text) <= most:
        return text
    end = most // 4
    return f"{text[: most - end]} … {text[-end:]}"


def format_number(value: Any, digits: int = 4) -> str:
    """Format a number for a page; other values as text."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return make_visible(value)
    if isinstance(value, int):
        return str(value) if abs(value) < 10**15 else f"{float(value):.{digits}g}" if value < 10**300 else "∞"
    if math.isnan(value):
        return "not a number"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    return f"{value:.{digits}g}"


def to_plain(value: Any) -> Any:
    """Convert a value to dictionaries, lists, texts, finite numbers, Booleans and None.

    Numbers that JSON does not have become None; other objects become text.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {_replace_surrogates(str(name)): to_plain(inner) for name, inner in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [to_plain(inner) for inner in value]
    if isinstance(value, float):
        # JSON has neither NaN nor infinity
        return float(value) if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int)):
        return value
    return _replace_surrogates(str(value))


def _replace_surrogates(text: str) -> str:
    """Replace unpaired surrogates, which file names may contain, by a visible sign."""
    return text.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
