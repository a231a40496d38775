"""The required life: refused without a unit, and shown beside that of candidates."""

import pytest

from tests.support.commands import Emla, sentence


@pytest.mark.parametrize("life", ["20000", "2e4"])
def test_a_life_needs_a_unit(life: str, emla: Emla) -> None:
    message = sentence(emla("size", "prototype", "--life", life), 2)
    assert message == f"Error: --life is {life} without a unit; write it as {life}h or {life}s."
