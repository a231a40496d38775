"""Control characters from files are shown escaped by everything that prints."""

import io
from pathlib import Path

import pytest
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from emla_cosim.views import terminal
from emla_cosim.views.terminal import BarProgress
from tests.support.commands import Emla, sentence

HOSTILE = "a\x1b]0;owned\x07b\x9b31mc\u202ed"
"""It names the window, colours what follows, and turns the direction."""

HARMFUL = "\x1b\x07\x9b\u202e"


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What both consoles print."""
    stream = io.StringIO()
    for console in (terminal.OUT, terminal.ERR):
        monkeypatch.setattr(console, "_file", stream)
        monkeypatch.setattr(console, "width", 200)
    return stream


def test_control_characters_are_escaped(printed: io.StringIO) -> None:
    table = Table(HOSTILE, title=escape(HOSTILE))
    table.add_row(HOSTILE)
    terminal.print_line(HOSTILE)
    terminal.show(HOSTILE)
    terminal.show(Text(HOSTILE))
    terminal.show(table)
    terminal.show_error(HOSTILE)
    terminal.show_warning(HOSTILE)
    BarProgress().note(HOSTILE)
    text = printed.getvalue()
    assert not any(character in text for character in HARMFUL)
    assert text.count("\\x9b31mc\\u202ed") == 9


def test_message_is_one_line_for_any_name(printed: io.StringIO) -> None:
    for show in (terminal.show_error, terminal.show_warning):
        show("'a\nb\r\n c' does not exist.\n  Nor does 'd'.\n")
    lines = printed.getvalue().split("\n")
    assert lines == [
        "Error: 'a\\nb\\r\\n c' does not exist.",
        "  Nor does 'd'.",
        "",
        "Warning: 'a\\nb\\r\\n c' does not exist.",
        "  Nor does 'd'.",
        "",
    ]


def test_hostile_table_header_is_escaped(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("time,a\n0,1\n1,2\n")
    message = sentence(emla("plot", "r.csv", "--signals", HOSTILE), 2)
    assert "\\x1b" in message and not any(character in message for character in HARMFUL)
    (tmp_path / "h.csv").write_text("time,ok\x1b[31m,b\n0,1,2\n1,2,3\n")
    message = sentence(emla("plot", "h.csv", "--signals", "nothing"), 2)
    assert not any(character in message for character in HARMFUL)
