"""Messages about packages of extras that are missing."""

import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.base.extras import (
    EXTRAS,
    MissingExtraError,
    explain_missing,
    has_extra,
    require_extra,
    require_extras,
)


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("PIL", "bokeh", "cma"):
        monkeypatch.setitem(sys.modules, module, None)


@pytest.mark.usefixtures("without")
def test_messages_name_all_that_is_missing_and_the_command() -> None:
    assert not has_extra("plots") and has_extra("build")
    require_extra("build", "an FMU")
    with pytest.raises(MissingExtraError) as raised:
        require_extras(["plots", "build", "analyses"], "`emla move`")
    assert str(raised.value) == (
        "`emla move` needs the extras plots and analyses, because bokeh, pillow and cma are not installed; "
        "run: pip install 'emla-cosim[plots,analyses]'."
    )
    assert raised.value.exit_code == 2
    assert str(pickle.loads(pickle.dumps(raised.value))) == str(raised.value)


@pytest.mark.usefixtures("without")
def test_an_import_that_fails_is_explained() -> None:
    with pytest.raises(ImportError) as raised:
        from PIL import Image  # noqa: F401
    explained = explain_missing(raised.value, "a picture")
    assert isinstance(explained, CommandError)
    assert "the extra plots, because pillow is not" in str(explained)
    assert explain_missing(explained, "another") is explained  # type: ignore[arg-type]
    assert explain_missing(ImportError("no", name="os.nothing"), "a picture") is None


def test_a_broken_package_is_not_reported_as_missing() -> None:
    assert explain_missing(ImportError("no name 'x'", name="casadi"), "an FMU") is None
    assert explain_missing(ModuleNotFoundError("no module", name="scipy._lib.x"), "an FMU") is None


def test_folders_of_users_are_not_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "yourdfpy").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert not has_extra("urdf")


def test_scipy_is_of_the_extra_analyses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy", None)
    assert "the extra analyses," in str(explain_missing(ImportError("no", name="scipy.stats"), "a spline"))


BASE = """
import sys

sys.modules.update(dict.fromkeys({modules}))
import emla_cosim as ec
import fmublock.table.building  # tables of data have no equations

lacking = {{}}
for name in ec.__all__:
    try:
        getattr(ec, name)
    except ImportError as error:
        lacking[name] = str(error)
assert {{"sweep", "compare", "tune", "identify", "linearize", "size", "trajectory"}} <= set(lacking)
assert all("run: pip install 'emla-cosim[analyses" in message for message in lacking.values()), lacking
assert "[analyses,build]" in lacking["trajectory"]
"""


def test_names_of_python_say_which_extra_they_lack() -> None:
    packages = {package for extra in EXTRAS.values() for package in extra}
    modules = sorted(packages - {"pillow"} | {"PIL"})
    subprocess.run([sys.executable, "-c", BASE.format(modules=modules)], check=True)
