"""Counts in words."""

import pytest

from emla_cosim.base.wording import format_count, format_number, format_rounded


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((0, "step"), "0 steps"),
        ((1, "step"), "1 step"),
        ((2, "step"), "2 steps"),
        ((1, "connection comes", "connections come"), "1 connection comes"),
        ((7, "connection comes", "connections come"), "7 connections come"),
        ((1690000001, "seed"), "1690000001 seeds"),
        ((12345, "run"), "12345 runs"),
    ],
)
def test_a_count_agrees_with_what_is_counted(arguments: tuple[int, str], text: str) -> None:
    assert format_count(*arguments) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1690000001.0, "1690000001"),
        (2147483647, "2147483647"),
        (-3.0, "-3"),
        (0.123456789, "0.123457"),
        (1234567.5, "1.23457e+06"),
        (1e308, "1e+308"),
        (float("nan"), "nan"),
        (float("-inf"), "-inf"),
    ],
)
def test_whole_numbers_have_all_their_digits(value: float, text: str) -> None:
    assert format_number(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0012345, "0.00123"),
        (123.4, "123"),
        (999.96, "1000"),
        (1234.6, "1235"),
        (-49152831.2, "-49152831"),
        (3e300, "3e+300"),
        (float("inf"), "inf"),
        (float("nan"), "nan"),
    ],
)
def test_rounded_numbers_have_no_separators(value: float, text: str) -> None:
    """1,235 would be one and a quarter for readers with a decimal comma."""
    assert format_rounded(value) == text
