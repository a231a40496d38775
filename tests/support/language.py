"""Rules for plain technical English, checked in Markdown or in any other text.

`check_text` takes prose: a docstring, a message, a paragraph. `check_page` takes a page in Markdown.
Both return one message per fault.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

LONGEST = 35
"""Most words in a sentence. Aim at 25."""

BANNED = {
    r"nobody|no one|whoever|whomever": "name who does it, or write 'no FMU', 'no user', 'without'",
    r"somebody|someone|anybody|everybody|everyone": "name the person or the part: 'another tool', 'any FMU'",
    r"(?:is|are|was|were|be|been|being|gets?) told": "write 'is reported', 'is set' or 'is listed'",
    r"None where": "write 'None if'",
    r"what (?:is|was|are|were) (?:given|told|said|asked|meant)": "name it: 'overrides', 'values', 'options'",
    r"how it is said": "write 'syntax' or 'how to write it'",
    r"stands|stood|stand for": "write 'is in', 'is listed in', 'represents'",
    r"bears?|borne": "write 'withstands', 'carries', 'tolerates'",
    r"gives? way|gave way": "write 'is replaced by'",
    r"for ever|for good": "write 'permanently' or 'continuously'",
    r"(?:a|one|the|this|these) sentences?": "write 'error message' or 'message'",
    r"drives? as (?:it is|they are)": "write 'realistic drive'",
    r"goes on|go on|went on": "write 'continues'",
    r"becomes? of": "write 'happens to' or name the result",
    r"at hand|hereby|herein|thereof|therein|whereof|wherein|whence|thence": "use a plain word",
    r"the usual": "write 'the default'",
    r"all it takes|makes much of|without a word": "say what to do",
}
"""Words and phrases to avoid, each with what to write instead."""

_ANY = re.compile(rf"\b(?:{'|'.join(BANNED)})\b", re.IGNORECASE)
_PATTERNS = [(re.compile(rf"\b(?:{words})\b", re.IGNORECASE), advice) for words, advice in BANNED.items()]
_SKIPPED = re.compile(
    r"<!-- ([\w -]+) begins? -->.*?<!-- \1 ends? -->|<!--.*?-->|\$\$.*?\$\$", re.DOTALL
)  # written by a program, comments, formulas
_FENCE = re.compile(r"^\s*(```|~~~)")
_ITEM = re.compile(r"^\s*(?:[-*+]|\d+\.)\s+")


@dataclass(frozen=True)
class Passage:
    """A paragraph, list item, heading, table row or caption, with the line where it begins."""

    line: int
    kind: str
    text: str


def check_page(markdown: str, name: str) -> list[str]:
    """Return the faults of a page: a missing first paragraph, banned words and long sentences.

    Args:
        markdown: The text of the page.
        name: The file's name, for messages.
    """
    parts = list(passages(markdown))
    after_title = [p for p in parts if p.kind != "title"]
    faults = []
    if not after_title or after_title[0].kind != "paragraph":
        line = after_title[0].line if after_title else 1
        faults.append(f"{name}:{line}: begin with a paragraph: what can you do with it, what do you need?")
    for passage in parts:
        long = passage.kind in {"paragraph", "item"}
        faults += check_text(passage.text, name, passage.line, with_length=long)
    return faults


def check_text(text: str, name: str, line: int = 1, *, with_length: bool = True) -> list[str]:
    """Return the faults of a piece of prose.

    Args:
        text: Prose; code between backticks, formulas and link targets are left out.
        name: The file's name, for messages.
        line: The line where the text begins.
        with_length: Whether to check the length of sentences.
    """
    plain = _without_markup(text)
    patterns = _PATTERNS if _ANY.search(plain) else []  # few texts have a fault, and there are many patterns
    faults = [
        f"{name}:{line + plain.count(chr(10), 0, hit.start())}: '{hit[0]}': {advice}"
        for pattern, advice in patterns
        for hit in pattern.finditer(plain)
    ]
    if with_length:
        for start, sentence in _sentences(plain):
            count = len(re.findall(r"\S*\w\S*", sentence))
            if count > LONGEST:
                begins = " ".join(sentence.split()[:6])
                at = line + plain.count("\n", 0, start)
                faults.append(f"{name}:{at}: {count} words in a sentence, at most {LONGEST}: '{begins} ...'")
    return faults


def passages(markdown: str) -> Iterator[Passage]:
    """Split a page into its passages, without code blocks, formulas and text that programs write."""
    markdown = _SKIPPED.sub(lambda m: "\n" * m[0].count("\n"), markdown)
    kind, begin, lines, in_code = "", 0, list[str](), False
    for number, line in enumerate([*markdown.splitlines(), ""], start=1):
        if _FENCE.match(line):
            in_code = not in_code
        starts = "" if in_code else _kind(line, kind)
        if lines and starts != "continued":
            yield Passage(begin, kind, "\n".join(lines))
            lines = []
        if in_code or _FENCE.match(line):
            kind = "code"
            if in_code and _FENCE.match(line):
                yield Passage(number, "code", "")
        elif starts == "continued":
            lines.append(line)
        elif starts:
            kind, begin, lines = starts, number, [_ITEM.sub("", line)]
        else:
            kind = ""


def _kind(line: str, before: str) -> str:
    """Return the kind of passage that a line begins, 'continued', or '' for an empty line."""
    text = line.strip()
    if not text:
        return ""
    if re.match(r"#+ ", text):
        return "title" if text.startswith("# ") else "heading"
    if text.startswith("|"):
        return "row"
    if text.startswith(("![", "<")):
        return "picture"
    if _ITEM.match(line):
        return "item"
    if text.startswith(":::"):
        return "code"
    return "continued" if before in {"paragraph", "item", "picture"} else "paragraph"


def _without_markup(text: str) -> str:
    """Replace code and formulas by a word each, and links by their text. Keep line breaks."""
    text = re.sub(r"(`+)(.+?)\1", lambda m: "CODE" + "\n" * m[2].count("\n"), text, flags=re.DOTALL)
    text = re.sub(r"\$[^$]+\$", lambda m: "FORMULA" + "\n" * m[0].count("\n"), text)
    return re.sub(r"\]\([^)]*\)", "", text).replace("[", "").replace("!", "")


def _sentences(text: str) -> Iterator[tuple[int, str]]:
    """Split prose into sentences, each with its position. They end where a capital or a sign follows."""
    start = 0
    for end in re.finditer(r"[.?][)\"'*_]*\s+(?=[^a-z\s])|\Z", text):
        yield start, text[start : end.end()]
        start = end.end()
