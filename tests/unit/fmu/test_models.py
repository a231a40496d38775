"""Where FMUs lie, when they are built again, and what that costs."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path
from textwrap import dedent

import pytest

from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.fmu.models import MODELS, PLATFORMS, build, check_disclosure, fmu_path
from fmublock import (
    Block,
    Disclosure,
    Documents,
    Input,
    Output,
    Producer,
    building,
    load_block,
    recipe,
)
from fmublock import cache as cache_module
from fmublock.archive import read_built
from fmublock.recipe import Recipe
from tests.support.prebuilt import without_prebuilt
from tests.support.tiers import mostly_slow

TEXT = """
    import parts
    from fmublock import Block, Output

    class Own(Block):
        y = Output()

        def outputs(self, v):
            return {"y": parts.GAIN * v.time}
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache; the current folder is empty, too."""
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.setenv(cache_module.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def define_block(folder: Path, gain: float = 2.0, text: str = TEXT) -> type[Block]:
    (folder / "parts.py").write_text(f"GAIN = {gain}\n")
    (folder / "own.py").write_text(dedent(text))
    return load_block(f"{folder / 'own.py'}:Own")


# ---- the key -----------------------------------------------------------------------------------


def test_key_changes_with_everything_in_the_fmu(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [tmp_path / name for name in "abcd"]
    for folder in paths:
        folder.mkdir()
    block = define_block(paths[0])
    key = Recipe.of(block, "native").key()
    assert key is not None and key == Recipe.of(define_block(paths[1]), "native").key()
    keys = [
        key,
        Recipe.of(block, "python").key(),
        Recipe.of(block, "native", Producer("somebody")).key(),
        Recipe.of(block, "native", None, Documents("# Own")).key(),
        Recipe.of(define_block(paths[2], gain=3.0), "native").key(),
        Recipe.of(define_block(paths[3], text=TEXT.replace("v.time", "v.time / 2.0")), "native").key(),
    ]
    for owner, name, value in (
        (block, "default_experiment", MODELS["Reference"].default_experiment),
        (recipe, "_read_fmublock_files", lambda: ("another shim",)),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, value)
            keys.append(Recipe.of(block, "native").key())
    assert None not in keys
    assert len(set(keys)) == len(keys)


def test_key_is_the_same_in_all_versions_of_python(tmp_path: Path) -> None:
    block = define_block(tmp_path)
    keys = set()
    for docstring in (
        "A block.\n\n    With details.\n    ",
        "A block.\n\nWith details.\n",
    ):  # of 3.12 and 3.13
        block.__doc__ = docstring
        keys.add(Recipe.of(block, "native").key())
    assert len(keys) == 1


def define_gain_block(gain: float) -> type[Block]:
    class GainBlock(Block):
        u = Input()
        y = Output()

        def outputs(self, v: object) -> dict[str, float]:
            return {"y": gain}

    return GainBlock


def test_block_with_unknown_sources_has_no_key(tmp_path: Path) -> None:
    assert Recipe.of(define_gain_block(1.0), "native").key() is None
    assert Recipe.of(type("Derived", (define_block(tmp_path),), {}), "native").key() is None
    foreign = define_block(tmp_path, text=TEXT.replace("import parts", "import numpy, parts"))
    assert Recipe.of(foreign, "native").key() is None
    block = define_block(tmp_path)
    os.utime(tmp_path / "parts.py", (block.origin.time + 1.0,) * 2)
    assert Recipe.of(block, "native").key() is None


READS = ("READ = open('gain.txt').read()", "from pathlib import Path; READ = Path('gain.txt').read_text()")


@pytest.mark.parametrize("read", READS)
def test_files_that_blocks_read_are_not_overlooked(read: str, cache: Path, tmp_path: Path) -> None:
    text = TEXT.replace("import parts", read).replace("parts.GAIN", "float(READ)")
    keys = set()
    for gain in ("2.0", "3.0"):
        Path("gain.txt").write_text(gain)
        block_recipe = Recipe.of(define_block(tmp_path, text=text), "native")
        keys.add(block_recipe.key() or building.draft_of(block_recipe).key)
    assert len(keys) == 2


def test_blocks_without_a_key_are_cached_by_content(cache: Path) -> None:
    first, second = (build(define_gain_block(gain), "native", []) for gain in (1.0, 2.0))
    assert first.parent != second.parent and first.read_bytes() != second.read_bytes()
    written = first.stat().st_mtime_ns
    assert build(define_gain_block(1.0), "native", []) == first
    assert first.stat().st_mtime_ns == written


# ---- where an FMU lies -------------------------------------------------------------------------


@pytest.mark.parametrize("flavour", mostly_slow(["native", "python"], ["native"]))
def test_fmu_without_a_folder_is_in_the_cache(cache: Path, tmp_path: Path, flavour: str) -> None:
    """It is built again only if it is corrupt."""
    first = build(define_block(tmp_path), flavour, [])
    assert first.is_relative_to(cache) and first.name == "Own.fmu"
    assert list(Path().iterdir()) == []
    written = first.stat().st_mtime_ns
    assert build(define_block(tmp_path), flavour, []) == first
    changed = build(define_block(tmp_path, gain=3.0), flavour, [])
    assert changed != first and changed.is_relative_to(cache)
    assert build(define_block(tmp_path, gain=2.0), flavour, []) == first
    assert first.stat().st_mtime_ns == written
    good = first.read_bytes()
    first.write_bytes(good[: len(good) // 2])
    assert build(define_block(tmp_path), flavour, []) == first
    assert first.read_bytes() == good


@pytest.mark.slow
def test_fmus_of_the_current_folder_come_first_and_are_rebuilt(cache: Path, tmp_path: Path) -> None:
    local_path = fmu_path("Own", "native", Path("fmus"))
    assert build(define_block(tmp_path), "native", ["win64"], Path("fmus")) == local_path
    before = local_path.read_bytes()
    assert build(define_block(tmp_path), "native", []) == local_path
    assert read_built(local_path).platforms > {"win64"}  # and this machine's
    assert build(define_block(tmp_path, gain=3.0), "native", []) == local_path
    assert local_path.read_bytes() != before
    assert read_built(local_path).platforms > {"win64"}
    assert not (cache / "fmus").exists()
    # there is none of this flavour
    assert build(define_block(tmp_path), "python", []).is_relative_to(cache)


@pytest.mark.slow
def test_prebuilt_fmus_of_a_wheel_are_used(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are used where they are, copied elsewhere, and built only for further platforms."""
    built = build(define_block(tmp_path), "native", [])
    cache.rename(tmp_path / "wheel")
    monkeypatch.setattr(cache_module, "PREBUILT", tmp_path / "wheel")
    monkeypatch.setattr(building, "draft_of", lambda recipe: pytest.fail("it is built"))
    used = build(define_block(tmp_path), "native", [])
    assert used == tmp_path / "wheel" / built.relative_to(cache)
    copied = build(define_block(tmp_path), "native", [], Path("x"))
    assert copied.read_bytes() == used.read_bytes()
    copied.write_bytes(b"mine")
    with pytest.raises(CommandError, match=r"'x/Own/Own.fmu' was not written by emla"):
        build(define_block(tmp_path), "native", [], Path("x"))
    monkeypatch.undo()
    monkeypatch.setenv(cache_module.VARIABLE, str(cache))
    monkeypatch.setattr(cache_module, "PREBUILT", tmp_path / "wheel")
    more = build(define_block(tmp_path), "native", [*PLATFORMS][:2])
    assert more.is_relative_to(cache) and len(read_built(more).platforms) == 2
    monkeypatch.setattr(cache_module, "has_musl", lambda: True)  # nothing brought fits
    assert build(define_block(tmp_path), "native", []).is_relative_to(cache)


