"""Recorded ranges of anchors along a wall: their network is on no side of it that ranges deny."""

from __future__ import annotations

import numpy as np
import pytest

from tests.datasets.made import scenario_of, write_rows
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import make_filter
from zenoh_cbef.tracking.filters.around.mirror_images import MirrorImages, _image
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Bias
from zenoh_cbef.tracking.filters.finding.knowing import Knowing
from zenoh_cbef.tracking.filters.finding.reacquiring import Reacquiring
from zenoh_cbef.tracking.filters.finding.search import Search
from zenoh_cbef.tracking.filters.models.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.linalg import inverse, matvec, pack_upper
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours
from zenoh_cbef.tracking.status import ACQUIRING, COASTING, LOST, TRACKING, Status

WALL = [(-6, 0.4, 2), (-3, -0.5, 2), (0, 0.3, 2), (3, -0.4, 2), (6, 0.2, 2)]
PLANE = ("filter.range_std=0.1", "filter.planar_height=2")
GUESS = ("filter.initial_position=[0,5,2]",)
LINE = [(x, 0.3 * y, z) for x, y, z in WALL]
SILENT = 15.0, 25.0


def path(time):
    """To and fro on one side of the wall, 0.5 to 5.5 m off it, (k, 3), m."""
    along = 12.0 * np.abs(time / 14.0 % 2.0 - 1.0) - 6.0
    return np.stack([along, 3.0 + 2.5 * np.sin(0.5 * time), np.full_like(time, 2.0)], axis=-1)


def recorded(folder, seed, anchors=WALL, last=45.0):
    """Five ranges a second of each anchor, a tenth of them up to metres too long, and none in a silence."""
    random, rows = np.random.default_rng(seed), list[tuple[float, int, float]]()
    for number, anchor in enumerate(anchors):
        time = np.arange(random.uniform(0.0, 0.2), last, 0.2)
        time = time[(time < SILENT[0]) | (time > SILENT[1])]
        ranges = np.linalg.norm(path(time) - anchor, axis=1) + 0.1 * random.normal(size=len(time))
        ranges += np.where(random.uniform(size=len(time)) < 0.1, random.exponential(2.0, len(time)), 0.0)
        rows += [(t, number, r) for t, r in zip(time.tolist(), ranges.tolist(), strict=True)]
    times = np.arange(0.0, last, 0.1)
    truth = [(t, *place) for t, place in zip(times.tolist(), path(times).tolist(), strict=True)]
    return write_rows(folder, anchors, rows, truth)


