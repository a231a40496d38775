"""Tiers of tests by what they cost: default, slow and nightly; see tests/README.md."""

from collections.abc import Callable, Collection, Iterable
from typing import Any

import pytest
from hypothesis import settings

SLOW, NIGHTLY = "slow", "nightly"


class _Selection:
    """Whether nightly tests are selected; conftest.py sets it before tests are collected."""

    has_nightly = False


def select(expression: str) -> None:
    """Set how many examples `examples` draws, for an expression of `pytest -m`."""
    _Selection.has_nightly = f"not {NIGHTLY}" not in expression


def examples(few: int, many: int, **more: Any) -> Callable[[Any], Any]:
    """Draw `few` examples of a property, or `many` in the nightly tier; `more` are settings of hypothesis."""

    def decorate(test: Any) -> Any:
        if _Selection.has_nightly:
            test = pytest.mark.nightly(test)
        return settings(max_examples=many if _Selection.has_nightly else few, **more)(test)

    return decorate


def mostly_slow(values: Iterable[Any], by_default: Collection[Any]) -> list[Any]:
    """Return values to parametrize a test with, all in the slow tier except those of the default tier.

    Args:
        values: what `pytest.mark.parametrize` takes, without `pytest.param`; tuples for several arguments.
        by_default: those of the values that every run of the suite tries, at least one.
    """
    return _in_tier(values, by_default, pytest.mark.slow)


def mostly_nightly(values: Iterable[Any], by_default: Collection[Any]) -> list[Any]:
    """Return the same with all other values in the nightly tier."""
    return _in_tier(values, by_default, pytest.mark.nightly)


def _in_tier(values: Iterable[Any], by_default: Collection[Any], mark: pytest.MarkDecorator) -> list[Any]:
    values = list(values)
    missing = [value for value in by_default if value not in values]
    assert by_default and not missing, f"not among the values: {missing}"
    return [v if v in by_default else pytest.param(*_arguments(v), marks=mark) for v in values]


def _arguments(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)
