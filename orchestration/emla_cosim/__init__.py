"""Systems of FMUs, the master that runs them, and what comes out.

    simulation = emla_cosim.load("study").prepare()
    result = simulation.run(stop_time=2.0, set={"lift.plant.motor.R_s": 0.2})
    result["lift.plant.x_L"]

The public names are those of `__init__.pyi`. Each is imported when it is first used, so that
`import emla_cosim` costs next to nothing.
"""

from typing import Any

import lazy_loader

_import_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    try:
        return _import_name(name)
    except ImportError as error:
        from .base.extras import explain_missing

        raise explain_missing(error, f"emla_cosim.{name}") or error from error
