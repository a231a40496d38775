"""Put the tables of a comparison into a page: `python -m docs.paste docs/tools.md foreign OUTPUT`.

The text between `<!-- NAME begins -->` and `<!-- NAME ends -->` is replaced by the folder's comparison.md.
"""

import sys
from pathlib import Path


def pasted(page: str, name: str, tables: str) -> str:
    """Return the page with the tables; raise ValueError if it has no place for them."""
    begin, end = f"<!-- {name} begins -->", f"<!-- {name} ends -->"
    before, found, rest = page.partition(begin)
    _, ended, after = rest.partition(end)
    if not (found and ended):
        raise ValueError(f"the page has no place between '{begin}' and '{end}'")
    return f"{before}{begin}\n{tables.strip()}\n{end}{after}"


def main(page: str, name: str, folder: str) -> None:
    """Paste the tables, and write the page."""
    path = Path(page)
    tables = (Path(folder) / "comparison.md").read_text(encoding="utf-8")
    path.write_text(pasted(path.read_text(encoding="utf-8"), name, tables), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
