"""The `emla` command as a program: its streams, and how it ends, whatever they and its host are."""

import gc
import os
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

from ..sandbox.interruption import exit_on_interrupt, ignore_interrupts

try:
    import resource  # while there is memory for it
except ImportError:  # of Windows
    resource = None

COLLECT = 50_000
"""Objects made between two looks for garbage: imports make many that stay, which need no look every 700."""


def main() -> None:
    """Run the command; it ends with 0, 1 or 2, and where that is not 0 with one sentence."""
    gc.set_threshold(COLLECT)
    sys.stdout, sys.stderr = (_make_writable(stream) for stream in (sys.stdout, sys.stderr))
    if _command(sys.argv[1:]) in ("run", "rerun"):  # which call what others compiled
        from ..sandbox.guard import run_supervised  # which no other command needs

        run_supervised(_run, _rescue)
    else:
        _run()


def _command(arguments: Sequence[str]) -> str:
    """The command among these arguments, which --quiet may stand before."""
    return next((a for a in arguments if not a.startswith("-")), "")


def _run() -> None:
    try:
        with exit_on_interrupt(_exit_interrupted):
            from .app import app

            if "_EMLA_COMPLETE" in os.environ:  # a shell asks what completes a line
                from .completion import answer

                answer(app)
            app()
    except KeyboardInterrupt:
        _exit_with_error("Interrupted.")
    except SystemExit:
        raise
    except (ImportError, MemoryError) as error:
        *_, reason = str(error).strip().rstrip(".").splitlines() or ["there is not enough memory"]
        _exit_with_error(f"Error: emla cannot be started: {reason}.")
    except OSError as error:  # of help, or of what is wrong with the command, which others put out
        if not _can_write(sys.stdout, "\n"):
            _exit_with_error(f"Error: the standard output cannot be written: {error.strerror}.")
        if not _can_write(sys.stderr, "\n"):
            sys.exit(2)
        raise
    except BaseException:  # libraries fail in many ways where memory ends
        if (limit := _memory_limit()) is None:
            raise
        _exit_with_error(
            f"Error: emla needs more memory than the {limit / 2**20:.0f} MiB that it may have (ulimit -v)."
        )
    finally:
        ignore_interrupts()
        for stream in (sys.stdout, sys.stderr):
            if not _can_write(stream):  # it was told; Python would end with a code of its own
                _redirect_to_null(stream)


def _memory_limit() -> int | None:
    """Bytes of memory that this process may address; None without a limit, or where nobody knows."""
    if resource is None:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def _rescue(how: str) -> None:
    ended = time.monotonic()
    from .commands.crash_rescue import rescue_results

    rescue_results(how, ended)


def _make_writable(stream: TextIO | None) -> TextIO:
    """A stream that can take any text, where its encoding lacks a letter with another in its place."""
    if stream is None:  # it was closed
        return Path(os.devnull).open("w", encoding="utf-8")
    if isinstance(stream, TextIOWrapper):
        stream.reconfigure(errors="replace")
    return stream


def _can_write(stream: TextIO, text: str = "") -> bool:
    """Whether a stream takes a text, and what waits to be written to it."""
    try:
        stream.write(text)
        stream.flush()
    except OSError:
        return False
    return True


def _redirect_to_null(stream: TextIO) -> None:
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def _exit_interrupted() -> None:
    """End before a command has begun: nothing is there that had to be tidied up."""
    with suppress(OSError):
        os.write(2, b"Interrupted.\n")
    from ..sandbox import black_box

    black_box.current_activity().ended = 1
    os._exit(1)


def _exit_with_error(sentence: str) -> None:
    from ..sandbox import black_box

    sys.stderr.write(f"{sentence}\n")
    black_box.current_activity().ended = 1  # whatever the end of Python itself still fails at
    sys.exit(1)
