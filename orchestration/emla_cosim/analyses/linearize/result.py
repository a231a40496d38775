"""The result of a linearization."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import polars

from ..frame.report import ReportedResult
from .response import FrequencyResponse, Margins, StateSpace


@dataclass(frozen=True)
class MeasuredResponse:
    """A measured frequency response.

    Attributes:
        response: Loop gain of an opened loop, otherwise from input to output.
        amplitude: Height of the pulse, in the unit of the input.
        nonlinearity: Difference between the responses to two pulses of other size and sign, relative.
        drift: Difference between the responses to two pulses, the second one a step later, relative.
        margins: Margins of an opened loop; None for other responses.
        margins_at_half_step: The same with half the step; None if the step was not judged.
        step_change: Change of the response by half the step, relative: root mean square over the frequencies
            up to a tenth of the sample rate; None if the step was not judged.
    """

    response: FrequencyResponse
    amplitude: float
    nonlinearity: float
    drift: float
    margins: Margins | None = None
    margins_at_half_step: Margins | None = None
    step_change: float | None = None


@dataclass(frozen=True, repr=False)
class LinearizeResult(ReportedResult):
    """Frequency responses of a system at a time of a run.

    Attributes:
        name: Name of the scenario.
        at: Time of the operating point in s.
        step: Sample time in s.
        rolled_back: Whether FMUs were set back to the operating point; otherwise runs were repeated.
        responses: What was measured, by name.
        matrices: State matrices, if they were to be computed.
        is_steady: Whether the operating point is a steady state.
        remarks: What limits the validity of the responses.
    """

    name: str
    at: float
    step: float
    rolled_back: bool
    responses: Mapping[str, MeasuredResponse]
    remarks: tuple[str, ...] = ()
    matrices: StateSpace | None = None
    is_steady: bool = False

    def __getitem__(self, name: str) -> FrequencyResponse:
        """Return a response by name."""
        return self.responses[name].response

    @property
    def margins(self) -> dict[str, Margins]:
        """Margins of the opened loops, by name."""
        return {n: m.margins for n, m in self.responses.items() if m.margins is not None}

    @property
    def record(self) -> dict[str, Any]:
        """Content of `linearize.json`."""
        content: dict[str, Any] = {"format": "emla-linearization", "scenario": self.name, "at_s": self.at}
        if self.matrices is not None:
            content |= {"steady": self.is_steady, "matrices": self.matrices.record}
        else:
            responses = {n: _build_record(m) for n, m in self.responses.items()}
            content |= {"sample_time_s": self.step, "rolled_back": self.rolled_back, "responses": responses}
        return {**content, "remarks": list(self.remarks)}

    @property
    def table(self) -> polars.DataFrame:
        """All responses: name, frequency, real and imaginary part, gain, phase and estimated error."""
        if not self.responses:
            return polars.DataFrame()
        return polars.concat(
            polars.DataFrame(
                {
                    "response": [name] * len(m.response.frequency),
                    "frequency [Hz]": m.response.frequency,
                    "real": m.response.value.real,
                    "imag": m.response.value.imag,
                    "gain [dB]": m.response.gain_dB,
                    "phase [deg]": m.response.phase_deg,
                    "error": m.response.error,
                }
            )
            for name, m in self.responses.items()
        )


def _build_record(measured: MeasuredResponse) -> dict[str, Any]:
    return {
        "amplitude": measured.amplitude,
        "nonlinearity": measured.nonlinearity,
        "drift": measured.drift,
        "unit": measured.response.unit,
        "margins": measured.margins and asdict(measured.margins),
        "margins_at_half_step": measured.margins_at_half_step and asdict(measured.margins_at_half_step),
        "step_change": measured.step_change,
    }
