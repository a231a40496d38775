"""Exit codes and error messages of commands that fail."""

import sys
from collections.abc import Callable
from functools import wraps
from typing import Any

from ...base.errors import CosimError, find_exit_code
from ...base.files import get_working_folder
from ...sandbox.interruption import raise_on_interrupt


def exit_on_error(command: Callable[..., None]) -> Callable[..., None]:
    """Make a command that fails end with an error message and its exit code."""

    @wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        from ...views.terminal import show_error, show_interrupted

        try:
            with raise_on_interrupt():
                get_working_folder()
                command(*args, **kwargs)
        except CosimError as error:
            show_error(str(error))
            sys.exit(find_exit_code(error))
        except OSError as error:  # of a file or folder that cannot be used now
            reason = error.strerror or error
            show_error(f"'{error.filename}' cannot be used: {reason}." if error.filename else f"{reason}.")
            sys.exit(1)
        except KeyboardInterrupt:
            show_interrupted()
            sys.exit(1)

    return guarded
