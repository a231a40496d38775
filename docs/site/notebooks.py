"""Notebooks as pages of the site, executed during the build, so that outputs are of this version."""

import re
import tempfile
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

LONGEST = 120
"""Time limit of a cell in s."""

CELL = '<div class="emla-cosim">'
"""Start of what notebooks show of systems, FMUs and results."""

PICTURE = re.compile('src="data:image/png;base64,([^"]*)"')
"""A picture in it, which becomes a file of the site."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, with its pictures and a download of the notebook."""
    for notebook in [f for f in files if f.src_uri.endswith(".ipynb")]:
        for file in _pages(notebook, config):
            files.append(file)
    return files


def _pages(notebook: File, config: MkDocsConfig) -> Iterator[File]:
    assert notebook.abs_src_path is not None
    stem = notebook.src_uri.removesuffix(".ipynb")
    name = Path(stem).name
    parts = []
    pictures = 0
    for cell in _executed(Path(notebook.abs_src_path)).cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(_fenced("python", cell.source))
        for output in cell.outputs:
            data = output.get("data", {})
            shown = data.get("text/html", "")
            shown = shown if shown.startswith(CELL) else ""  # data frames are shown as text
            embedded = PICTURE.search(shown)
            encoded = embedded[1] if embedded else data.get("image/png")
            if encoded:
                pictures += 1
                picture = f"{stem}-{pictures}.png"
                yield File.generated(config, picture, content=b64decode(encoded))
            if shown:
                parts.append(PICTURE.sub(f'src="{name}-{pictures}.png"', shown))
            elif encoded:
                parts.append(f"![What the lines above draw]({name}-{pictures}.png)")
            elif text := data.get("text/plain") or _printed(output):
                parts.append(_fenced("text", text))
    parts.insert(1, f'<a href="{name}.ipynb" download>Download this page as a notebook.</a>')
    yield File.generated(config, f"{stem}.md", content="\n\n".join(parts) + "\n")


def _executed(path: Path) -> Any:
    """Return the notebook with its outputs, executed in an empty folder."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        try:
            NotebookClient(
                notebook,
                timeout=LONGEST,
                kernel_name="python3",
                resources={"metadata": {"path": folder}},
                extra_arguments=["--log-level=ERROR"],
            ).execute()
        except CellExecutionError as error:
            raise PluginError(f"{path.name} does not run: {error.ename}: {error.evalue}") from error
    return notebook


def _printed(output: Any) -> str:
    return output.text if output.output_type == "stream" and output.name == "stdout" else ""


def _fenced(language: str, text: str) -> str:
    return f"```{language}\n{text.rstrip()}\n```"
