"""A workflow of GitHub Actions whose `run` steps are done here, as a runner does them."""

import os
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

_INPUT = re.compile(r"\$\{\{ inputs\.([\w-]+) \}\}")


def read_workflow(text: str) -> dict[Any, Any]:
    """The workflow; `on` is a boolean in YAML 1.1, and the key is put right."""
    read = yaml.safe_load(text)
    return {("on" if key is True else key): value for key, value in read.items()}


@dataclass
class Ended:
    """How the steps of a job ended: the name of the step that failed, and its exit code."""

    failed: str = ""
    code: int = 0
    shown: str = ""
    done: list[str] = field(default_factory=list)


def run_steps(
    workflow: Mapping[Any, Any], job: str, inputs: Mapping[str, str], workspace: Path, env: Mapping[str, str]
) -> Ended:
    """Do the `run` steps of a job in a workspace, with inputs by their defaults or as given.

    As a runner does: after one that fails only those that say so are done. Steps that use other
    people's actions are left out.
    """
    declared = workflow["on"]["workflow_call"]["inputs"]
    values = {name: str(about.get("default", "")) for name, about in declared.items()} | dict(inputs)
    ended = Ended()
    for step in workflow["jobs"][job]["steps"]:
        if "run" not in step or (ended.failed and "!cancelled()" not in step.get("if", "")):
            continue
        given = {name: _INPUT.sub(lambda m: values[m[1]], text) for name, text in step.get("env", {}).items()}
        done = subprocess.run(
            ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
            cwd=workspace,
            env={**os.environ, **env, **given},
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
        )
        ended.shown += done.stdout
        ended.done.append(step["name"])
        if done.returncode and not ended.failed:
            ended.failed, ended.code = step["name"], done.returncode
    return ended
