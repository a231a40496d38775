"""A plugin of pytest that writes how long each test took, as lines of JSON, for `--durations-file`."""

import json
from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--durations-file", type=Path, help="lines of JSON with the seconds of each test")


def pytest_configure(config: pytest.Config) -> None:
    file = config.option.durations_file
    if file is not None and not hasattr(config, "workerinput"):  # the main process has the reports of all
        config.pluginmanager.register(_Writer(file))


class _Writer:
    def __init__(self, file: Path) -> None:
        self._file = file

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps([report.nodeid, report.duration]) + "\n")
