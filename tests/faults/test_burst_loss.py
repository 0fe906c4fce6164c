"""Gilbert-Elliott loss, drawn without its history, has the statistics and the very states of the chain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.faults import BurstLoss, Fates
from zenoh_cbef.streams import stream, uniform

ROUNDS, STEPS, LINKS = 4, 240, 60


def burst_loss(enter, leave, **keys):
    return BurstLoss.model_validate({"kind": "burst-loss", "good_to_bad": enter, "bad_to_good": leave, **keys})


def fates_of(fault, *, links=LINKS, seed=3):
    source = np.arange(links)
    return Fates(
        [fault],
        seed=np.full(links, seed, dtype=np.uint64),
        source=source,
        destination=source + 1,
        dt=0.1,
        rounds=ROUNDS,
    )


def history(fault, *, links=LINKS, steps=STEPS, seed=3):
    """Whether each message of links (e, steps * (ROUNDS + 1)) was lost, in order."""
    fates = fates_of(fault, links=links, seed=seed)
    return np.stack(
        [fates.of(step, round_).lost for step in range(1, steps + 1) for round_ in range(ROUNDS + 1)], axis=1
    )


def runs(lost):
    """Lengths of the runs of lost messages that neither begin nor end with the history."""
    lengths = []
    for row in lost:
        edges = np.flatnonzero(np.diff(row.astype(int)))
        starts = [at for at in edges if not row[at]]
        lengths += [int(end - start) for start in starts for end in edges[edges > start][:1]]
    return np.array(lengths)


@pytest.mark.parametrize(("enter", "leave"), [(0.05, 0.3), (0.3, 0.05), (0.2, 0.8), (0.7, 0.6)])
def test_shares_bursts_and_memory_are_the_closed_forms(enter, leave):
    lost = history(burst_loss(enter, leave))
    share, memory = enter / (enter + leave), 1.0 - enter - leave
    # The variance of the mean of a chain with correlations memory^j.
    spread = np.sqrt(share * (1 - share) * (1 + memory) / (1 - memory) / lost.size)
    assert abs(lost.mean() - share) < 5 * spread
    lengths = runs(lost)
    assert abs(lengths.mean() - 1.0 / leave) < 5 * np.sqrt(1.0 - leave) / leave / np.sqrt(len(lengths))
    assert abs((lengths == 1).mean() - leave) < 5 * np.sqrt(leave * (1 - leave) / len(lengths))
    centred = lost - lost.mean()
    for lag in (1, 2, 3):
        correlation = np.mean(centred[:, lag:] * centred[:, :-lag]) / np.mean(centred**2)
        assert abs(correlation - memory**lag) < 0.03


def test_links_start_in_the_stationary_state():
    first = history(burst_loss(0.02, 0.08), links=20_000, steps=1)[:, 0]
    assert abs(first.mean() - 0.2) < 5 * np.sqrt(0.16 / len(first))


@pytest.mark.parametrize(("enter", "leave"), [(0.05, 0.3), (0.9, 0.8)])
def test_the_states_are_those_of_a_chain_that_is_stepped_from_the_past(enter, leave):
    # The same draws, applied one after the other from both states long before the first message.
    lost, links = history(burst_loss(enter, leave), steps=40), np.arange(LINKS)
    draws = uniform(stream(3, "burst-loss/0/state", links, links + 1)[:, None], np.arange(-400, 41 * (ROUNDS + 1)))
    for first in (False, True):
        bad, states = np.full(LINKS, first), []
        for draw in draws.T:
            # Inverted for a bad state, so that the two states use one draw in a coupled way.
            bad = np.where(bad, draw < 1.0 - leave, draw < enter)
            states.append(bad)
        np.testing.assert_array_equal(np.stack(states[400 + ROUNDS + 1 :], axis=1), lost)


def test_losses_in_good_and_bad_times_have_their_own_probability():
    certain = history(burst_loss(0.1, 0.2))
    partial = history(burst_loss(0.1, 0.2, loss_in_good=0.05, loss_in_bad=0.6))
    for bad, chance in ((certain, 0.6), (~certain, 0.05)):
        assert abs(partial[bad].mean() - chance) < 5 * np.sqrt(chance * (1 - chance) / bad.sum())


@settings(deadline=None)
@given(
    st.floats(0.001, 1.0),
    st.floats(0.001, 0.998),
    st.integers(0, 2**64 - 1),
    st.integers(1, 10**7),
    st.integers(0, 5),
)
def test_a_message_has_the_same_fate_alone_and_among_others_and_without_those_before(enter, leave, seed, step, link):
    numbers = np.arange(6)

    def lost(links):
        return Fates(
            [burst_loss(enter, leave)],
            seed=np.full(len(links), seed, dtype=np.uint64),
            source=links,
            destination=links + 7,
            dt=0.1,
            rounds=3,
        ).of(step, 2)

    assert lost(numbers[[link]]).lost[0] == lost(numbers).lost[link]


def test_a_remembered_state_changes_nothing():
    # Asked in order, each message continues from the one before; alone, each is found without a history.
    fault, order = burst_loss(0.0005, 0.0007), [(step, round_) for step in range(1, 400) for round_ in range(5)]
    lost = history(fault, steps=399)
    for step, round_ in order[::97]:
        alone = fates_of(fault).of(step, round_).lost
        assert (alone == lost[:, order.index((step, round_))]).all()
    turned = history(burst_loss(0.9992, 0.9993), steps=60)
    assert (fates_of(burst_loss(0.9992, 0.9993)).of(60, 4).lost == turned[:, -1]).all()


def test_a_chain_that_never_forgets_is_refused():
    for enter, leave in ((1.0, 1.0), (1.0, 0.9995), (0.0004, 0.0004)):
        with pytest.raises(ValueError, match="remember its state for too long"):
            burst_loss(enter, leave)
    burst_loss(1.0, 0.999)
    burst_loss(0.0005, 0.0005)


def test_each_message_costs_one_draw_of_its_link(monkeypatch):
    drawn = []

    def counting(key, *index):
        found = uniform(key, *index)
        drawn.append(found.size)
        return found

    monkeypatch.setattr("zenoh_cbef.faults.burst_loss.uniform", counting)
    lost = history(burst_loss(1e-9, 0.001), steps=200)
    first = 100 * 256 * LINKS  # The state before the first message is looked for as far back as it takes.
    assert sum(drawn) < first + lost.size
