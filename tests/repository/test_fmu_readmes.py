"""The FMUs' READMEs: their tables of variables are those of the FMUs, and symbols are those of equations."""

import re
from pathlib import Path

import fmpy
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.fmu.models import fmu_path
from fmublock import Block, Output, Parameter
from fmublock.documentation import html_page, with_variables
from fmublock.symbols import symbol_of
from fmus.make_tables import page, readme
from tests.support.blocks import OWN

_ROW = re.compile(r"^\| (?:\$(.+)\$)? *\| `([^`]+)` \| (\S*) \| ", re.MULTILINE)


def rows(model: str) -> list[tuple[str, str, str]]:
    """Symbol, name and unit of each row of a README's tables."""
    return _ROW.findall(readme(model).read_text(encoding="utf-8"))


@pytest.mark.parametrize("model", OWN)
def test_tables_are_up_to_date(model: str) -> None:
    text = readme(model).read_text(encoding="utf-8")
    assert text == page(model), "python -m fmus.make_tables writes them"


@pytest.mark.parametrize("model", OWN)
def test_a_table_has_the_variables_of_the_fmu(model: str, fmu_folder: Path) -> None:
    description = fmpy.read_model_description(str(fmu_path(model, "native", fmu_folder)))
    expected = {v.name: v.unit or "" for v in description.modelVariables if not v.name.startswith("der(")}
    units = {}
    for _, name, unit in rows(model):
        array, dots, last = name.removesuffix("]").partition("[1..")
        names = [f"{array}[{i + 1}]" for i in range(int(last))] if dots else [name]
        units |= dict.fromkeys(names, unit)
    assert units == expected


@pytest.mark.parametrize("model", ["EmlaPlant", "EmlaObserver", "Reference", "Disturbance", "FocController"])
def test_most_symbols_are_in_the_equations(model: str) -> None:
    """Those that do not are of variables that no equation needs, such as limits."""
    text = readme(model).read_text(encoding="utf-8")
    text = re.sub("<!-- variables begin -->.*<!-- variables end -->", "", text, flags=re.DOTALL)
    equations = "".join("".join(re.findall(r"\$\$?(.+?)\$\$?", text, re.DOTALL)).split())
    symbols = [symbol for symbol, _, _ in rows(model) if symbol]
    absent = [symbol for symbol in symbols if symbol not in equations]
    assert len(absent) <= 0.15 * len(symbols), absent
    assert len(set(symbols)) == len(symbols)


@given(st.from_regex(r"[A-Za-z]\w{0,20}", fullmatch=True))
def test_any_attribute_has_a_symbol_that_can_be_typeset(attribute: str) -> None:
    symbol = symbol_of(attribute, 1)
    assert symbol.count("{") == symbol.count("}")
    if symbol.isascii():
        html_page(f"| ${symbol}$ |", "x")


def test_table_without_markers_is_appended() -> None:
    class Example(Block):
        """Something."""

        odd = Parameter(1.0, symbol=r"\omega^2")
        y = Output()

    text = with_variables("# Some\n\nText.\n", Example)
    assert text.startswith("# Some\n\nText.\n\n## Variables\n\n### Outputs\n")
    assert r"| $\omega^2$ | `odd` |  | 1 |  |  |" in text
