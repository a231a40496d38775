"""The `emla` command as a program: its streams, and how it ends, whatever they and its host are."""

import gc
import os
import sys
import time
from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

from .guard import guarded
from .interruption import ending_as_ctrl_c

COLLECT = 50_000
"""Objects made between two looks for garbage: imports make many that stay, which need no look every 700."""

_INTERRUPTED = 130
"""How typer ends where Ctrl-C comes before a command begins, without a word."""


def main() -> None:
    """Run the command; it ends with 0, 1 or 2, and where that is not 0 with one sentence."""
    gc.set_threshold(COLLECT)
    sys.stdout, sys.stderr = (_usable(stream) for stream in (sys.stdout, sys.stderr))
    if sys.argv[1:2] == ["run"]:  # which calls what others compiled
        guarded(_run, _rescue)
    else:
        _run()


def _run() -> None:
    try:
        with ending_as_ctrl_c():
            from .cli import app

            app()
    except KeyboardInterrupt:  # while something was imported
        _end("Interrupted.")
    except SystemExit as end:
        if end.code == _INTERRUPTED:
            _end("Interrupted.")
        raise
    except (ImportError, MemoryError) as error:
        _end(f"Error: emla cannot be started: {str(error) or 'there is not enough memory'}.")


def _rescue(how: str) -> None:
    ended = time.monotonic()
    from .commands.rescue import rescue

    rescue(how, ended)


def _usable(stream: TextIO | None) -> TextIO:
    """A stream that can take any text, where its encoding lacks a letter with another in its place."""
    if stream is None:  # it was closed
        return Path(os.devnull).open("w", encoding="utf-8")
    if isinstance(stream, TextIOWrapper):
        stream.reconfigure(errors="replace")
    return stream


def _end(sentence: str) -> None:
    sys.stderr.write(f"{sentence}\n")
    sys.exit(1)
