"""Make an instance of the class for the kind as which an FMU runs."""

from collections.abc import Sequence

from ...fmu.cvode import load_sundials
from ...fmu.file import FmuFile
from ...fmu.interface import MODEL_EXCHANGE
from ...fmu.log import FmuLog
from .event_mode_instance import EventModeInstance, handles_events
from .fmu_instance import FmuInstance
from .in_process_instance import InProcessInstance
from .integrated_instance import IntegratedInstance, ModelExchangeInstance


def make_instance(
    name: str, file: FmuFile, inputs: Sequence[str], outputs: Sequence[str], log: FmuLog, number: int = 0
) -> InProcessInstance:
    """Instantiate an FMU in this process; see `InProcessInstance`.

    Raises:
        CommandError: Also if it runs as Model Exchange, and there is no CVode for this platform.
    """
    if file.kind != MODEL_EXCHANGE:
        instance_class = EventModeInstance if handles_events(file) else InProcessInstance
        return instance_class(name, file, inputs, outputs, log, number)
    load_sundials()
    return ModelExchangeInstance(name, file, inputs, outputs, log, number)


def make_stepped(instance: FmuInstance) -> FmuInstance:
    """Return what steps an instance: an integrator if it runs as Model Exchange, otherwise itself."""
    if isinstance(instance, ModelExchangeInstance):
        return IntegratedInstance(instance.name, [instance])
    return instance
