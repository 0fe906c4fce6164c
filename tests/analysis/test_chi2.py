"""Quantiles agree with published tables."""

from __future__ import annotations

import math

import pytest

from zenoh_cbef.analysis.chi2 import chi2_cdf, chi2_quantile

TABLE = [
    (0.025, 1, 0.000982069),
    (0.975, 1, 5.023886),
    (0.95, 1, 3.841459),
    (0.025, 4, 0.484419),
    (0.975, 4, 11.143287),
    (0.025, 6, 1.237344),
    (0.975, 6, 14.449375),
    (0.5, 10, 9.341818),
    (0.99, 30, 50.892181),
    (0.025, 120, 91.572642),
    (0.975, 120, 152.211403),
]


@pytest.mark.parametrize(("probability", "degrees", "value"), TABLE)
def test_quantiles_are_those_of_the_tables(probability, degrees, value):
    assert chi2_quantile(probability, degrees) == pytest.approx(value, rel=2e-6)


@pytest.mark.parametrize("probability", [1e-6, 0.025, 0.3, 0.5, 0.975, 1 - 1e-9])
@pytest.mark.parametrize("degrees", [1, 2, 4, 6, 37, 500, 3600])
def test_the_quantile_inverts_the_distribution(probability, degrees):
    assert chi2_cdf(chi2_quantile(probability, degrees), degrees) == pytest.approx(probability, rel=1e-8)


@pytest.mark.parametrize("value", [0.1, 1.0, 5.0, 40.0])
def test_two_degrees_are_the_exponential_distribution(value):
    assert chi2_cdf(value, 2) == pytest.approx(1.0 - math.exp(-value / 2.0), rel=1e-12)


@pytest.mark.parametrize("value", [0.01, 1.0, 4.0, 25.0])
def test_one_degree_is_the_square_of_a_normal_variable(value):
    assert chi2_cdf(value, 1) == pytest.approx(math.erf(math.sqrt(value / 2.0)), rel=1e-12)


def test_nothing_lies_below_zero():
    assert chi2_cdf(0.0, 3) == chi2_cdf(-1.0, 3) == 0.0
