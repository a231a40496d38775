"""Checks of FMUs of any tool: do they follow the standard, and do they behave as before?

    report = fmu_verify.verify("mine.fmu")
    report.passed

The public names are those of `__init__.pyi`. Each is imported when it is first used: pytest imports this
package in every environment that has it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
