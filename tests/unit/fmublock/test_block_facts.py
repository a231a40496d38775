"""Every block has its facts in tests/support/blocks; all tests that need them parametrise over these."""

import pytest

from emla_cosim.fmu.models import MODELS
from fmublock import Instance
from fmus import make_references
from tests.support.blocks import FACTS, OWN


def test_every_block_has_facts() -> None:
    missing = [model for model in MODELS if model not in FACTS]
    assert not missing, (
        f"{', '.join(missing)}: tests do not know these blocks. Add a BlockFacts entry (start values, sizes "
        "of inputs, a smooth point, how to draw points) to the file of the package in tests/support/blocks/."
    )
    unknown = FACTS.keys() - MODELS.keys() - {"Toy"}
    assert not unknown, f"{', '.join(unknown)}: there are facts in tests/support/blocks/, but no such block"


@pytest.mark.parametrize("model", OWN)
def test_facts_fit_the_block(model: str) -> None:
    facts, layout = FACTS[model], MODELS[model].layout()
    inputs = [s.name for s in layout.scalars if s.variable in layout.inputs]
    assert list(facts.inputs) == inputs, f"tests/support/blocks: inputs of {model} are {inputs}"
    is_integrated = bool(layout.states) and facts.has_model_exchange
    assert (facts.exchange is not None) == is_integrated, f"tests/support/blocks: `exchange` of {model}"
    for values in (facts.start, facts.smooth):
        instance = Instance(MODELS[model]())
        for name, value in values.items():
            instance[name] = float(value)
        instance.enter_initialization()
        instance.exit_initialization()
        instance.do_step(0.0, 1e-3)


def test_every_block_has_a_reference_solution() -> None:
    for table in (make_references.START_VALUES, make_references.RELATIVE):
        missing = MODELS.keys() - table.keys()
        assert not missing, (
            f"{', '.join(sorted(missing))}: add reference solutions to fmus/make_references.py"
        )
