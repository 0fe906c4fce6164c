"""The conformance kit for filters: our own kinds pass, and every way of breaking it is told in a sentence."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from pydantic import BaseModel

from zenoh_cbef.extending import Abilities, Belief
from zenoh_cbef.testing import Nonconforming, check_filter
from zenoh_cbef.tracking.filters import KINDS
from zenoh_cbef.tracking.filters.base import filter_of
from zenoh_cbef.tracking.filters.kinds.icf import InformationWeighted

DICE = np.random.default_rng(1)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_our_own_kinds_pass(kind):
    check_filter(kind)


class Gambling(InformationWeighted):
    def conclude(self, payload, update):
        found = super().conclude(payload, update)
        return replace(found, state=found.state + 1e-12 * DICE.normal(size=found.state.shape))


class Mean(InformationWeighted):
    """Every agent's estimate depends on those of the others in its batch."""

    def conclude(self, payload, update):
        found = super().conclude(payload, update)
        return replace(found, state=found.state + 1e-9 * found.state.mean(axis=0))


class Mislaid(InformationWeighted):
    """Says that its payload is information where it is not: the matrix comes first."""

    def update(self, belief, measurement):
        found = super().update(belief, measurement)
        return replace(found, payload=np.roll(found.payload, 3, axis=1))

    def conclude(self, payload, update):
        inner = replace(update, payload=np.roll(update.payload, -3, axis=1))
        return super().conclude(np.roll(payload, -3, axis=1), inner)


class Deaf(InformationWeighted):
    """A missing range is taken for a number."""

    def update(self, belief, measurement):
        found = super().update(belief, measurement)
        return replace(found, payload=found.payload + 0.0 * measurement.range[:, None])


class Talking(InformationWeighted):
    def update(self, belief, measurement):
        found = super().update(belief, measurement)
        return replace(found, diagnostics=replace(found.diagnostics, weight=np.ones(len(belief.state))))


class Longer(InformationWeighted):
    @classmethod
    def sharing(cls, settings):
        return super().sharing(settings).longer(1)


class Sure(InformationWeighted):
    def conclude(self, payload, update):
        found = super().conclude(payload, update)
        return replace(found, covariance=-found.known_covariance)


class Unsaid(InformationWeighted):
    abilities: ClassVar = Abilities(covariance=False, information=True)


class Narrow(InformationWeighted):
    def conclude(self, payload, update):
        found = super().conclude(payload, update)
        return Belief(found.state[:, :2], found.covariance)


class Bare(InformationWeighted):
    def conclude(self, payload, update):
        return super().conclude(payload, update).state


class Stubborn(InformationWeighted):
    """It takes a payload for its own only."""

    def conclude(self, payload, update):
        found = super().conclude(payload, update)
        far = np.abs(payload - update.payload).max(axis=1) > 0.3 * np.ptp(update.payload, axis=0).max()
        return replace(found, state=np.where(far[:, None] & (len(payload) > 1), np.nan, found.state))


class Growing(InformationWeighted):
    def conclude(self, payload, update):
        found = super().conclude(payload, update)
        return replace(found, state=1e200 * found.state)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Growing, r"in step 1 conclude\(\) gives a number beyond 1e\+100"),
        (Gambling, "second time.*draw nothing at random"),
        (Mean, "alone gives other bits"),
        (Mislaid, "but payloads do not begin with information"),
        (Deaf, "in step 1 the payload is not finite"),
        (Talking, "without a range reports"),
        (Longer, "let both say the same"),
        (Sure, "not symmetric and positive"),
        (Unsaid, "abilities.covariance is False"),
        (Narrow, r"the state is float64 \(7, 2\), not float64 \(7, 6\)"),
        (Bare, r"conclude\(\) gives float64 \(7, 6\); return a Belief"),
        (Stubborn, "from a convex combination .* the state is not finite"),
    ],
)
def test_a_broken_filter_is_told_what_is_wrong(kind, said):
    with pytest.raises(Nonconforming, match=said):
        check_filter(kind)


class Width(BaseModel):
    width: float = 1.0


class Wide(InformationWeighted):
    options: ClassVar = Width


def test_options_are_the_filters_own():
    check_filter(Wide, width=2.0)
    with pytest.raises(ValueError, match=r"filter.options.widht is no option of Width; did you mean 'width'\?"):
        check_filter(Wide, widht=2.0)
    with pytest.raises(ValueError, match=r"filter\.options has width, but 'InformationWeighted' has no options"):
        check_filter(InformationWeighted, width=2.0)
    with pytest.raises(ValueError, match="which is no filter: it lacks of"):
        check_filter(Width)


@pytest.mark.parametrize(
    ("lacking", "told"), [("abilities", "lacks abilities, an"), ("sharing", r"lacks sharing\(\);")]
)
def test_a_class_that_lacks_one_thing_is_no_filter(lacking, told):
    with pytest.raises(ValueError, match=told):
        filter_of(type("Partial", (InformationWeighted,), {lacking: None}), "here:Partial")
