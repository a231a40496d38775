"""The options `--quiet` and `--show-fit` of many commands."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer

_FLAGS: dict[str, Any] = {
    "quiet": Annotated[bool, typer.Option("--quiet", "-q", help="Show only errors.")],
    "show_fit": Annotated[
        bool,
        typer.Option(
            "--show-fit",
            help="List the variables of a replacement FMU, even if all match.",
            rich_help_panel="What comes out",
        ),
    ],
}


def with_verbosity(command: Callable[..., None], replaces: bool) -> Callable[..., None]:
    """Add `--quiet` to a command, and `--show-fit` to one that replaces components."""
    flags = {n: a for n, a in _FLAGS.items() if replaces or n != "show_fit"}

    @wraps(command)
    def called(**values: Any) -> None:
        from ...views.terminal import Verbosity, use_verbosity

        given = {name: values.pop(name) for name in flags}
        with use_verbosity(Verbosity(given["quiet"], given.get("show_fit", False))):
            command(**values)

    signature = inspect.signature(command, eval_str=True)
    own = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
        for name, annotation in flags.items()
    ]
    parameters = [*signature.parameters.values(), *own]
    called.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    called.__annotations__ = {p.name: p.annotation for p in parameters}
    return called
