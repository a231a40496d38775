"""A good FMU with one byte, element or attribute changed gives a report, whatever that breaks."""

import random
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import pytest
from lxml import etree

from emla_cosim.verify.catalogue import STATIC
from emla_cosim.verify.verdict import Verdict
from tests.support.broken.editing import Files, good_bytes, with_files, with_tree
from tests.support.broken.examining import examined_apart, examined_here
from tests.support.broken.static import LIBRARY

CHECKS = tuple(c.name for c in STATIC if c.name != "sources.compile")  # which takes longer than all others
VALUES = (
    "",
    "-1",
    "0",
    "4294967295",
    "99999999999999999999",
    "1e999",
    "NaN",
    "-INF",
    "true",
    "x" * 10_000,
    "'",
    "../..",
    "{é\u2028}",
    "((((((((((m/s",
    "1 2 3",
    "output",
    "calculated",
    "Enumeration",
    "Force",
)


def archive_byte(chance: random.Random, folder: Path) -> Path:
    content = bytearray(good_bytes())
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
    path = folder / "Toy.fmu"
    path.write_bytes(content)
    return path


def library_byte(chance: random.Random, folder: Path) -> Path:
    def edit(files: Files) -> None:
        content = bytearray(files[LIBRARY])
        content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        files[LIBRARY] = bytes(content)

    return with_files(edit)(folder)


def element(chance: random.Random, folder: Path) -> Path:
    """One element is removed, doubled, or moved to the end of its parent."""

    def edit(root: etree._Element) -> None:
        one = chance.choice([e for e in root.iter(etree.Element) if e is not root])
        parent = one.getparent()
        what = chance.choice(("removed", "doubled", "moved"))
        if what == "doubled":
            one.addnext(deepcopy(one))
        elif what == "moved":
            parent.append(one)
        else:
            parent.remove(one)

    return with_tree(edit)(folder)


def attribute(chance: random.Random, folder: Path) -> Path:
    """One attribute is removed, replaced, or gets the value of another of its name."""

    def edit(root: etree._Element) -> None:
        every = [(e, name) for e in root.iter(etree.Element) for name in e.attrib]
        one, name = chance.choice(every)
        what = chance.choice(("removed", "replaced", "another's"))
        if what == "removed":
            del one.attrib[name]
        elif what == "replaced":
            one.set(name, chance.choice(VALUES))
        else:
            one.set(name, chance.choice([e.get(name) for e, other in every if other == name]))

    return with_tree(edit)(folder)


KINDS = [archive_byte] * 40 + [library_byte] * 20 + [element] * 50 + [attribute] * 90


@pytest.mark.parametrize("first", range(0, len(KINDS), 20))
def test_mutated_fmu_gets_a_report(first: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for seed in range(first, first + 20):
        folder = tmp_path / str(seed)
        folder.mkdir()
        mutate: Callable[[random.Random, Path], Path] = KINDS[seed]
        path = mutate(random.Random(seed), folder)
        report = examined_apart(path, CHECKS) if seed == first else examined_here(path, CHECKS, monkeypatch)
        assert tuple(f.check for f in report.findings) == CHECKS, seed
        for finding in report.findings:
            assert finding.verdict in set(Verdict), seed
            assert not finding.sentence.startswith("The check itself went wrong"), (seed, finding.sentence)
            assert finding.sentence.endswith("."), (seed, finding.sentence)
            assert "\n" not in finding.sentence, (seed, finding.sentence)
            assert len(finding.sentence) < 2000, (seed, finding.sentence)
