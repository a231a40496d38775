"""Values of a variant become options, components, start values and a command."""

from pathlib import Path

import pytest

from emla_cosim.analyses.variants.factors import OPTION, Target, assign_value, format_arguments
from emla_cosim.base.errors import CommandError
from emla_cosim.cli.app import load_command
from emla_cosim.cli.parameters import read_values
from emla_cosim.master.algorithms.registry import Jacobi
from emla_cosim.run.options import Options, list_options
from emla_cosim.system.model import Replacement


def test_values_become_options() -> None:
    assert assign_value([Target("gains", OPTION)], "robust") == {"gains": "robust"}
    assert assign_value([Target("parameters", OPTION)], "a.ssv") == {"parameters": ["a.ssv"]}
    assert assign_value([Target("j.R", nominal=2.0)], 3.0) == {"set": {"j.R": 3.0}}
    assert assign_value([Target("j.R"), Target("k.R")], None) == {}


def test_arguments_of_the_command_line() -> None:
    options = {
        "set": {"a.x": 0.1 + 0.2, "a.on": True, "a.n": 3},
        "replace": {"a": Replacement(Path("f.fmu"), Path("f.ssm")), "b": "g.fmu"},
        "parameters": [Path("one.ssv"), Path("two.ssv")],
        "order": ["a", "b"],
        "step_multiples": {"a": 3},
        "step_size": 1e-4,
        "algorithm": "jacobi",
        "integrate_together": False,
        "isolate": True,
        "gains": None,
    }
    arguments = format_arguments(options)
    assert arguments is not None
    assert arguments == [
        *["--set", "a.x=0.30000000000000004", "--set", "a.on=true", "--set", "a.n=3"],
        *["--replace", "a=f.fmu", "--mapping", "a=f.ssm", "--replace", "b=g.fmu"],
        *["--parameters", "one.ssv", "--parameters", "two.ssv", "--order", "a,b", "--step-multiple", "a=3"],
        *["--step-size", "0.0001", "--algorithm", "jacobi", "--no-together", "--isolate"],
    ]
    texts = load_command("run").make_context("run", ["lift", *arguments]).params
    assert read_values([list_options()["isolate"]], texts) == {"isolate": ["*"]}


def test_options_that_are_python_objects_have_no_arguments() -> None:
    assert format_arguments({"algorithm": Jacobi()}) is None
    with pytest.raises(CommandError, match="no option"):
        Options().updated({"nonsense": 1})
