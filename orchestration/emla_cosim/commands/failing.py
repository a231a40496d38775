"""How a command ends that fails."""

from collections.abc import Callable
from functools import wraps
from typing import Any

import typer

from ..errors import CosimError


def one_sentence(command: Callable[..., None]) -> Callable[..., None]:
    """End a command that fails with one sentence and its exit code."""

    @wraps(command)
    def guarded(*args: Any, **kwargs: Any) -> None:
        from rich.markup import escape

        from ..terminal import ERR

        try:
            command(*args, **kwargs)
        except CosimError as error:
            ERR.print(f"[bold red]Error:[/] {escape(str(error))}", highlight=False, soft_wrap=True)
            raise typer.Exit(error.exit_code) from error
        except KeyboardInterrupt as error:
            ERR.print("[bold red]Interrupted.[/]")
            raise typer.Exit(1) from error

    return guarded
