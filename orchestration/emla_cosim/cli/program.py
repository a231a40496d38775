"""The `emla` command as a program: its standard streams, exit codes and last error messages."""

import gc
import logging
import os
import sys
import threading
import time
import warnings
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper
from pathlib import Path
from typing import TextIO

from fmublock.files import remove_leftovers

from ..base.interruption import POLITE, ignore_interrupts, on_interrupt

try:
    import resource  # import it now: later there may not be enough memory
except ImportError:  # Windows
    resource = None

COLLECT = 50_000
"""Allocations between two garbage collections. Imports make many lasting objects; every 700 is too often."""


UNSUPERVISED = ("", "list", "schema")
"""Commands that have no supervising process, because they load little; empty for options alone."""

RUNS = ("run", "rerun")
"""Commands whose results the supervising process completes."""


def main() -> None:
    """Run the command. Exit with 0, or with 1 or 2 and an error message."""
    gc.set_threshold(COLLECT)
    sys.stdout, sys.stderr = (_make_writable(stream) for stream in (sys.stdout, sys.stderr))
    if "_EMLA_COMPLETE" not in os.environ:
        remove_leftovers()
    if _find_command(sys.argv[1:]) in UNSUPERVISED or "_EMLA_COMPLETE" in os.environ:
        _run()
    else:  # compiled code of FMUs and libraries can end the process
        from .supervisor import run_supervised

        run_supervised(_run, _handle_end, _report_late_call)


def _find_command(arguments: Sequence[str]) -> str:
    """Return the name of the command; `--quiet` may precede it."""
    return next((a for a in arguments if not a.startswith("-")), "")


def _run() -> None:
    """Run the command, or answer a shell that asks for completions.

    Errors that the command does not report become one message and the exit code 1.
    """
    try:
        if _read_memory_limit() is not None:
            os.environ.setdefault("POLARS_MAX_THREADS", "1")  # it waits for threads that get no memory
            _silence_libraries()
        with on_interrupt(_exit_interrupted):
            from .app import app

            if "_EMLA_COMPLETE" in os.environ:  # a shell asks for completions
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
    except OSError as error:  # from printing help or a usage error
        if not _try_to_write(sys.stdout, "\n"):
            _exit_with_error(f"Error: the standard output cannot be written: {error.strerror}.")
        if not _try_to_write(sys.stderr, "\n"):
            sys.exit(2)
        raise
    except BaseException as error:  # libraries fail in many ways when memory runs out
        if type(error).__name__ == "PanicException":  # polars has written why
            _try_to_write(sys.stdout)
            os._exit(1)  # the supervising process completes the results
        if (limit := _read_memory_limit()) is None:
            raise
        _exit_with_error(
            f"Error: emla needs more memory than its limit of {limit / 2**20:.0f} MiB (ulimit -v)."
        )
    finally:
        ignore_interrupts()
        for stream in (sys.stdout, sys.stderr):
            if not _try_to_write(stream):  # already reported; Python would exit with another code
                with Path(os.devnull).open("w") as nowhere:
                    os.dup2(nowhere.fileno(), stream.fileno())


def _read_memory_limit() -> int | None:
    """Return the limit of the address space in bytes, or None if there is no limit or it is unknown."""
    if resource is None:
        return None
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def _silence_libraries() -> None:
    """Discard what libraries write to the standard error stream when they get no memory."""
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    threading.excepthook = sys.unraisablehook = lambda _: None  # libraries' threads and destructors
    with suppress(OSError, ValueError):
        sys.stderr.flush()
        number = sys.stderr.fileno()
        stderr_copy = os.fdopen(os.dup(number), "w", 1, encoding=sys.stderr.encoding, errors="replace")
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), number)
        sys.stderr = stderr_copy


def _handle_end(how: str) -> None:
    """Complete the results of a run whose process ended; of other commands, print why it ended."""
    ended = time.monotonic()
    command = _find_command(sys.argv[1:])
    if command in RUNS:
        from .commands.crash_rescue import rescue_results

        rescue_results(how, ended)
        return
    if how in {number.name for number in POLITE}:  # it ended before its own handler was set
        sys.stderr.write("Interrupted.\n")
        return
    limit = _read_memory_limit()
    reason = "" if limit is None else f", perhaps at its memory limit of {limit / 2**20:.0f} MiB (ulimit -v)"
    more = " --resume continues what was begun." if command == "sweep" else ""
    sys.stderr.write(f"Error: the process of `emla {command}` ended ({how}){reason}.{more}\n")


def _report_late_call(seconds: int, is_requested: bool) -> None:
    from .commands.crash_rescue import report_late_call

    report_late_call(seconds, is_requested)


def _make_writable(stream: TextIO | None) -> TextIO:
    """Return a stream that accepts any text and replaces letters that its encoding lacks."""
    if stream is None:  # closed by the caller
        return Path(os.devnull).open("w", encoding="utf-8")
    if isinstance(stream, TextIOWrapper):
        stream.reconfigure(errors="replace")
    return stream


def _try_to_write(stream: TextIO, text: str = "") -> bool:
    """Write a text and what is in the buffer. Return whether the stream accepted them."""
    try:
        stream.write(text)
        stream.flush()
    except OSError:
        return False
    return True


def _exit_interrupted() -> None:
    """Exit before a command has begun, when there is nothing to clean up."""
    with suppress(OSError):
        os.write(2, b"Interrupted.\n")
    from ..base import crash_page

    crash_page.current_activity().ended = 1
    os._exit(1)


def _exit_with_error(sentence: str) -> None:
    from ..base import crash_page

    sys.stderr.write(f"{sentence}\n")
    crash_page.current_activity().ended = 1  # even if the shutdown of Python fails later
    sys.exit(1)
