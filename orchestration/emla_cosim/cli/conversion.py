"""Values of the command line, which are converted only if they need it.

typer converts each value with pydantic, also one that is missing. To import pydantic takes a tenth of the
time of a short run, and most options are missing or plain texts: `commands/options.py` reads these itself.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from typer.core import TyperCommand


class PlainCommand(TyperCommand):
    """A command whose parameters load their converter at the first value that is not a plain text."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, with that of `--help`."""
        parameters = super().get_params(ctx)
        for parameter in parameters:
            load = getattr(parameter, "get_runtime_param", None)  # a method until it is replaced here
            if load is not None and not isinstance(load, partial):
                parameter.get_runtime_param = partial(_LateConverter, load)  # type: ignore[attr-defined]
        return parameters


class _LateConverter:
    """Converter of a parameter, in place of the one that `load` returns."""

    def __init__(self, load: Callable[[], Any]) -> None:
        self._load = load

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return the value as typer's converter does."""
        several = param.multiple or param.nargs == -1
        if value is None:
            return () if several else None
        described = param.type_descriptor
        is_plain = described.parameter_info.parser is None and _is_text(value, several)
        if is_plain and described.annotation == (list[str] if several else str):
            return list(value) if several else value
        return self._load().coerce(value, param=param, ctx=ctx)


def _is_text(value: Any, several: bool) -> bool:
    """Return whether a value is a text, or a list of texts if the parameter takes several."""
    if not several:
        return isinstance(value, str)
    return isinstance(value, (list, tuple)) and all(isinstance(one, str) for one in value)
