"""Mend the encoding of a model description."""

import codecs
import re
from collections.abc import Iterator

from .record import Change

_CHECK = "description.encoding"
_DECLARATION = re.compile(r"\s*<\?xml\b[^>]*\?>\s*")
_ENCODING = re.compile(rb"""<\?xml\b[^>]*?encoding\s*=\s*["']([\w.:-]+)["']""")
_OF_UTF_8 = re.compile(rb"[\xc2-\xf4][\x80-\xbf]+")
_UTF_8 = '<?xml version="1.0" encoding="UTF-8"?>'
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_NAMES_OF_UTF_8 = ("utf-8", "utf_8", "utf8")


def mend_encoding(content: bytes) -> tuple[bytes, list[Change]]:
    """Return a document in UTF-8 that declares it, and what was changed.

    Bytes that are neither in the declared encoding nor, all of them, in Windows-1252 stay: nothing shows
    what they mean.
    """
    changes = list[Change]()
    text = _decode(content, changes)
    if text is None:
        return content, []
    declared = _DECLARATION.match(text)
    before = declared[0].strip() if declared else ""
    encoding = _ENCODING.search(before.encode("ascii", "replace"))
    if encoding is None or encoding[1].decode().lower() not in _NAMES_OF_UTF_8:
        changes.append(Change(_CHECK, "the first line", before, _UTF_8))
        text = f"{_UTF_8}\n{text[declared.end() if declared else 0 :]}"
    return (text.encode(), changes) if changes else (content, [])


def _decode(content: bytes, changes: list[Change]) -> str | None:
    """Return the text of a document, and note how it was read if it is not UTF-8."""
    if content.startswith(codecs.BOM_UTF8):
        changes.append(Change(_CHECK, "the byte order mark", "EF BB BF", ""))
        content = content.removeprefix(codecs.BOM_UTF8)
    match = _ENCODING.match(content[:200].lstrip())
    declared = "utf-8" if match is None else match[1].decode().lower()
    if content.startswith(_UTF_16):
        declared = "utf-16"
    for encoding in _list_encodings(content, declared):
        try:
            text = content.decode(encoding)
        except (UnicodeDecodeError, LookupError):
            continue
        if encoding not in _NAMES_OF_UTF_8:
            changes.append(Change(_CHECK, "the encoding", encoding.upper(), "UTF-8"))
        return text
    return None


def _list_encodings(content: bytes, declared: str) -> Iterator[str]:
    yield declared
    if declared in _NAMES_OF_UTF_8 and _OF_UTF_8.search(content) is None:
        yield "windows-1252"  # nothing in it is UTF-8
