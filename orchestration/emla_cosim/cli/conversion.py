"""Values of the command line, which are converted only if they need it.

typer converts each value with pydantic, also one that is missing. To import pydantic takes a tenth of the
time of a short run, and most options are missing, texts or paths: `commands/options.py` reads these itself.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from typer.core import TyperCommand


class PlainCommand(TyperCommand):
    """A command whose parameters load their converter at the first value that is no plain text or path."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, with that of `--help`."""
        parameters = super().get_params(ctx)
        for parameter in parameters:
            with suppress(AttributeError):  # another release of typer, which then converts by itself
                _convert_late(parameter)
        return parameters


def _convert_late(parameter: Any) -> None:
    """Replace the method of a parameter that returns its converter.

    Raises:
        AttributeError: The parameter has no such method, or does not describe its type.
    """
    load, described = parameter.get_runtime_param, parameter.type_descriptor
    takes_several = parameter.multiple or parameter.nargs == -1
    plain = {(list[kind] if takes_several else kind): kind for kind in (str, Path)}
    has_parser = described.parameter_info.parser is not None
    kind = None if has_parser else plain.get(described.annotation)
    if not isinstance(load, partial):  # else it was replaced before
        parameter.get_runtime_param = partial(_LateConverter, load, takes_several, kind)


class _LateConverter:
    """Converter of a parameter, in place of the one that `load` returns."""

    def __init__(self, load: Callable[[], Any], takes_several: bool, plain: type[str | Path] | None) -> None:
        self._load, self._takes_several, self._plain = load, takes_several, plain

    def coerce(self, value: Any, **more: Any) -> Any:
        """Return the value as typer's converter does."""
        if value is None:
            return () if self._takes_several else None
        if self._plain is not None and _is_text(value, self._takes_several):
            return [self._plain(one) for one in value] if self._takes_several else self._plain(value)
        return self._load().coerce(value, **more)


def _is_text(value: Any, several: bool) -> bool:
    """Return whether a value is a text, or a list of texts if the parameter takes several."""
    if not several:
        return isinstance(value, str)
    return isinstance(value, (list, tuple)) and all(isinstance(one, str) for one in value)
