"""Put the tables of a comparison into a page: `python -m docs.paste docs/paper.md comparison results/study`.

What stands in the page between `<!-- NAME begins -->` and `<!-- NAME ends -->` gives way to the folder's
comparison.md.
"""

import sys
from pathlib import Path


def pasted(page: str, name: str, tables: str) -> str:
    """The page with the tables in their place; ValueError where it has none."""
    begin, end = f"<!-- {name} begins -->", f"<!-- {name} ends -->"
    before, found, rest = page.partition(begin)
    _, ended, after = rest.partition(end)
    if not (found and ended):
        raise ValueError(f"the page has no place between '{begin}' and '{end}'")
    return f"{before}{begin}\n{tables.strip()}\n{end}{after}"


def main(page: str, name: str, folder: str) -> None:
    """Paste, and write the page."""
    path = Path(page)
    tables = (Path(folder) / "comparison.md").read_text(encoding="utf-8")
    path.write_text(pasted(path.read_text(encoding="utf-8"), name, tables), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
