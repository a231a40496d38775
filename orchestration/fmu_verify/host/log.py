"""Collect the messages that instances send to the FMI logger."""

from emla_cosim.fmu.log import FmuLog, LogLine


def format_message(text: str) -> str:
    """Format a message of an FMU as one line that ends with a period."""
    line = " ".join(text.split())
    return line if line.endswith((".", "!", "?")) else f"{line}."


class Log(FmuLog):
    """All messages of all instances of this process, oldest first."""

    # also messages with a status that the standard does not have
    least = -(2**31)

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[LogLine] = []

    def of(self, instance: str, status: int = 0) -> list[LogLine]:
        """Return the messages of an instance with this status or a worse one."""
        return [line for line in self.lines if line.instance == instance and line.status >= status]

    def store(self, line: LogLine) -> None:
        """Store a message."""
        self.lines.append(line)


LOG = Log()
"""The log of this process."""
