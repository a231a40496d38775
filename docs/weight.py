"""Print the size of the installation by purpose: `python -m docs.weight`.

The result is the table of docs/installation.md: megabytes of the files of every required distribution. One
that several purposes need counts for the first.
"""

import re
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

OURS = "emla-cosim"

PARTS = {
    "stepping FMUs": (
        "attrs",
        "fmpy",
        "numpy",
        "psutil",
        "filelock",
        "platformdirs",
        "msgspec",
    ),
    "tables: CSV and Parquet, millions of rows": ("polars",),
    "the command line": ("click", "rich", "lazy-loader"),
    "SSP and other documents": (
        "lxml",
        "jinja2",
        "markupsafe",
        "latex2mathml",
        "markdown-it-py",
        "mdit-py-plugins",
    ),
    "loops of connections": ("networkx",),
    "verifying binaries": ("lief",),
}
"""What the requirements of the base are for; each is listed once."""

EXTRAS = ("plots", "analyses", "build", "cluster")
"""Extras in the order of the table; a package counts for the first one that needs it."""


def main() -> None:
    """Print the table."""
    counted: set[str] = set()
    print("| For | Packages | MB |")
    print("|---|---|---:|")
    whole = 0.0
    for part, roots in {**PARTS, "EMLA-Cosim itself": (OURS,)}.items():
        whole += print_row(part, roots, counted)
    print(f"| **base** | | **{whole:.0f}** |")
    for extra in EXTRAS:
        print_row(f"the extra `{extra}`", tuple(requirements_of(extra)), counted, "+ ")


def print_row(part: str, roots: tuple[str, ...], counted: set[str], sign: str = "") -> float:
    """Print the packages that are not counted yet, and return their megabytes."""
    found = {name: megabytes(d) for name, d in needed(roots) if name not in counted}
    counted |= set(found)
    heavy = sorted((name for name, size in found.items() if size >= 5), key=lambda name: -found[name])
    named = ", ".join(f"{name} {found[name]:.0f}" for name in heavy)
    size = sum(found.values())
    print(f"| {part} | {named} | {sign}{size:.0f} |")
    return size


def requirements_of(extra: str) -> Iterator[str]:
    """Return the names of the packages of an extra."""
    for requirement in distribution(OURS).requires or []:
        if f"extra == '{extra}'" in requirement.replace('"', "'"):
            yield normalized(requirement)


def needed(roots: tuple[str, ...]) -> Iterator[tuple[str, Distribution]]:
    """Return distributions by name: these and what they require; ours without its requirements."""
    left, seen = list(roots), set[str]()
    while left:
        name = left.pop()
        if name in seen:
            continue
        seen.add(name)
        try:
            found = distribution(name)
        except PackageNotFoundError:  # for another platform
            continue
        yield name, found
        if name != OURS:
            left += [normalized(r) for r in found.requires or [] if "extra ==" not in r]


def normalized(requirement: str) -> str:
    """Return the name of a distribution, as PyPI compares it."""
    return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()  # type: ignore[index]


def megabytes(found: Distribution) -> float:
    """Return the size of its files."""
    paths = (Path(str(file.locate())) for file in found.files or [])
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


if __name__ == "__main__":
    main()