@pytest.fixture(scope="module")
def walls(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walls")
    return [recorded(folder / str(seed), seed) for seed in (1, 2)]


def run(folder, *more):
    (trace,) = simulate([scenario_of(folder, "dt=0.1", *PLANE, *more)])
    return trace


def test_agents_are_not_sure_of_the_other_side_of_the_wall(walls):
    beyond = dict.fromkeys((28, 29), 0)
    for folder in walls:
        for rules in beyond:
            trace = run(folder, f"filter.defaults={rules}")
            wrong = trace.estimates[:, :, 1] < -0.5
            beyond[rules] += int(np.count_nonzero(wrong & (trace.diagnostics.status == TRACKING)))
    assert beyond[28] > 100
    assert beyond[29] == 0


def test_they_track_before_and_after_a_silence_and_coast_in_it(walls):
    trace = run(walls[0])
    said = trace.diagnostics.status
    assert (said[:, 50:145] == TRACKING).mean() > 0.95
    assert set(np.unique(said[:, 170:250])) == {COASTING}
    assert (said[:, 300:440] == TRACKING).mean() > 0.95


@pytest.mark.parametrize(
    ("anchors", "more", "near"),
    [
        (WALL, PLANE, True),
        (WALL, (*PLANE, "filter.defaults=28"), False),
        (WALL, (*PLANE, "filter.kind=ci"), False),
        (WALL, (*PLANE, "filter.bias=none"), True),
        (WALL, (*PLANE, *GUESS, "filter.initial_position_std=1"), True),
        (LINE, PLANE, True),
        (LINE, (*PLANE, *GUESS, "filter.initial_position_std=4"), True),
        (LINE, (*PLANE, *GUESS, "filter.initial_position_std=1"), False),
        ([(x, 0.0, z) for x, _, z in WALL], PLANE, False),
        ([(x, 3.0 * y, z) for x, y, z in WALL], PLANE, False),
        (WALL[:2], PLANE, False),
        ([(-8, -8, 1), (8, -8, 2), (8, 8, 1), (-8, 8, 2), (0, 9, 1)], ("filter.range_std=0.1",), True),
    ],
)
def test_where_anchors_are_along_a_wall(tmp_path, anchors, more, near):
    plan = Plan(scenario_of(recorded(tmp_path / "set", 1, anchors, 20.0), "dt=0.1", *more))
    assert (plan.plane is not None) is near
    blocks = plan.sharing.blocks
    half = len(blocks) // 2
    assert (blocks[:half] == blocks[half:]) is near


def inside(folder, sort, *more):
    """The filter of a sort that stands in an agent's."""
    found = make_filter("sicf", Plan(scenario_of(folder, "dt=0.1", *PLANE, *more)).settings)
    while isinstance(found, Wrapping) and not isinstance(found, sort):
        found = found.filter
    assert isinstance(found, sort)
    return found


def filter_of(folder, *more):
    """The filter of mirror images that stands in an agent's."""
    return inside(folder, MirrorImages, *more)


def begun(count, offset=0.0):
    random = np.random.default_rng(4)
    root = random.normal(size=(count, 4, 4))
    state = np.array([1.0, 2.0, 0.3, -0.2]) + offset * random.normal(size=(count, 4))
    return Belief(state, root @ root.swapaxes(1, 2) + 0.1 * np.eye(4))


def sure():
    """A belief that is far from its mirror image for what it claims."""
    return replace(begun(len(WALL)), covariance=np.tile(0.01 * np.eye(4), (len(WALL), 1, 1)))


def measured(state):
    """What agents along the wall measure of a target there, 5 cm too long."""
    position, count = np.array(WALL, dtype=float), len(WALL)
    ranges = np.linalg.norm(state[:, :2] - position[:, :2], axis=1) + 0.05
    return Measurement(position, ranges, np.zeros(count), *no_neighbours(count), agent=np.arange(count))


def test_information_of_both_filters_stands_before_their_other_numbers(walls):
    chosen = filter_of(walls[0])
    belief = sure()
    update = chosen.update(belief, measured(belief.state))
    first, second = update.parts
    information = chosen.informs
    assert 0 < information < first.payload.shape[1]
    np.testing.assert_array_equal(update.payload[:, :information], first.payload[:, :information])
    np.testing.assert_array_equal(update.payload[:, information : 2 * information], second.payload[:, :information])
    # Numbers behind the information that tell whose they are.
    told = update.payload.copy()
    here, there = (one.payload[:, information:] + more for one, more in ((first, 0.25), (second, 0.5)))
    told[:, 2 * information : -1], told[:, -1] = np.concatenate([here, there], axis=1), 0.0
    belief = chosen.conclude(told, update)
    for part, own, rest in zip(belief.parts, (first, second), (here, there), strict=True):
        alone = chosen.filter.conclude(np.concatenate([own.payload[:, :information], rest], axis=1), own)
        np.testing.assert_allclose(part.state, alone.state)
        for one, other in zip(carried(part), carried(alone), strict=True):
            np.testing.assert_allclose(one, other)


def carried(belief):
    """All that a belief carries on beside its state, in its parts, too."""
    return [*belief.memory, *(one for part in belief.parts for one in carried(part))]


def test_agents_count_the_steps_in_which_the_network_has_no_range(walls):
    chosen = filter_of(walls[0])
    belief = sure()
    heard = measured(belief.state)
    silent = replace(heard, range=np.full(len(WALL), np.nan))
    counts = []
    for measurement in (heard, silent, silent, heard):
        update = chosen.update(belief, measurement)
        mean = np.repeat(update.payload.mean(axis=0)[None], len(WALL), axis=0)
        belief = chosen.conclude(mean, update)
        counts.append(belief.memory[1].tolist())
    assert counts == [[k] * len(WALL) for k in (0.0, 1.0, 2.0, 0.0)]


@pytest.mark.parametrize("joint", [True, False])
def test_the_image_of_a_belief_with_biases_is_that_of_the_same_ranges(walls, joint):
    images = filter_of(walls[0], "filter.bias=estimate")
    settings = replace(images.settings, joint_biases=joint, scale_std=0.0)
    chosen = (JointBiases if joint else BiasedInformation).of(settings, 2.0)
    belief = begun(len(WALL))
    for _ in range(3):
        update = chosen.update(belief, measured(belief.state))
        belief = chosen.conclude(update.payload, update)
    image = _image(chosen, belief, images.settings.plane)
    assert np.abs(image.state - belief.state).max() > 0.1
    np.testing.assert_allclose(image.memory[0][:, :4], image.state)
    np.testing.assert_allclose(image.memory[1][:, :4, :4], image.known_covariance)
    np.testing.assert_array_equal(image.memory[0][:, 4:], belief.memory[0][:, 4:])
    again = _image(chosen, image, images.settings.plane)
    for one, other in zip((again.state, *again.memory), (belief.state, *belief.memory), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    # Seen from a point of the plane, ranges and what both beliefs expect of them are the same.
    point = np.array([*images.settings.plane[0], 2.0])
    seen = replace(measured(belief.state), position=np.tile(point, (len(WALL), 1)))
    here, there = (chosen.update(one, seen).diagnostics for one in (belief, image))
    np.testing.assert_allclose(here.innovation, there.innovation, atol=1e-9)
    np.testing.assert_allclose(here.nis, there.nis, rtol=1e-9)


def test_two_places_that_overlap_are_their_mixture_while_ranges_come(walls):
    chosen = filter_of(walls[0], "filter.bias=none")
    belief = begun(len(WALL))
    first, second = (chosen.filter.resumed(one) for one in (belief, begun(len(WALL), 0.5)))
    odds, none = np.full(len(WALL), np.log(3.0)), np.zeros(len(WALL))
    mixed = chosen.joined(first, second, odds, none)
    np.testing.assert_allclose(mixed.state, 0.75 * first.state + 0.25 * second.state)
    apart = (first.state - second.state)[:, :, None]
    within = 0.75 * first.known_covariance + 0.25 * second.known_covariance
    np.testing.assert_allclose(mixed.known_covariance, within + 0.1875 * apart @ apart.swapaxes(1, 2))
    silent = chosen.joined(first, second, odds, none + 100.0)
    np.testing.assert_array_equal(silent.state, first.state)
    far = replace(second, state=second.state + 100.0)
    np.testing.assert_array_equal(chosen.joined(first, far, -odds, none).state, far.state)


def test_a_hypothesis_that_was_given_up_begins_anew_at_the_image(walls):
    chosen = filter_of(walls[0], "filter.bias=none")
    first, second = (chosen.filter.resumed(one) for one in (sure(), replace(sure(), state=sure().state + 30.0)))
    for odds in (20.0, -20.0):
        likelier, other, left = chosen.begun_anew(first, second, np.full(len(WALL), odds))
        best = first if odds > 0.0 else second
        np.testing.assert_array_equal(likelier.state, best.state)
        np.testing.assert_allclose(other.state, chosen.mirrored(best).state)
        assert (left == 20.0).all()
    kept = chosen.begun_anew(first, second, np.full(len(WALL), 19.0))
    assert kept[0] is first
    assert kept[1] is second


def test_a_liar_displaces_what_it_says_of_both_sides(walls):
    plan = Plan(scenario_of(walls[0], "dt=0.1", *PLANE, "filter.bias=none"))
    matrix = np.tile(2.0 * np.eye(4), (1, 1, 1))
    told = np.concatenate([np.zeros((1, 4)), pack_upper(matrix)], axis=1)
    honest = np.concatenate([told, told, np.zeros((1, plan.sharing.payload_size - 2 * told.shape[1]))], axis=1)
    lie = plan.payloads.displaced(honest, np.array([[3.0, 0.0, 0.0]]))
    for place in (0, told.shape[1]):
        vector = lie[:, place : place + 4]
        np.testing.assert_allclose(matvec(inverse(matrix), vector), [[3.0, 0.0, 0.0, 0.0]])


@pytest.mark.parametrize(("bias", "taken"), [(0.5, 0.5), (500.0, 0.0)])
def test_agents_keep_ranges_for_a_fix_without_a_bias_unless_it_is_beyond_belief(walls, bias, taken):
    searching = inside(walls[0], Reacquiring)
    heard = measured(begun(len(WALL)).state)
    update = searching.update(begun(len(WALL)), heard)
    belief = searching.conclude(np.repeat(update.payload.mean(axis=0)[None], len(WALL), axis=0), update)
    belief = replace(belief, bias=Bias.constant(np.full(len(WALL), bias), np.ones(len(WALL))))
    kept = Search(*searching.update(belief, heard).kept)
    np.testing.assert_allclose(kept.ranges[:, -1], heard.range - taken)


def test_agents_that_know_no_side_acquire_in_place_of_tracking_and_coast_as_before(walls):
    knowing, images = inside(walls[0], Knowing), filter_of(walls[0])
    sides = (replace(sure(), state=sure().state + shift) for shift in (0.0, 30.0))
    belief = images.joined(*sides, np.zeros(len(WALL)), np.zeros(len(WALL)))
    around = knowing.filter
    while isinstance(around, Wrapping) and not isinstance(around, MirrorImages):
        belief, around = Belief(belief.state, belief.covariance, parts=(belief,)), around.filter
    first, every = Status.first(len(WALL)), np.ones(len(WALL), dtype=bool)
    for which, wanted in ((TRACKING, ACQUIRING), (COASTING, COASTING), (LOST, LOST)):
        said = first.told(every, which, first, 0.1)
        assert (knowing.undecided(said, first, belief).which == wanted).all()
