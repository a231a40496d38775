"""Names in the code say what they contain, and its prose follows the rules of the documentation."""

import pytest

from tests.support.identifiers import VAGUE, count_vague_names, find_faults_of_prose

MOST = dict.fromkeys(VAGUE, 0)
"""Most definitions of vague names. Lower a number when you rename some; never raise it."""


@pytest.mark.parametrize("words", VAGUE)
def test_vague_names_do_not_return(words: str) -> None:
    definitions = count_vague_names()[words]
    assert len(definitions) <= MOST[words], f"{VAGUE[words]}\n" + "\n".join(definitions)


def test_docstrings_comments_and_messages_are_plain() -> None:
    faults = find_faults_of_prose("src", "orchestration")
    assert not faults, "\n" + "\n".join(faults)
