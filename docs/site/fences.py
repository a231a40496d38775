"""Remove the words after a fence, which are for the tests, and keep the name of a file as a title."""

import re

_FENCE = re.compile(r"^```(\w+) (?:file=(\S+)|.*)$", re.MULTILINE)


def on_page_markdown(markdown: str, **_: object) -> str:
    """Show the names of files as titles, and remove other words."""

    def shown(fence: re.Match[str]) -> str:
        return f'```{fence[1]} title="{fence[2]}"' if fence[2] else f"```{fence[1]}"

    return _FENCE.sub(shown, markdown)
