"""What is written goes to regular files of its own, whole or not at all, one run per folder."""

import errno
import json
import os
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
import fmublock.files
from emla_cosim.sandbox.locking import exclusive_lock
from fmublock.files import NotAFileError, real_place, write_atomically
from tests.support.commands import Emla, sentence
from tests.support.few_figures import DRAWN, draw_few
from tests.support.full_disk import files_of_at_most
from tests.support.whole_files import names

SHORT = ("--stop-time", "0.002", "--no-plots")


def a_pipe(path: Path) -> None:
    os.mkfifo(path)


def a_folder(path: Path) -> None:
    path.mkdir()


KINDS: list[tuple[Callable[[Path], None], str]] = [(a_pipe, "it is a pipe"), (a_folder, "it is a folder")]


# ---- what is no file -------------------------------------------------------------------------------


@pytest.mark.parametrize(("make", "words"), KINDS)
@pytest.mark.parametrize("link", [False, True], ids=["itself", "a link"])
def test_what_is_no_file_is_not_replaced(
    make: Callable[[Path], None], words: str, link: bool, emla: Emla, tmp_path: Path
) -> None:
    place = tmp_path / "place"
    make(place)
    kind = stat.S_IFMT(place.lstat().st_mode)
    named = tmp_path / "link"
    if link:
        named.symlink_to(place)
        words = "it is a symbolic link"
    target = named if link else place
    (tmp_path / "out").mkdir()
    for name in ("results.csv", "metrics.json", "tracking.png"):
        target.rename(tmp_path / "out" / name)
        arguments = SHORT[:2] if name.endswith("png") else SHORT
        assert words in sentence(emla("run", "lift", *arguments, "--output", "out"), 2)
        (tmp_path / "out" / name).rename(target)
    assert words in sentence(emla("run", "lift", *SHORT, "--checkpoint", str(target)), 2)
    exported = tmp_path / "x.ssp"
    target.rename(exported)
    assert words in sentence(emla("export", "lift", "x.ssp"), 2)
    exported.rename(target)
    assert stat.S_IFMT(place.lstat().st_mode) == kind
    assert target.is_symlink() == link


def test_names_that_no_file_can_have(emla: Emla, fmu_folder: Path) -> None:
    name = "n" * 300
    assert "the checkpoint" in sentence(emla("run", "lift", *SHORT, "--checkpoint", name), 2)
    assert "the output folder" in sentence(emla("run", "lift", *SHORT, "--output", name), 2)
    assert "cannot be written" in sentence(emla("export", "lift", f"{name}.ssp"), 2)
    with ec.load("lift", stop_time=0.002).prepare(fmus=fmu_folder) as simulation:
        with pytest.raises(ec.CommandError, match=r"the checkpoint .* cannot be written: .*null"):
            simulation.run(checkpoint="x\0y")
        with pytest.raises(ec.CommandError, match=r"the output folder .* cannot be written: .*null"):
            simulation.run().save("x\0y")


