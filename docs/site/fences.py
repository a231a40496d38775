"""The words after a fence are for the tests; readers see the name of a file, and nothing of the rest."""

import re

_FENCE = re.compile(r"^```(\w+) (?:file=(\S+)|.*)$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Give files their name as a title, and leave other words out."""

    def shown(fence: re.Match[str]) -> str:
        return f'```{fence[1]} title="{fence[2]}"' if fence[2] else f"```{fence[1]}"

    return _FENCE.sub(shown, markdown)
