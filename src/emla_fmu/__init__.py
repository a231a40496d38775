"""The electromechanical linear actuator: plant with its sensor, observer, reference and disturbance."""

from .disturbance import Disturbance, DisturbanceReading
from .observer import EmlaObserver
from .plant import EmlaPlant, TorqueSource
from .reference import Reference

BLOCKS = (EmlaPlant, EmlaObserver, Reference, Disturbance)

__all__ = [
    "BLOCKS",
    "Disturbance",
    "DisturbanceReading",
    "EmlaObserver",
    "EmlaPlant",
    "Reference",
    "TorqueSource",
]
