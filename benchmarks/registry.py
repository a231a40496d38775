"""Which tools are measured, and how."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tool:
    """A tool: its title in the table and its module in `tools`.

    `share` is its part of the number of steps, so that slow tools take no longer than the others.
    `clock` is how it tells FMUs the time: the doubles nearest to the decimal times, products
    k * step, or sums of steps. `one_core` holds all its threads to one core: these FMUs need less
    time than a handover between cores. `requirement` is a package that gets an environment of its own.
    """

    title: str
    module: str
    share: float = 1.0
    clock: str = "decimal"
    one_core: bool = False
    requirement: str = ""

    @property
    def name(self) -> str:
        """The name on the command line."""
        return f"{self.module}_one_core" if self.one_core else self.module


FMU_CALLS = Tool("the FMUs' own calls alone", "fmu_calls", 5.0)
C_LOOP = Tool("C loop", "c_loop", 5.0)

TOOLS = (
    FMU_CALLS,
    C_LOOP,
    Tool("EMLA-Cosim", "emla", 5.0),
    Tool("EMLA-Cosim, rows on disk", "emla_csv", 5.0),
    Tool("Ecos", "ecos", 3.0, "sums"),
    Tool("Ecos on one core", "ecos", 3.0, "sums", one_core=True),
    Tool("libcosim", "libcosim"),
    Tool("libcosim on one core", "libcosim", one_core=True),
    Tool("FMPy, a loop of its calls", "naive_fmpy", 0.5, "products"),
    Tool("CoFMPy", "cofmpy", 0.1, "sums", requirement="cofmupy==1.0.0"),
)
