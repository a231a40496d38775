"""The script that summarizes what is found in FMUs of vendors."""

from typing import Any

from docs.good_fmus import find_tool, summarize


def _finding(check: str, verdict: str, section: str, document: str = "FMI 2.0.4") -> dict[str, Any]:
    return {"check": check, "verdict": verdict, "clause": {"document": document, "section": section}}


def test_findings_are_counted_by_check_and_tool() -> None:
    dymola = {"made by": "Dymola Version 2017"}
    first = {
        "facts": dymola,
        "findings": [_finding("a.b", "failed", "2.3"), _finding("c.d", "passed", "2.1")],
    }
    second = {
        "facts": {"made by": "OpenModelica Compiler OMCompiler v1.13.0"},
        "findings": [_finding("a.b", "failed", "2.1.5"), _finding("c.d", "warning", "c.d", "emla verify")],
    }
    clean = {"facts": dymola, "findings": [_finding("a.b", "skipped", "2.3")]}
    text = summarize([{"examined": [first, second]}, {"examined": [clean]}])
    assert text.splitlines()[0] == "3 FMUs, 1 without a finding."
    assert text.splitlines()[4:] == [
        "| failed | `a.b` | 2 | Dymola, OpenModelica | 2.1.5, 2.3 |",
        "| warning | `c.d` | 1 | OpenModelica | emla verify c.d |",
    ]


def test_tools_have_short_names() -> None:
    names = ("20-sim: v4.6", "MATLAB 9.3 (Simulink)", "Acme 3", "an unnamed tool")
    found = [find_tool({"facts": {"made by": name}}) for name in names]
    assert found == ["20-sim", "Simulink", "Acme", "unnamed"]
    assert find_tool({"facts": {}}) == "unreadable"
