"""Draws are pure functions of their stream's name and index, and have the distribution they promise."""

from __future__ import annotations

from hashlib import blake2b

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.streams import LinkStreams, bits, exponential, normal, stream, uniform

MASK = (1 << 64) - 1
STEP = 0x9E3779B97F4A7C15
LANE = 0xD1B54A32D192ED03
WORDS = st.integers(0, MASK)
SMALL = st.integers(0, 2**40)


def finalise(z: int) -> int:
    """SplitMix64's output function on Python integers."""
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & MASK
    return z ^ (z >> 31)


def expected_key(seed: int, purpose: str, source: int, destination: int) -> int:
    code = int.from_bytes(blake2b(purpose.encode(), digest_size=8).digest(), "little")
    key = finalise((seed + STEP) & MASK)
    key = finalise(key ^ code)
    key = finalise((key + STEP * source) & MASK)
    return finalise((key + LANE * (destination + 1)) & MASK)


def test_finaliser_of_these_tests_gives_the_published_outputs_of_splitmix64():
    outputs = [finalise((1234567 + number * STEP) & MASK) for number in (1, 2, 3)]
    assert outputs == [6457827717110365317, 3203168211198807973, 9817491932198370423]


@settings(deadline=None)
@given(WORDS, st.text(max_size=20), st.tuples(SMALL, SMALL), st.tuples(SMALL, SMALL))
def test_bits_are_the_finaliser_applied_per_coordinate(seed, purpose, link, index):
    (source, destination), (step, lane) = link, index
    key = stream(seed, purpose, source, destination)
    assert int(key[0]) == expected_key(seed, purpose, source, destination)
    inner = finalise((int(key[0]) + STEP * step) & MASK)
    assert int(bits(key, step, lane)[0]) == finalise((inner + LANE * lane) & MASK)


@settings(deadline=None)
@given(WORDS, st.permutations(range(12)), st.sampled_from([(12,), (3, 4), (2, 6)]))
def test_a_draw_does_not_depend_on_order_or_batch(seed, order, shape):
    key = stream(seed, "batch", np.arange(12))
    alone = [normal(stream(seed, "batch", source), 7)[0] for source in range(12)]
    assert normal(key, 7).tolist() == alone
    assert normal(key[order].reshape(shape), 7).ravel().tolist() == [alone[place] for place in order]
    by_step = uniform(key[:1], np.array(order))
    assert by_step.tolist() == [uniform(key[0], step)[0] for step in order]


def test_every_part_of_a_name_gives_another_stream():
    names = [
        (seed, purpose, source, destination)
        for seed in (0, 1, 2**63, MASK)
        for purpose in ("", "a", "b", "loss/0", "loss/1")
        for source in range(5)
        for destination in range(5)
    ]
    keys = {int(stream(*name)[0]) for name in names}
    assert len(keys) == len(names)


def test_source_and_destination_are_not_interchangeable():
    assert stream(1, "x", 2, 3)[0] != stream(1, "x", 3, 2)[0]


def test_the_largest_seed_is_a_seed_like_any_other():
    assert int(stream(MASK, "x", 1, 2)[0]) == expected_key(MASK, "x", 1, 2)
    seeds = np.array([0, 1, MASK], dtype=np.uint64)
    assert stream(seeds, "x").tolist() == [int(stream(int(seed), "x")[0]) for seed in seeds.tolist()]


@pytest.mark.parametrize("axis", ["step", "lane", "source"])
def test_uniform_draws_fill_the_unit_interval_evenly(axis):
    count = 200_000
    numbers = np.arange(count)
    if axis == "source":
        draws = uniform(stream(5, "u", numbers), 3)
    elif axis == "lane":
        draws = uniform(stream(5, "u"), 3, numbers)
    else:
        draws = uniform(stream(5, "u"), numbers)
    assert draws.min() >= 0.0
    assert draws.max() < 1.0
    counts, _ = np.histogram(draws, bins=100, range=(0.0, 1.0))
    # Chi-squared with 99 degrees: mean 99, standard deviation 14; six of them.
    assert np.sum((counts - count / 100) ** 2 / (count / 100)) < 99 + 6 * 14.1
    assert abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 6 / np.sqrt(count)


def test_normal_draws_have_the_moments_of_the_normal_distribution():
    count = 400_000
    draws = normal(stream(9, "n"), np.arange(count))
    assert abs(draws.mean()) < 6 / np.sqrt(count)
    assert abs(draws.var() - 1.0) < 6 * np.sqrt(2 / count)
    assert abs((draws**3).mean()) < 6 * np.sqrt(15 / count)
    assert abs((draws**4).mean() - 3.0) < 6 * np.sqrt(96 / count)
    assert np.isfinite(draws).all()


def test_normal_draws_of_different_lanes_and_streams_are_uncorrelated():
    count = 100_000
    steps = np.arange(count)
    draws = [normal(stream(9, "n"), steps, lane) for lane in (0, 1)]
    draws += [normal(stream(9, "n", 1), steps), normal(stream(10, "n"), steps), normal(stream(9, "m"), steps)]
    correlation = np.corrcoef(draws) - np.eye(len(draws))
    assert np.abs(correlation).max() < 6 / np.sqrt(count)


def test_exponential_draws_have_mean_and_variance_one_and_are_not_negative():
    count = 400_000
    draws = exponential(stream(11, "e"), np.arange(count))
    assert draws.min() >= 0.0
    assert abs(draws.mean() - 1.0) < 6 / np.sqrt(count)
    assert abs(draws.var() - 1.0) < 6 * np.sqrt(8 / count)
    assert abs((draws > 1.0).mean() - np.exp(-1.0)) < 6 * 0.5 / np.sqrt(count)


def test_the_streams_of_links_draw_what_their_keys_draw_in_any_order():
    source, destination = np.array([0, 1, 2]), np.array([1, 2, 0])
    streams = LinkStreams(7, source, destination, range(1, 5))
    keys = {purpose: stream(7, purpose, source, destination) for purpose in ("loss/0", "loss/1")}
    for purpose, step, lane in (
        ("loss/0", 3, 1),
        ("loss/1", 3, 4),
        ("loss/0", 2, 2),
        ("loss/0", 3, 2),
        ("loss/1", 1, 9),
    ):
        drawn = streams.uniform(purpose, step, lane)
        assert drawn.tobytes() == uniform(keys[purpose], step, lane).tobytes()
