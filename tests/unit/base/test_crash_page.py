"""The page of memory that outlives its process."""

from contextlib import closing

import pytest

from emla_cosim.base import crash_page
from emla_cosim.base.channel import Channel
from emla_cosim.base.crash_page import CrashPageFile
from emla_cosim.base.process import Child


def _note(channel: Channel, page: CrashPageFile, length: int) -> None:
    crash_page.share_file(page.path)
    crash_page.write_note("fmi2DoStep")
    crash_page.current_activity().noted = length
    channel.send("done")


@pytest.mark.parametrize(("length", "note"), [(4, "fmi2"), (-1, ""), (2**60, "")])
def test_note_on_a_page_to_which_an_fmu_wrote(length: int, note: str) -> None:
    with closing(CrashPageFile()) as page, closing(Child(_note, page, length, fork=True)) as child:
        assert child.receive() == "done"
        assert page.note() == note
