"""Sensitivities equal closed forms and those of SciPy."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import sobol_indices as scipy_indices
from scipy.stats import spearmanr

from emla_cosim.analyses.sweep.columns import FactorColumn, influence
from emla_cosim.analyses.sweep.report import tabulate_sobol_indices
from emla_cosim.analyses.sweep.result import SweepResult
from emla_cosim.analyses.sweep.sensitivity import local_sensitivities, sobol_indices
from emla_cosim.analyses.variants.kinds import Uniform
from emla_cosim.analyses.variants.sampling import sample
from emla_cosim.base.errors import CommandError
from tests.support.sweep_results import swept

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(scope="module")
def ishigami() -> SweepResult:
    """f = sin x_1 + 7 sin² x_2 + 0.1 x_3⁴ sin x_1 for angles from -π to π."""
    x = np.transpose(np.array(sample("saltelli", [Uniform(-np.pi, np.pi)] * 3, 1024, 1)))
    f = np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])
    return swept({"x_1": x[:, 0], "x_2": x[:, 1], "x_3": x[:, 2]}, {"f": f}, "saltelli", seed=3)


def with_figure(result: SweepResult, values: Any) -> SweepResult:
    return swept({name: result.variants[name] for name in result.factors}, {"f": values}, result.sampling)


def test_sobol_indices_of_the_ishigami_function(ishigami: SweepResult) -> None:
    indices = sobol_indices(ishigami, "f")
    part = 0.1 * np.pi**4
    parts = [0.5 * (1 + part / 5) ** 2, 49 / 8, 8 * part**2 / 225]  # of 1 alone, 2 alone, and 1 with 3
    first = np.array([parts[0], parts[1], 0.0]) / sum(parts)
    total = np.array([parts[0] + parts[2], parts[1], parts[2]]) / sum(parts)
    assert np.all(np.abs(indices.first - first) <= indices.first_confidence)
    assert np.all(np.abs(indices.total - total) <= indices.total_confidence)
    assert max(*indices.first_confidence, *indices.total_confidence) < 0.12
    assert (indices.factors, indices.groups, indices.left_out) == (("x_1", "x_2", "x_3"), 1024, 0)


def test_sobol_indices_equal_those_of_scipy(ishigami: SweepResult) -> None:
    indices, f = sobol_indices(ishigami, "f"), ishigami.variants["f"].to_numpy().reshape(-1, 5)
    expected = scipy_indices(func={"f_A": f[:, :1].T, "f_B": f[:, 4:].T, "f_AB": f.T[1:4, None]}, n=1024)
    # both subtract a mean first, here that of all variants, there that of A and B
    assert indices.first == pytest.approx(expected.first_order, abs=1e-3)
    assert indices.total == pytest.approx(expected.total_order, rel=1e-12)


@pytest.mark.parametrize("seed", [0, 5])
def test_confidence_depends_only_on_the_seed(ishigami: SweepResult, seed: int) -> None:
    before = np.random.get_state()[1]  # noqa: NPY002
    first, second = (sobol_indices(replace(ishigami, seed=seed), "f") for _ in range(2))
    assert np.array_equal(first.first_confidence, second.first_confidence)
    assert np.array_equal(first.total_confidence, second.total_confidence)
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002
    assert not np.array_equal(first.total_confidence, sobol_indices(ishigami, "f").total_confidence)


@pytest.mark.parametrize("missing", [None, np.nan, np.inf])
def test_incomplete_base_samples_are_omitted(ishigami: SweepResult, missing: Any) -> None:
    values = ishigami.variants["f"].to_list()
    holed = [*values]
    holed[7] = holed[8] = holed[5 * 1000] = missing
    indices = sobol_indices(with_figure(ishigami, holed), "f")
    complete = [v for i, v in enumerate(values) if i // 5 not in (1, 1000)]
    expected = sobol_indices(
        swept(dict.fromkeys(ishigami.factors, complete), {"f": complete}, "saltelli"), "f"
    )
    assert (indices.groups, indices.left_out) == (1022, 2)
    assert np.array_equal(indices.first, expected.first)
    assert np.array_equal(indices.total, expected.total)


def test_biased_indices_have_a_warning(ishigami: SweepResult) -> None:
    """The top tenth missing changes the indices by more than their confidence."""
    f = ishigami.variants["f"].to_numpy()
    failing = f > np.quantile(f, 0.9)
    status = np.where(failing, "diverged", "done").tolist()
    table = swept({}, {"f": f}, status=status).variants
    with pytest.warns(UserWarning, match="base samples are left out of the Sobol indices of 'f'"):
        indices = replace(ishigami, variants=table).sobol("f")
    assert indices.left_out == int(failing.reshape(-1, 5).any(axis=1).sum())
    bias = np.abs(indices.first - sobol_indices(ishigami, "f").first)
    assert (bias > indices.first_confidence).any()
    assert "biases" in str(indices.warning)
    report = tabulate_sobol_indices(replace(ishigami, variants=table), "f")
    assert report.under == [f"Warning: {indices.warning}"]


def test_base_samples_with_unfinished_variants_are_left_out(ishigami: SweepResult) -> None:
    status = ["done"] * len(ishigami.variants)
    status[12] = "diverged"
    table = swept({}, {"f": ishigami.variants["f"]}, status=status).variants
    indices = sobol_indices(replace(ishigami, variants=table[:-3]), "f")
    assert (indices.groups, indices.left_out) == (1022, 2)


@pytest.mark.parametrize("value", [0.0, 5.0, -1e-300, 1e140])
def test_constant_figure_has_zero_indices(value: float) -> None:
    result = swept({"a": range(12), "b": range(12)}, {"f": [value] * 12}, "saltelli")
    got = sobol_indices(result, "f")
    for indices in (got.first, got.first_confidence, got.total, got.total_confidence):
        assert indices.tolist() == [0.0, 0.0]


def test_indices_do_not_depend_on_scale(ishigami: SweepResult) -> None:
    usual = sobol_indices(ishigami, "f")
    for factor in (1e-200, 1e140):
        scaled = with_figure(ishigami, factor * ishigami.variants["f"].to_numpy())
        assert np.allclose(sobol_indices(scaled, "f").total, usual.total, rtol=1e-9)


def test_booleans_count_as_0_and_1() -> None:
    a = np.random.default_rng(0).random((2000, 2, 2))
    mixed = [(m[0], [m[1][0], m[0][1]], [m[0][0], m[1][1]], m[1]) for m in a]
    x = np.array([row for group in mixed for row in group])
    result = swept({"a": x[:, 0], "b": x[:, 1]}, {"f": x[:, 0] > 0.5}, "saltelli")
    indices = sobol_indices(result, "f")
    assert indices.first[0] == pytest.approx(1.0, abs=0.1)
    assert indices.total[0] == pytest.approx(1.0, abs=0.1)
    assert indices.total[1] == 0.0


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ([None] * 8, "0 of 2 base samples of the sweep 'made-up' have the figure 'f'"),
        ([1.0, 2.0, 3.0, 4.0, None, 1.0, 2.0, 3.0], "1 of 2 base samples .* Sobol indices need at least 2"),
        ([1.0, 2.0, 3.0, 1.0] * 2, "varies in too few variants for Sobol indices; use more samples"),
    ],
)
def test_too_few_variants_for_sobol_indices(values: list[Any], sentence: str) -> None:
    with pytest.raises(CommandError, match=sentence):
        sobol_indices(swept({"a": range(8), "b": range(8)}, {"f": values}, "saltelli"), "f")


def test_local_sensitivities_of_a_linear_function_are_exact() -> None:
    nominal, spread = np.array([2.0, -1.0, 4.0]), np.array([0.5, 0.25, 1.0])
    rows = [nominal]
    for i in range(3):
        rows += [nominal - spread * (np.arange(3) == i), nominal + spread * (np.arange(3) == i)]
    x = np.array(rows)
    result = swept(dict(zip("abc", x.T, strict=True)), {"f": 3 + x @ [2.0, -16.0, 0.5]}, "one-at-a-time")
    assert local_sensitivities(result, "f") == [
        ("b", 29.0, 21.0, 25.0),
        ("a", 24.0, 26.0, 25.0),
        ("c", 24.5, 25.5, 25.0),
    ]
    assert [row.effect for row in local_sensitivities(result, "f")] == [8.0, 2.0, 1.0]


def test_missing_figures_of_local_sensitivities_are_none() -> None:
    status = ["done", "diverged", "done", "done"]
    result = swept({"a": [0] * 4, "b": [0] * 4}, {"f": [1.0, 9.0, 1.5, np.nan]}, "one-at-a-time", status)
    assert local_sensitivities(result, "f") == [("a", None, 1.5, 1.0), ("b", None, None, 1.0)]
    nothing = swept({"a": [0] * 3}, {"f": [None] * 3}, "one-at-a-time")
    assert local_sensitivities(nothing, "f") == [("a", None, None, None)]
    assert local_sensitivities(nothing, "f")[0].effect == 0.0


def test_invalid_samplings_and_figures_give_one_message() -> None:
    result = swept({"a": range(4)}, {"lift.error_m": range(4)}, "one-at-a-time")
    with pytest.raises(CommandError, match="has the sampling one-at-a-time; Sobol indices need the"):
        sobol_indices(result, "lift.error_m")
    with pytest.raises(CommandError, match=r"no figure 'lift.eror_m'; did you mean lift.error_m\?"):
        local_sensitivities(result, "lift.eror_m")
    with pytest.raises(CommandError, match=r"no figure 'x'; there are lift\.error_m\."):
        sobol_indices(replace(result, sampling="saltelli"), "x")


def test_influence_is_the_rank_correlation() -> None:
    rng = np.random.default_rng(4)
    x = rng.integers(0, 9, 80).astype(float)
    y = np.where(rng.random(80) < 0.1, np.nan, -np.exp(x) * rng.random(80))
    is_known = ~np.isnan(y)
    expected = abs(spearmanr(x[is_known], y[is_known]).statistic)
    assert influence(FactorColumn("x", x, None), y) == pytest.approx(expected, rel=1e-12)
    assert influence(FactorColumn("x", np.ones(80), None), y) == 0.0
    assert influence(FactorColumn("x", x, None), np.full(80, np.nan)) == 0.0


def test_influence_of_levels() -> None:
    rng = np.random.default_rng(2)
    level = np.arange(400) % 4.0
    names = ("a", "b", "c", "d")
    explained = np.array([5.0, 1.0, 9.0, 3.0])[level.astype(int)]  # in no order
    assert influence(FactorColumn("x", level, names), explained) == pytest.approx(1.0)
    assert influence(FactorColumn("x", level, names), rng.random(400)) < 0.15
    single = tuple(map(str, range(400)))
    assert influence(FactorColumn("x", np.arange(400.0), single), rng.random(400)) == 0.0
