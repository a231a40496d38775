"""An instance of a co-simulation FMU in FMPy, called in the same way for both versions of FMI."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave


class Host:
    """An instance, stepped by hand. `messages` has the texts that it logged.

    Its files are in a folder whose name has characters that a URI has not.
    """

    def __init__(self, fmu: Path, folder: Path, **options: Any) -> None:
        description = fmpy.read_model_description(str(fmu))
        self.version = int(description.fmiVersion[0])
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.outputs = [v.name for v in description.modelVariables if v.causality == "output"]
        self.messages = list[str]()
        unpacked = folder / "é 100% #1"
        fmpy.extract(str(fmu), str(unpacked))
        self.fmu: Any = (FMU2Slave if self.version == 2 else FMU3Slave)(
            guid=description.guid if self.version == 2 else description.instantiationToken,
            unzipDirectory=str(unpacked),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="host",
        )
        if self.version == 2:
            self._callbacks = fmpy.fmi2.fmi2CallbackFunctions()
            self._callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(self._log)
            self._callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
            self._callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
            self.fmu.instantiate(callbacks=self._callbacks, loggingOn=False)
        else:
            self.fmu.instantiate(logMessage=self._log, **options)

    def _log(self, *message: Any) -> None:
        self.messages.append(message[-1].decode())

    def __enter__(self) -> "Host":
        return self

    def __exit__(self, *error: object) -> None:
        self.fmu.freeInstance()

    def start(self, values: dict[str, Any] | None = None, stop: float | None = None) -> None:
        """Initialize at t = 0 s with these start values."""
        if self.version == 2:
            self.fmu.setupExperiment(startTime=0.0, stopTime=stop)
        for name, value in (values or {}).items():
            self[name] = value
        self.fmu.enterInitializationMode(**({} if self.version == 2 else {"stopTime": stop}))
        self.fmu.exitInitializationMode()

    def step(self, time: float, step: float) -> Any:
        return self.fmu.doStep(time, step)

    def __setitem__(self, name: str, value: float) -> None:
        set_reals = self.fmu.setReal if self.version == 2 else self.fmu.setFloat64
        set_reals([self.references[name]], [value])

    def __getitem__(self, name: str) -> float:
        return self.read([name])[0]

    def read(self, names: Sequence[str] | None = None) -> list[float]:
        """Return values of Reals, by default of all outputs."""
        get_reals = self.fmu.getReal if self.version == 2 else self.fmu.getFloat64
        return list(get_reals([self.references[n] for n in (self.outputs if names is None else names)]))

    def save(self) -> Any:
        return self.fmu.getFMUstate() if self.version == 2 else self.fmu.getFMUState()

    def restore(self, state: Any) -> None:
        (self.fmu.setFMUstate if self.version == 2 else self.fmu.setFMUState)(state)

    def free(self, state: Any) -> None:
        (self.fmu.freeFMUstate if self.version == 2 else self.fmu.freeFMUState)(state)

    def serialize(self, state: Any) -> bytes:
        return (self.fmu.serializeFMUstate if self.version == 2 else self.fmu.serializeFMUState)(state)

    def deserialize(self, content: bytes) -> Any:
        call = self.fmu.deSerializeFMUstate if self.version == 2 else self.fmu.deserializeFMUState
        return call(content)
