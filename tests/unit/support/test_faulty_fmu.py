"""The faulty FMU counts what other tests expect never to happen."""

from pathlib import Path

from tests.support.hand_written_fmus import Counts, Fault
from tests.support.sessions import FATAL, opened, refused


def test_calls_after_fatal_and_states_not_freed_are_counted(faulty_fmu: Path, tmp_path: Path) -> None:
    with opened(faulty_fmu, tmp_path) as faulty:
        counts = Counts(faulty.folder)
        slave, other = faulty.instance("test", fault=Fault.FATAL, at=0.05), faulty.instance("other")
        slave.getFMUstate()
        with refused(FATAL):
            slave.doStep(0.0, 0.1)
        assert counts.calls_after_fatal == 0
        for call in (slave.terminate, slave.reset, slave.getFMUstate, other.terminate):
            with refused(FATAL):
                call()
        faulty.instance("later").terminate()  # instances made later are not affected
        assert counts.instances == 3
    assert (counts.calls_after_fatal, counts.states, counts.instances) == (4, 1, 0)
