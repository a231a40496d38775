"""A good FMU with one byte, element or attribute changed gives a report, whatever that breaks."""

import random
from copy import deepcopy
from pathlib import Path

import pytest
from lxml import etree

import emla_cosim as ec
from emla_cosim.verification.catalogue import STATIC
from emla_cosim.verification.findings import Examined
from emla_cosim.verification.verdict import Verdict
from tests.support.broken.editing import Files, good_bytes, with_files, with_tree
from tests.support.broken.static import LIBRARY
from tests.support.tiers import mostly_slow

CHECKS = (
    *(c.name for c in STATIC if c.name != "sources.compile" and c.only_for != 3),
    "instance.created",
    "run.completes",
)
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


PORTIONS = 5
"""Of the seeds; each has all kinds."""


@pytest.fixture(params=mostly_slow(range(PORTIONS), [0]), scope="module")
def reports(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Examined]:
    """What is found about each mutated FMU of a portion, by its seed."""
    folder = tmp_path_factory.mktemp("mutated")
    paths = {}
    for seed in range(request.param, len(KINDS), PORTIONS):
        place = folder / str(seed)
        place.mkdir()
        paths[str(seed)] = KINDS[seed](random.Random(seed), place)
    report = ec.verify(paths, only=CHECKS, seconds=5.0)
    return {one.name: one for one in report.examined}


def test_mutated_fmus_get_reports(reports: dict[str, Examined]) -> None:
    for seed, report in reports.items():
        assert tuple(f.check for f in report.findings) == CHECKS, seed
        for finding in report.findings:
            assert finding.verdict in set(Verdict), seed
            assert not finding.sentence.startswith("The check itself has an error"), (seed, finding.sentence)
            assert finding.sentence.endswith("."), (seed, finding.sentence)
            assert "\n" not in finding.sentence, (seed, finding.sentence)
            assert len(finding.sentence) < 2000, (seed, finding.sentence)


def test_mutations_are_found(reports: dict[str, Examined]) -> None:
    """Not all of them do harm, but most do."""
    assert sum(not one.passed for one in reports.values()) > 0.4 * len(reports)
