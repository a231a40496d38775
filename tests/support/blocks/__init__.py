"""What tests must know of each block, one entry per block: add one for a new block, and no other table."""

from emla_cosim.fmu.models import MODELS
from tests.support.blocks import emla, hdrm, rsba, toy
from tests.support.blocks.facts import BlockFacts, Point

FACTS: dict[str, BlockFacts] = {**emla.FACTS, **rsba.FACTS, **hdrm.FACTS, **toy.FACTS}
"""Facts by the name of the model; also of the toy, which the library does not have."""

OWN = [model for model in MODELS if model in FACTS]
"""Models with facts, over which tests parametrise; tests/unit/fmublock/test_block_facts.py demands all."""

WITH_STATES = [model for model in (*OWN, "Toy") if FACTS[model].exchange is not None]
"""Models with continuous states that a host can integrate."""

__all__ = ["FACTS", "OWN", "WITH_STATES", "BlockFacts", "Point"]
