"""Models of the target's motion by name. Adding one is a file here with a class as in base.py, and a line here."""

from __future__ import annotations

from zenoh_cbef.tracking.motion.acceleration import NearlyConstantAcceleration
from zenoh_cbef.tracking.motion.base import (
    LinearMotion,
    Motion,
    MotionSettings,
    NamedMotion,
    begun,
    beside_constants,
    linear,
)
from zenoh_cbef.tracking.motion.constants import BesideConstants, constants_of, moving_of
from zenoh_cbef.tracking.motion.decay import DecayingVelocity
from zenoh_cbef.tracking.motion.jump import Jump
from zenoh_cbef.tracking.motion.ncv import NearlyConstantVelocity
from zenoh_cbef.tracking.motion.predicted import Predicted
from zenoh_cbef.tracking.motion.stationary import Stationary
from zenoh_cbef.tracking.motion.turn import CoordinatedTurn
from zenoh_cbef.tracking.motion.turning import turned, turns

__all__ = [
    "MOTIONS",
    "BesideConstants",
    "Jump",
    "LinearMotion",
    "Motion",
    "MotionSettings",
    "NearlyConstantVelocity",
    "Predicted",
    "begun",
    "beside_constants",
    "constants_of",
    "is_linear",
    "linear",
    "make_motion",
    "moving_of",
    "turned",
    "turns",
]

MOTIONS: dict[str, type[NamedMotion]] = {
    "ncv": NearlyConstantVelocity,
    "decay": DecayingVelocity,
    "stationary": Stationary,
    "acceleration": NearlyConstantAcceleration,
    "turn": CoordinatedTurn,
    "jump": Jump,
}


def is_linear(kind: str) -> bool:
    """Whether `filter.motion` names one linear model: its class is a LinearMotion."""
    return kind in MOTIONS and issubclass(MOTIONS[kind], LinearMotion)


def make_motion(kind: str, settings: MotionSettings) -> Motion:
    """The model of one name."""
    return MOTIONS[kind].of(settings)
