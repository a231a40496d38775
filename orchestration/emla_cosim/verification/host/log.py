"""Everything that instances say through the FMI logger."""

from ...fmu.log import FmuLog, LogLine


def format_message(text: str) -> str:
    """What an FMU says, as the end of a sentence."""
    line = " ".join(text.split())
    return line if line.endswith((".", "!", "?")) else f"{line}."


class Log(FmuLog):
    """All messages of all instances of this process, oldest first."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[LogLine] = []

    def of(self, instance: str, status: int = 0) -> list[LogLine]:
        """Messages of an instance, with this status or a worse one."""
        return [line for line in self.lines if line.instance == instance and line.status >= status]

    def take(self, line: LogLine) -> None:
        """Keep a message."""
        self.lines.append(line)


LOG = Log()
"""That of this process, which every check has to itself."""
