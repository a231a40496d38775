"""Counts in words."""

import pytest

from emla_cosim.wording import counted


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((0, "step"), "0 steps"),
        ((1, "step"), "1 step"),
        ((2, "step"), "2 steps"),
        ((1, "connection comes", "connections come"), "1 connection comes"),
        ((7, "connection comes", "connections come"), "7 connections come"),
        ((1690000001, "seed"), "1690000001 seeds"),
        ((12345, "run", "", ","), "12,345 runs"),
    ],
)
def test_a_count_agrees_with_what_is_counted(arguments: tuple[int, str], said: str) -> None:
    assert counted(*arguments) == said
