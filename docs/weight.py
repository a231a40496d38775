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
    "building FMUs: symbols and a C compiler for all platforms": ("casadi", "ziglang", "pythonfmu"),
    "documents in FMUs, SSP": ("latex2mathml", "markdown-it-py", "mdit-py-plugins", "lxml"),
    "pictures and pages": ("matplotlib", "contourpy", "pillow", "bokeh", "jinja2", "markupsafe"),
    "sweeps, tuning, trajectories": ("cloudpickle", "cma", "scipy"),
    "loops of connections": ("networkx",),
    "verifying binaries": ("lief",),
}
"""What our requirements are for; each is listed once."""


def main() -> None:
    """Print the table."""
    counted: set[str] = set()
    print("| For | Packages | MB |")
    print("|---|---|---:|")
    whole = 0.0
    for part, roots in {**PARTS, "EMLA-Cosim itself": (OURS,)}.items():
        found = {name: megabytes(d) for name, d in needed(roots) if name not in counted}
        counted |= set(found)
        whole += sum(found.values())
        heavy = sorted((name for name, size in found.items() if size >= 5), key=lambda name: -found[name])
        named = ", ".join(f"{name} {found[name]:.0f}" for name in heavy)
        print(f"| {part} | {named} | {sum(found.values()):.0f} |")
    print(f"| together | | {whole:.0f} |")


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
