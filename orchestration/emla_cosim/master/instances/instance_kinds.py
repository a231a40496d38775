"""Make an instance of the class for the kind as which an FMU runs."""

from collections.abc import Sequence

from ...fmu.file import FmuFile
from ...fmu.interface import MODEL_EXCHANGE
from ...fmu.log import FmuLog
from .in_process_instance import InProcessInstance
from .model_exchange_instance import ModelExchangeInstance


def make_instance(
    name: str, file: FmuFile, inputs: Sequence[str], outputs: Sequence[str], log: FmuLog, number: int = 0
) -> InProcessInstance:
    """Instantiate an FMU in this process; see `InProcessInstance`."""
    kind = ModelExchangeInstance if file.kind == MODEL_EXCHANGE else InProcessInstance
    return kind(name, file, inputs, outputs, log, number)
