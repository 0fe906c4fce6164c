"""What innovations say for a bias: how far agents rely on the filter that estimates one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.scenario.filtering import Filtering
from zenoh_cbef.scenario.load import load
from zenoh_cbef.tracking.filters import make_filter
from zenoh_cbef.tracking.filters.around.auto_bias import AutoBias
from zenoh_cbef.tracking.filters.around.evidence import MEMORY, SQUARES, Evidence
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping


def test_a_consistent_filter_without_bias_is_kept_and_an_excess_that_bias_explains_is_believed():
    sums = np.array([[0.5, 0.2, 1.0], [0.92, 0.92, 1.0], [2.0, 0.9, 1.0], [2.0, 2.0, 1.0]])
    assert Evidence(likelihoods=False).weight(sums).tolist() == [0.0, 0.0, 1.0, 0.0]


def test_a_bias_that_takes_away_most_of_what_misfits_is_believed_however_small_that_is():
    sums = np.array([[0.3, 0.05, 1.0], [0.3, 0.12, 1.0], [0.9, 0.9, 1.0]])
    assert Evidence(ratios=True).weight(sums).tolist() == [1.0, 0.0, 0.0]
    assert Evidence().weight(sums)[0] == 0.0
    begun = Evidence(ratios=True).begun(1)
    assert Evidence(ratios=True).weight(begun)[0] == 0.0
    assert Evidence(ratios=True).weight(begun + 100.0 * sums[:1])[0] == 1.0


@pytest.mark.parametrize("overstated", [1.0, 2.0])
def test_likelihoods_show_a_bias_also_where_the_noise_is_overstated(overstated):
    rng, evidence = np.random.default_rng(5), Evidence()
    errors, spread = rng.normal(0.0, 0.1, 4000), 0.1 * overstated * np.array([1.0, 1.02])
    for bias, wanted in ((0.2, 1.0), (0.0, 0.0)):
        plain, biased = ((np.abs(z), (z / s) ** 2) for z, s in zip((errors + bias, errors), spread, strict=True))
        said = evidence.of(plain, biased)
        assert (said >= 0.0).all()
        # Twice the log likelihood of two Gaussians, here written down once more, with squares cut at 4.
        gains = [
            np.minimum((z / s) ** 2, 4.0) + 2.0 * np.log(s)
            for z, s in zip((errors + bias, errors), spread, strict=True)
        ]
        np.testing.assert_allclose(said[:, 0] - said[:, 1], gains[0] - gains[1], atol=1e-12)
        assert evidence.weight(said.sum(axis=0)) == wanted


def test_a_small_gain_counts_where_errors_do_not_last():
    one, evidence = np.ones(3), Evidence(lasting=True)
    plain, biased = (0.1 * one, 0.6 * one), (0.1 * np.sqrt(5 / 6) * one, 0.5 * one)
    said = evidence.of(plain, biased, np.array([0.0, 0.5, 0.95]))
    gains = said[:, 0] - said[:, 1]
    np.testing.assert_allclose(gains, 0.1 / np.array([0.1, -np.log(0.75), 1.0]))
    assert evidence.weight(said).tolist()[::2] == [1.0, 0.0]
    # Where nothing is known of errors, and by the rules of before, all count alike.
    for other in (evidence.of(plain, biased), Evidence().of(plain, biased, np.zeros(3))):
        np.testing.assert_allclose(other[:, 0] - other[:, 1], 0.1)


def presumed(*ranges):
    """The weight after ranges, of each both NIS, the ratio S_0/S_1 and the correlation of its error with others."""
    evidence = Evidence(ratios=True, lasting=True, presumes=True)
    sums = evidence.begun(1)
    for first, second, spreads, alike in ranges:
        plain, biased = (
            (np.array([np.sqrt(nis * s)]), np.array([nis])) for nis, s in ((first, spreads), (second, 1.0))
        )
        said = evidence.of(plain, biased, np.array([alike]))
        followed = np.clip(-np.log(1.0 - alike**2), 0.02, 1.0)
        expected = np.array([first, second, followed, 1.0, np.log(spreads)]) / followed
        np.testing.assert_allclose(said[0], expected, atol=1e-12)
        sums = sums + 3000.0 * said
    return evidence.weight(sums)[0]


def test_a_bias_is_presumed_where_errors_do_not_last():
    assert presumed((0.9, 0.9, 1.0, 0.0)) == 1.0
    assert presumed((0.9, 0.88, 0.99, 0.0)) == 1.0
    assert presumed((0.9, 0.93, 0.99, 0.0)) == 0.0  # It makes ranges less likely.
    assert presumed((0.9, 0.9, 0.9, 0.0)) == 0.0  # It explains them no better, and claims more.
    assert presumed((0.9, 0.9, 1.0, 0.8)) == 0.0
    assert Evidence(ratios=True, lasting=True).numbers == replace(SQUARES, presumes=True).numbers == 3


def test_nothing_is_presumed_before_the_first_range():
    evidence = Evidence(ratios=True, lasting=True, presumes=True)
    assert evidence.weight(evidence.begun(2)).tolist() == [0.0, 0.0]
    # The filter with biases may claim more in a step: that mean is below zero, and no count.
    assert evidence.least.tolist() == [0.0, 0.0, 0.0, 0.0, -np.inf]


def sums_of(ranges, first, second):
    """What so many ranges of the network say, of means of both cut squares."""
    return np.array([[first * ranges, second * ranges, ranges, ranges, 0.0]], dtype=float)


def test_agents_leave_a_bias_open_until_they_know_whether_errors_last():
    evidence = Evidence(ratios=True, lasting=True, presumes=True, opens=True)
    assert evidence.claimed(evidence.begun(3), 4).tolist() == [0.5] * 3
    for ranges, agents, wanted in ((160, 4, 0.5), (240, 4, 0.25), (320, 4, 0.0), (320, 8, 0.5), (1600, 100, 0.0)):
        assert evidence.claimed(sums_of(ranges, 0.9, 0.9), agents).tolist() == [wanted]
    # The memory of a network of any size ends that.
    assert evidence.claimed(sums_of(MEMORY, 0.9, 0.9), 500).tolist() == [0.0]


def test_ranges_that_a_bias_makes_less_likely_close_that():
    evidence = Evidence(ratios=True, lasting=True, presumes=True, opens=True)
    for second, wanted in ((1.1, 0.5), (1.25, 0.25), (1.4, 0.0)):
        assert evidence.claimed(sums_of(100, 0.9, second), 4)[0] == pytest.approx(wanted)
    believed = sums_of(100, 1.5, 0.9)
    assert evidence.claimed(believed, 4).tolist() == evidence.weight(believed).tolist() == [1.0]


def test_by_the_rules_before_and_between_two_filters_with_biases_nothing_is_open():
    for evidence in (Evidence(ratios=True, lasting=True, presumes=True), replace(SQUARES, presumes=True, opens=True)):
        begun = evidence.begun(2)
        assert evidence.claimed(begun, 4).tolist() == evidence.weight(begun).tolist()
    for rules, opens in ((28, False), (29, True)):
        assert Filtering(load("lawnmower", [f"filter.defaults={rules}"]).scenario).settings.opens_biases is opens


def test_a_bias_that_gains_more_than_following_errors_can_is_believed_whatever_noise_was_told():
    """Errors of a correlation c follow by -ln(1 - c^2) at most: of 0.9 by 1.66, of 0.6 by 0.45."""
    for scale in (1.0, 0.25, 0.02):
        for alike, times, wanted in ((0.9, 2.0, 0.0), (0.9, 4.2, 1.0), (0.6, 1.3, 0.0), (0.6, 2.0, 1.0)):
            fits = 0.1 * scale
            found = presumed((times * fits, fits, 1.0, alike))
            assert found == wanted, (scale, alike, times)
    # What the filter with biases claims more is no gain.
    assert presumed((0.02, 0.01, np.exp(-0.3), 0.6)) < 0.2


@pytest.mark.parametrize(("rules", "presumes"), [(23, False), (24, True)])
def test_biases_of_recorded_ranges_are_presumed_by_the_rules_of_today(rules, presumes):
    settings = Filtering(load("lawnmower", [f"filter.defaults={rules}"]).scenario).settings
    assert settings.presumes_biases is presumes
    inner = make_filter("sicf", settings)
    while isinstance(inner, Wrapping):
        inner = inner.filter
    assert isinstance(inner, AutoBias)
    assert isinstance(inner.biased, AutoBias)
    assert inner.evidence.presumes is inner.biased.evidence.presumes is presumes
    assert not Filtering(load("tracking", ["sensor.real=true"]).scenario).settings.presumes_biases


def test_what_a_share_of_all_ranges_gains_counts_the_more_the_less_errors_last():
    one = np.ones(2)
    gains, alike = (0.1 * one, 1.0 * one), np.array([0.0, 0.95])
    for without, wanted in ((1.03, [1.0, 0.0]), (1.0, [0.0, 0.0]), (0.97, [0.0, 0.0])):
        said = replace(SQUARES, lasting=True).of((0.1 * one, without * one), gains, alike)
        np.testing.assert_allclose(said[:, 0] - said[:, 1], (without - 1.0) / np.array([0.1, 1.0]))
        assert replace(SQUARES, lasting=True).weight(said).tolist() == wanted
    # A loss in one step is a loss, and not cut off as a count below zero is.
    assert replace(SQUARES, lasting=True).least.tolist() == [-np.inf, 0.0, 0.0]
    assert SQUARES.least.tolist() == Evidence(lasting=True).least.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("rules", "weighs"), [(15, False), (16, True)])
def test_a_share_of_recorded_ranges_is_weighed_so_by_the_rules_of_today(rules, weighs):
    filtering = Filtering(load("lawnmower", [f"filter.defaults={rules}"]).scenario)
    assert filtering.settings.weighs_shares is weighs


@pytest.mark.parametrize(("rules", "weighs"), [(14, False), (15, True)])
def test_recorded_ranges_are_weighed_so_by_the_rules_of_today(rules, weighs):
    filtering = Filtering(load("lawnmower", [f"filter.defaults={rules}"]).scenario)
    assert filtering.settings.weighs_lasting is weighs


def test_a_range_that_was_not_measured_says_nothing():
    nothing, one = np.array([np.nan, 0.1]), np.array([np.nan, 1.0])
    np.testing.assert_array_equal(Evidence().of((nothing, one), (nothing, one)), [[0.0] * 3, [1.0] * 3])
