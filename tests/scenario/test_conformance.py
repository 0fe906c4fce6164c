"""The conformance kit for motions: our own pass, and every way of breaking it is told in a sentence."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest
from pydantic import BaseModel

from zenoh_cbef.courses import COURSES
from zenoh_cbef.courses.circle import Circle
from zenoh_cbef.testing import Nonconforming, check_motion

DICE = np.random.default_rng(1)


@pytest.mark.parametrize("name", COURSES)
def test_our_own_motions_pass(name):
    check_motion(COURSES[name])


class Gambling(Circle):
    def states(self, time):
        return super().states(time) + DICE.normal(size=6)


class Drawn(Circle):
    """New numbers for each object."""

    @classmethod
    def of(cls, settings):
        return super().of(replace(settings, radius=5.0 + DICE.random()))


class Foreseeing(Circle):
    def states(self, time):
        return super().states(time) + time[-1]


class Writing(Circle):
    def states(self, time):
        time += 1.0
        return super().states(time)


class Flat(Circle):
    def states(self, time):
        return super().states(time)[:, [0, 1, 3, 4]]


class Lost(Circle):
    def states(self, time):
        return super().states(time) * np.nan


class InRounds(Circle):
    """Velocities in metres per period."""

    def states(self, time):
        found = super().states(time)
        found[:, 3:] *= self.settings.period
        return found


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Gambling, "other states the second time"),
        (Drawn, "two motions of the same settings"),
        (Foreseeing, "the first 0 steps of a longer run differ"),
        (Writing, "changes the times"),
        (Flat, r"gives float64 \(401, 4\), not float64 \(401, 6\)"),
        (Lost, "not finite"),
        (InRounds, "the velocities are not those of the positions"),
    ],
)
def test_a_broken_motion_is_told_what_is_wrong(kind, said):
    with pytest.raises(Nonconforming, match=said):
        check_motion(kind)


class Height(BaseModel):
    height: float = 1.0


class High(Circle):
    options: ClassVar = Height


def test_options_are_the_motions_own():
    check_motion(High, height=2.0)
    with pytest.raises(ValueError, match=r"target.options.heihgt is no option of Height; did you mean 'height'\?"):
        check_motion(High, heihgt=2.0)
    with pytest.raises(ValueError, match=r"which is no motion: it lacks of\(\), states\(\)"):
        check_motion(Height)