def test_missing_extra_for_building_is_reported(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "ziglang", None)
    with pytest.raises(CommandError, match=r"building Own needs the extra build, because ziglang is not"):
        build(define_block(tmp_path), "native", [])


def test_foreign_file_is_replaced_only_with_overwrite(cache: Path, tmp_path: Path) -> None:
    path = build(define_block(tmp_path), "native", [], Path("x"))
    good = path.read_bytes()
    for bad in (b"PK", good[:-80], good[: len(good) // 2]):
        path.write_bytes(bad)
        with pytest.raises(CommandError, match=r"'x/Own/Own.fmu' was not written by emla"):
            build(define_block(tmp_path), "native", [], Path("x"))
        assert path.read_bytes() == bad
    build(define_block(tmp_path), "native", [], Path("x"), overwrite=True)
    assert path.read_bytes() == good


def test_errors_of_builds(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CommandError, match="there is no model 'Nothing'; choose from"):
        build("Nothing", "native", [])
    wrong = define_block(tmp_path, text=TEXT.replace("v.time", "float(v.time)"))
    with pytest.raises(
        RunError, match=r"^Own could not be built: Own.outputs, y: `float\(v.time\)` in line 9"
    ):
        build(wrong, "native", [])
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(cache_module.VARIABLE, str(tmp_path / "file" / "cache"))
    with pytest.raises(RunError, match=f"cache' of {cache_module.VARIABLE} cannot be written to"):
        build("Reference", "native", [])


# ---- no home -----------------------------------------------------------------------------------


@pytest.fixture
def homeless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files, where there is no home."""
    (tmp_path / "file").write_text("")
    (tmp_path / "tmp").mkdir()
    for name in (cache_module.VARIABLE, "XDG_CACHE_HOME", "ZIG_GLOBAL_CACHE_DIR", "ZIG_LOCAL_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.delenv("MPLCONFIGDIR", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "file" / "home"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    return tmp_path / "tmp"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="The cache is in HOME on Linux only.")
def test_without_a_home_the_cache_is_in_a_temporary_folder(homeless: Path) -> None:
    code = """
        import os
        from emla_cosim.fmu.models import build
        print(build("Reference", "native", []))
        print(os.environ["MPLCONFIGDIR"])
    """
    run = subprocess.run(
        [sys.executable, "-c", dedent(code)],
        capture_output=True,
        text=True,
        check=False,
        cwd=homeless,
        env={**os.environ, **without_prebuilt(homeless.parent / "site")},
    )
    assert run.returncode == 0 and run.stderr == ""
    fmu, matplotlib = run.stdout.split()
    ours = homeless / f"emla-cosim-{os.getuid()}"
    assert Path(fmu).is_relative_to(ours / "fmus") and Path(fmu).is_file()
    assert Path(matplotlib) == ours / "matplotlib"
    assert any((ours / "zig").iterdir())
    assert ours.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(sys.platform != "linux", reason="The cache is in HOME on Linux only.")
def test_temporary_folder_that_others_can_write_to_is_not_used(homeless: Path) -> None:
    """Binaries are loaded from there."""
    foreign_folder = homeless / f"emla-cosim-{os.getuid()}"
    code = "from fmublock.cache import cache_folder; print(cache_folder())"

    def choose_folder() -> Path:
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        return Path(run.stdout.strip())

    assert choose_folder() == foreign_folder
    foreign_folder.chmod(0o777)
    assert choose_folder() != foreign_folder and choose_folder().parent == homeless
    foreign_folder.rmdir()
    (homeless / "elsewhere").mkdir()
    foreign_folder.symlink_to(homeless / "elsewhere")
    assert choose_folder() != foreign_folder


# ---- what it costs -----------------------------------------------------------------------------


@pytest.mark.slow
def test_existing_fmu_needs_no_heavy_import(fmu_folder: Path, cache: Path) -> None:
    """Neither one in the cache nor those in a folder."""
    build("Reference", "native", [])
    heavy = ("casadi", "matplotlib", "numpy", "fmpy", "pythonfmu", "filelock")
    code = f"""
        import sys
        from pathlib import Path
        from emla_cosim.fmu.models import MODELS, build
        build("Reference", "native", [])
        for model in MODELS:
            build(model, "native", [], Path({str(fmu_folder)!r}))
        print([name for name in {heavy} if name in sys.modules])
    """
    run = subprocess.run([sys.executable, "-c", dedent(code)], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


@pytest.mark.slow
def test_parallel_processes_build_an_fmu_once(cache: Path, tmp_path: Path) -> None:
    call = "build('Reference', 'native', [], advance=lambda: print('built'))"
    code = f"from emla_cosim.fmu.models import build; {call}"
    environment = {**os.environ, **without_prebuilt(tmp_path / "site")}
    command = [sys.executable, "-c", code]
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) for _ in range(3)]
    texts = [run.communicate()[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0, 0]
    assert sorted(texts) == ["", "", "built\n"]


def test_incomplete_fmus_need_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`emla run` takes FMUs from there, and would build them again with everything."""
    monkeypatch.chdir(tmp_path)
    for folder in (Path("fmus"), tmp_path / "fmus", None):
        with pytest.raises(CommandError, match="choose another one with --output"):
            check_disclosure("SignalFault", "native", folder, Disclosure(sources=False))
    check_disclosure("SignalFault", "native", Path("fmus"), Disclosure())
    check_disclosure("SignalFault", "native", Path("handout"), Disclosure(sources=False))
    with pytest.raises(CommandError, match="SignalFault: there is no parameter stiffness"):
        check_disclosure("SignalFault", "native", Path("handout"), Disclosure(hidden=["stiffness"]))
    path = build("SignalFault", "native", [], Path("handout"), disclosure=Disclosure(sources=False))
    with zipfile.ZipFile(path) as archive:
        page = archive.read("documentation/index.html").decode()
        assert "documentation/licenses/license.txt" in archive.namelist()
    assert "<math" not in page.partition("<h2>Variables</h2>")[0]
