"""Short names for FMUs in reports."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path


def shorten_names(names: Sequence[str]) -> list[str]:
    """Shorten paths to the last parts that distinguish them."""
    paths = [Path(name) for name in names]
    found = [path.name for path in paths]
    for depth in range(2, max((len(p.parts) for p in paths), default=0) + 1):
        count = Counter(found)
        clashes = {n for n, k in count.items() if k > 1}
        found = ["/".join(p.parts[-depth:]) if n in clashes else n for p, n in zip(paths, found, strict=True)]
    return found
