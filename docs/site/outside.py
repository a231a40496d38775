"""Add pages from outside docs/ to the site, and turn links to files without a page into plain text."""

import logging
import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
MODELS = (
    *(
        "EmlaPlant",
        "EmlaCompliantPlant",
        "EmlaAxis",
        "EmlaCompliantAxis",
        "EmlaMotor",
        "EmlaObserver",
        "LoadObserver",
        "Reference",
        "ScrewCommand",
        "HoldingBrake",
        "Disturbance",
        "SharedSupply",
        "SignalFault",
    ),
    *("RsbaController", "FocController", "CacController", "AnatcController"),
    *("HdrmManipulator", "HdrmPlant", "Trajectory"),
)
OUTSIDE = {
    "CHANGELOG.md": "changelog.md",
    "benchmarks/README.md": "benchmarks.md",
    "modelica/README.md": "modelica.md",
    **{f"fmus/{model}/README.md": f"fmus/{model}.md" for model in MODELS},
}
"""Pages of the site by their path in the project."""

_ORIGINS = {page: origin for origin, page in OUTSIDE.items()}
_LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\]]*\])*)\]\((?!https?:|#)([^)\s#]+)(#[^)\s]*)?\)")

log = logging.getLogger("mkdocs.hooks.outside")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages from outside docs/."""
    for origin, page in OUTSIDE.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / origin)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point links to the pages of the site, and drop those to files without a page."""
    here = page.file.src_uri
    origin = _ORIGINS.get(here, f"docs/{here}")

    def changed(link: re.Match[str]) -> str:
        text, target, anchor = link[1], link[2], link[3] or ""
        place = posixpath.normpath(posixpath.join(posixpath.dirname(origin), target))
        if not (ROOT / place).exists():
            log.warning("'%s' links to '%s', which is not there", origin, target)
        made = OUTSIDE.get(place) or OUTSIDE.get(f"{place}/README.md")
        if made is None and place.startswith("docs/"):
            made = re.sub(r"\.ipynb$", ".md", place.removeprefix("docs/"))
        if made is None:
            return text
        return f"[{text}]({posixpath.relpath(made, posixpath.dirname(here) or '.')}{anchor})"

    return _LINK.sub(changed, markdown)
