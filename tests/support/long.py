"""What only `pytest -m long` tries: more examples of what other tests check with a few."""

from collections.abc import Callable, Collection, Iterable
from typing import Any

import pytest
from hypothesis import settings

MARK = "long"


class _Wanted:
    """Whether long tests are selected; conftest.py says so before tests are collected."""

    is_long = False


def heed(expression: str) -> None:
    """Set how many examples `examples` draws, for an expression of `pytest -m`."""
    _Wanted.is_long = f"not {MARK}" not in expression


def examples(few: int, many: int, **more: Any) -> Callable[[Any], Any]:
    """Draw `few` examples of a property by default and `many` with the long tests; `more` are settings."""

    def decorate(test: Any) -> Any:
        if _Wanted.is_long:
            test = pytest.mark.long(test)
        return settings(max_examples=many if _Wanted.is_long else few, **more)(test)

    return decorate


def mostly_long(values: Iterable[Any], by_default: Collection[Any]) -> list[Any]:
    """Return values to parametrize a test with, all marked as long but those used by default.

    Args:
        values: what `pytest.mark.parametrize` takes, without `pytest.param`; tuples for several arguments.
        by_default: those of the values that every run of the suite tries, at least one.
    """
    values = list(values)
    missing = [value for value in by_default if value not in values]
    assert by_default and not missing, f"not among the values: {missing}"
    return [
        value if value in by_default else pytest.param(*_arguments(value), marks=pytest.mark.long)
        for value in values
    ]


def _arguments(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)
