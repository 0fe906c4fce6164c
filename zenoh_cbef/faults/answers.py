"""What faults answer: which of it is no answer, although NumPy would take it. Runs ask, and so does `check_fault`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults.base import Effect
from zenoh_cbef.plugins import blaming


@contextmanager
def asking(fault: object, method: str) -> Iterator[None]:
    """Raise UserError for what a fault of another package does wrong in a method that is called in here."""
    with blaming(type(fault), method, "check_fault"):
        yield


def refuse(flaw: str) -> None:
    """Raise TypeError for an answer with a flaw."""
    if flaw:
        raise TypeError(flaw)


def flaw_of_array(value: object, what: str, shape: tuple[int, ...], dtype: type = np.bool_) -> str:
    """Why this is no array of a shape, and the remedy; "" for one that is, as below."""
    if isinstance(value, np.ndarray) and value.dtype == dtype and value.shape == shape:
        return ""
    given = f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
    return f"{what} is {given}, not {np.dtype(dtype)} {shape}: one for each link or agent that is asked for"


def flaw_of_effect(effect: object, count: int) -> str:
    """Why this is no effect on so many messages."""
    if not isinstance(effect, Effect):
        return "effect() gives no Effect; return one, with what happens to each message"
    for name, value in vars(effect).items():
        delay = name == "delay"
        if value is None:
            continue
        if flaw := flaw_of_array(value, f"effect().{name}", (count,), np.float64 if delay else np.bool_):
            return flaw
        if delay and not (np.isfinite(value) & (value >= 0.0)).all():
            return "effect().delay is below zero or not finite; give seconds, and lost for never"
    return ""


def flaw_of_ranges(told: object, shape: tuple[int, ...]) -> str:
    """Why these are no ranges (n, K) of receivers."""
    if not isinstance(told, np.ndarray) or told.dtype != np.float64 or told.shape != shape:
        return f"measured() gives no float64 array {shape}; return a range for each agent and step"
    if np.isinf(told).any():
        return "measured() gives an infinite range; a receiver that hears nothing measures NaN"
    return ""


def flaw_of_sent(told: object, message: Floats, past: Floats) -> str:
    """Why these are no messages (n, d) in place of honest ones, see Sent; where an agent is silent they are NaN."""
    if not isinstance(told, np.ndarray) or told.dtype != np.float64 or told.shape != message.shape:
        return f"sent() gives no float64 array {message.shape}; return a message for each agent"
    if not np.isfinite(told[np.isfinite(message + past)]).all():
        return "sent() gives a number that is not finite; receivers would refuse the message"
    return ""
