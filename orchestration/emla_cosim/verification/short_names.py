"""What FMUs are called where their paths are too long."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path


def shorten_names(names: Sequence[str]) -> list[str]:
    """The last parts of names that are paths, as many as it takes to tell them apart."""
    paths = [Path(name) for name in names]
    found = [path.name for path in paths]
    for depth in range(2, max((len(p.parts) for p in paths), default=0) + 1):
        count = Counter(found)
        clashes = {n for n, k in count.items() if k > 1}
        found = ["/".join(p.parts[-depth:]) if n in clashes else n for p, n in zip(paths, found, strict=True)]
    return found