def test_a_link_is_neither_followed_nor_replaced(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    for link in ("out/metrics.json", "out/results.csv", "c", "x.ssp"):
        (tmp_path / link).symlink_to(tmp_path / "elsewhere" / "file")
        command = ("export", "lift", "x.ssp") if link == "x.ssp" else ("run", "lift", *SHORT)
        more = () if link == "x.ssp" else ("--output", "out", "--checkpoint", "c")
        assert "it is a symbolic link" in sentence(emla(*command, *more, "--overwrite"), 2)
        assert (tmp_path / link).is_symlink()
        (tmp_path / link).unlink()
    assert not list((tmp_path / "elsewhere").iterdir())


def test_links_to_folders_are_followed(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").symlink_to("elsewhere")
    assert emla("run", "lift", *SHORT, "--output", "out", "--checkpoint", "out/c").exit_code == 0
    assert names(tmp_path / "elsewhere") == {"results.csv", "metrics.json", "run.json", "c"}


# ---- one use of one name ---------------------------------------------------------------------------


def test_a_file_is_not_used_for_two_things(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "my.toml").write_text('system = "lift"\nstop_time = 0.002\nplots = false\n')
    assert emla("export", "lift", "x.ssp").exit_code == 0
    (tmp_path / "link.ssp").symlink_to("x.ssp")
    before = (tmp_path / "x.ssp").read_bytes()
    for arguments, words in (
        (("run", "lift", "--output", "o", "--checkpoint", "o/results.csv"), "is also a file of the results"),
        (
            ("run", "lift", "--output", "o", "--checkpoint", "o/../o/run.json"),
            "is also a file of the results",
        ),
        (("run", "my.toml", "--checkpoint", "my.toml"), "the checkpoint 'my.toml' is also the scenario"),
        (
            ("run", "x.ssp", "--checkpoint", "link.ssp"),
            "the checkpoint 'link.ssp' cannot be written: it is a",
        ),
        (("run", "lift", "--replace", "lift.plant=x.ssp", "--checkpoint", "x.ssp"), "is also the FMU"),
        (("export", "x.ssp", "x.ssp"), "the package 'x.ssp' is also the scenario"),
        (("export", "x.ssp", "link.ssp"), "the package 'link.ssp' cannot be written: it is a symbolic"),
    ):
        more = SHORT if arguments[0] == "run" else ()
        assert words in sentence(emla(*arguments, *more), 2)
    assert (tmp_path / "x.ssp").read_bytes() == before


def test_a_checkpoint_replaces_checkpoints_only(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "thesis").write_text("years of work")
    text = sentence(emla("run", "lift", *SHORT, "--checkpoint", "thesis"), 2)
    assert "'thesis' was not written by emla. Choose another file for the checkpoint" in text
    assert (tmp_path / "thesis").read_text() == "years of work"
    (tmp_path / "empty").touch()
    for _ in range(2):
        assert emla("run", "lift", *SHORT, "--checkpoint", "empty").exit_code == 0


def test_an_fmu_that_goes_elsewhere_does_not_move_results(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()

    class Going(ec.Recorder):
        def pause(self, run: Any) -> None:
            os.chdir(tmp_path / "elsewhere")

    with ec.load("lift", stop_time=0.002).prepare(fmus=fmu_folder) as simulation:
        simulation.run(recorders=[Going(), ec.TimeSeries()], checkpoint="c").save(tmp_path / "out")
    assert (tmp_path / "c").exists()
    assert not any((tmp_path / "elsewhere").iterdir())


def test_paths_are_relative_to_where_a_simulation_was_prepared(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "c").write_text("years of work")
    monkeypatch.chdir(tmp_path / "here")
    with ec.load("lift", stop_time=0.002).prepare(fmus=fmu_folder) as simulation:
        monkeypatch.chdir(tmp_path / "elsewhere")  # as an FMU may do while it is loaded
        for stop in (0.002, 0.003):
            simulation.run(checkpoint="c", stop_time=stop)
        resumed = simulation.run(resume="c", stop_time=0.004)
        assert resumed.simulated_s == pytest.approx(0.001)
        with pytest.raises(ec.CommandError, match="the checkpoint 'sub/c' cannot be written: there is no"):
            (tmp_path / "elsewhere" / "sub").mkdir()
            simulation.run(checkpoint="sub/c")
    assert (tmp_path / "elsewhere" / "c").read_text() == "years of work"


# ---- one run per folder ----------------------------------------------------------------------------


def test_a_second_run_into_a_folder_is_refused(emla: Emla, tmp_path: Path) -> None:
    code = "from emla_cosim.sandbox.locking import exclusive_lock; from pathlib import Path; import sys\n"
    code += "with exclusive_lock(Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    (tmp_path / "out").mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "out")],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as other:  # fmt: skip
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        text = sentence(emla("run", "lift", *SHORT, "--output", "out"), 2)
        assert f"another run writes to '{tmp_path / 'out'}', process {other.pid} since 20" in text
        other.kill()
    assert emla("run", "lift", *SHORT, "--output", "out").exit_code == 0
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}


def test_what_was_not_ready_when_a_run_was_killed_goes_with_the_next(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/.unfinished-ab_3zxyz").write_text("half")
    assert emla("run", "lift", *SHORT, "--output", "out").exit_code == 0
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}


def test_a_folder_is_locked_without_a_name_on_a_full_disk(tmp_path: Path) -> None:
    refused = pytest.raises(ec.CommandError, match=r"another run writes to '[^']*'. Wait for it")
    with files_of_at_most(1), exclusive_lock(tmp_path), refused, exclusive_lock(tmp_path):
        pass
    assert not any(tmp_path.iterdir())


def test_runs_into_other_folders_go_on(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    with exclusive_lock(tmp_path / "a"), exclusive_lock(tmp_path / "b"):
        pass
    assert not any((tmp_path / "a").iterdir())


# ---- whole or not at all ---------------------------------------------------------------------------


def test_a_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "f"
    path.write_bytes(b"before")
    path.chmod(0o640)
    with pytest.raises(KeyError), write_atomically(path) as stream:
        stream.write(b"half")
        raise KeyError
    assert path.read_bytes() == b"before"
    with write_atomically(path) as stream:
        stream.write(b"after")
        stream.flush()
        assert path.read_bytes() == b"before"
    assert path.read_bytes() == b"after"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert [p.name for p in tmp_path.iterdir()] == ["f"]


CALLS = ("fsync", "replace", "chmod", "write")


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("what", ["run", "checkpoint", "export"])
def test_a_call_that_fails_leaves_whole_files(
    call: str, what: str, emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each place where our files are put down is made to fail, one after the other."""
    draw_few(monkeypatch)
    arguments = {
        "run": ["run", "lift", "--stop-time", "0.02", "--output", "out"],
        "checkpoint": ["run", "lift", *SHORT, "--output", "out", "--checkpoint", "c"],
        "export": ["export", "lift", "x.ssp"],
    }[what]
    assert emla(*arguments).exit_code == 0
    kept = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file() and p.suffix != ".csv"}
    places, failures = 0, 0
    while True:
        made = {"count": 0}

        def failing(made: dict[str, int] = made, at: int = places) -> None:
            made["count"] += 1
            if made["count"] == at + 1:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        with monkeypatch.context() as patch:
            break_call(patch, call, failing)
            result = emla(*arguments)
        if made["count"] <= places:
            break
        places += 1
        assert "No space left on device" in sentence(result, 1)
        failures += 1
        for path in tmp_path.rglob("*"):
            assert not path.name.startswith(".unfinished")
            if path.suffix == ".json":
                json.loads(path.read_text())
            elif path.suffix == ".png":
                assert path.read_bytes().endswith(b"IEND\xaeB`\x82")
            elif path in kept and path.name in ("c", "x.ssp"):
                assert path.read_bytes() == kept[path]
    assert failures == places >= {"run": 2 + DRAWN}.get(what, 1)


def refuse_links(self: Path, target: Path) -> None:
    """Fail as on a file system without hard links."""
    raise OSError(errno.EPERM, os.strerror(errno.EPERM))


def break_call(patch: pytest.MonkeyPatch, call: str, failing: Callable[[], None]) -> None:
    """Let one of the calls of `write_atomically` do something first."""
    if call == "fsync":
        original = os.fsync
        patch.setattr(fmublock.files.os, "fsync", lambda handle: (failing(), original(handle)))
        return
    if call == "write":
        opened = os.fdopen

        def fdopen(handle: int, mode: str) -> Any:
            stream = opened(handle, mode)
            failing_once = stream.write

            class Stream:
                def __getattr__(self, name: str) -> Any:
                    return getattr(stream, name)

                def __enter__(self) -> Any:
                    return self

                def __exit__(self, *error: object) -> None:
                    stream.close()

                def write(self, content: bytes) -> int:
                    if not getattr(self, "begun", False):
                        self.begun = True
                        failing()
                    return failing_once(content)

            return Stream()

        patch.setattr(fmublock.files.os, "fdopen", fdopen)
        return
    if call == "replace":  # otherwise new files are linked to their name
        patch.setattr(Path, "hardlink_to", refuse_links)
    method = getattr(Path, call)

    def broken(self: Path, *arguments: Any) -> Any:
        if self.name.startswith(".unfinished"):
            failing()
        return method(self, *arguments)

    patch.setattr(Path, call, broken)


def test_real_places(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OSError):
        real_place(tmp_path / "a")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("folder")
    assert real_place(tmp_path / "link" / "new") == (tmp_path / "folder" / "new").resolve()
    for name in ("link", "a"):
        with pytest.raises(NotAFileError, match="it is a symbolic link"):
            real_place(tmp_path / name)
    with pytest.raises(NotAFileError, match="it is a folder"):
        real_place(tmp_path / "folder" / "..")


def test_the_time_of_a_lock_is_told(tmp_path: Path) -> None:
    with exclusive_lock(tmp_path):
        found = json.loads((tmp_path / ".running.json").read_text())
        assert found["process"] == os.getpid()
        assert found["began"].startswith(time.strftime("%Y"))
        with pytest.raises(ec.CommandError, match=f"process {os.getpid()} since"), exclusive_lock(tmp_path):
            pass


@pytest.mark.parametrize(
    "kinds", [(ec.CsvFile, ec.ParquetFile), (ec.ParquetFile, ec.CsvFile), (ec.CsvFile,) * 2]
)
def test_several_tables_in_one_folder_are_each_replaced(
    kinds: tuple[Any, Any], fmu_folder: Path, tmp_path: Path
) -> None:
    paths = tmp_path / "first", tmp_path / "second"
    with ec.load("lift", stop_time=0.002, fmus=fmu_folder).prepare() as simulation:
        for _ in range(2):
            simulation.run(recorders=[kind(path) for kind, path in zip(kinds, paths, strict=True)])
        for path in paths:
            path.write_bytes(path.read_bytes() + b"\n")
            with pytest.raises(ec.CommandError, match=f"{path.name}' was changed since emla wrote it"):
                simulation.run(recorders=[ec.CsvFile(path)])
            path.unlink()


@pytest.mark.parametrize(("kind", "name"), [(ec.CsvFile, "mine.csv"), (ec.ParquetFile, "mine.parquet")])
def test_tables_made_in_python_replace_only_their_own_files(
    kind: Any, name: str, fmu_folder: Path, tmp_path: Path
) -> None:
    path, other = tmp_path / name, tmp_path / "notes.txt"
    path.write_text("precious")
    other.write_text("precious")
    with ec.load("lift", stop_time=0.005, fmus=fmu_folder).prepare() as simulation:
        with pytest.raises(ec.CommandError, match=f"{name}' was not written by emla"):
            simulation.run(recorders=[kind(path)])
        assert path.read_text() == "precious"
        simulation.run(recorders=[kind(path, overwrite=True)])
        first = path.read_bytes()
        simulation.run(recorders=[kind(path)], stop_time=0.003)
        assert path.read_bytes() != first
        path.write_bytes(path.read_bytes() + b"\n")
        with pytest.raises(ec.CommandError, match=f"{name}' was changed since emla wrote it"):
            simulation.run(recorders=[kind(path)])
        path.unlink()
        path.symlink_to(other)
        with pytest.raises(ec.CosimError, match="link"):
            simulation.run(recorders=[kind(path, overwrite=True)])
        assert path.is_symlink() and other.read_text() == "precious"
        path.unlink()
        whole, parts = tmp_path / f"whole-{name}", tmp_path / f"parts-{name}"
        simulation.run(recorders=[kind(whole)])
        simulation.run(recorders=[kind(parts)], stop_time=0.003, checkpoint=tmp_path / "c")
        simulation.run(recorders=[kind(parts)], resume=tmp_path / "c")
        assert parts.read_bytes() == whole.read_bytes()


@pytest.mark.parametrize("replaced", [False, True])
def test_rows_that_went_to_a_file_that_is_gone_are_missed(
    replaced: bool, fmu_folder: Path, tmp_path: Path
) -> None:
    """Whoever removes or replaces the table while it grows is told that the rows are not there."""
    path = tmp_path / "results.csv"

    class Removing(ec.Recorder):
        def write(self, rows: Any) -> None:
            path.unlink()
            if replaced:
                path.write_text("precious")

    with (
        ec.load("lift", stop_time=0.01, fmus=fmu_folder).prepare() as simulation,
        pytest.raises(ec.RunError, match="removed or replaced while the run wrote to it"),
    ):
        simulation.run(recorders=[ec.CsvFile(path), Removing()])
    assert not replaced or path.read_text() == "precious"


def test_a_device_is_no_scenario(emla: Emla, tmp_path: Path) -> None:
    device = tmp_path / "endless.toml"
    device.symlink_to("/dev/zero")
    done = emla("run", str(device))
    assert done.exit_code == 2
    assert "it is a device" in done.output
