"""Late messages."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from zenoh_cbef.arrays import Floats, Ids
from zenoh_cbef.faults.base import Effect, LinkFault, Messages
from zenoh_cbef.quantities import Milliseconds
from zenoh_cbef.streams import Keys, exponential, normal, uniform

_MEMORY = 64


class Delay(LinkFault):
    """Each message takes longer to arrive: by a draw of mean `milliseconds`, plus a uniform share of `jitter_ms`.

    distribution: constant; uniform - from 0 to twice the mean; normal - with `std_ms`, cut off at 0; exponential;
    pareto - with `shape` > 1, the smallest is mean (shape - 1)/shape. reorder: whether a message may overtake those
    sent before it on its link; if not, it waits for them (for the last 64).
    """

    kind: Literal["delay"]
    milliseconds: Milliseconds
    jitter_ms: Milliseconds = 0.0
    distribution: Literal["constant", "uniform", "normal", "exponential", "pareto"] = "constant"
    std_ms: Milliseconds | None = None
    shape: Annotated[float, Field(gt=1.0, le=1e6, allow_inf_nan=False)] = 3.0
    reorder: bool = True

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.distribution == "normal" and self.std_ms is None:
            raise ValueError("fault.std_ms is missing for fault.distribution = 'normal'; add it")
        if self.distribution != "normal" and self.std_ms is not None:
            raise ValueError(f"fault.std_ms is for distribution 'normal', not {self.distribution!r}; leave it out")
        return self

    def effect(self, messages: Messages, index: int) -> Effect:
        """Never lost; delayed."""
        if self.reorder:
            return Effect(delay=self._seconds(messages, index, np.array(messages.step), np.array(messages.round)))
        back = np.arange(_MEMORY)
        step, round_ = messages.when(messages.number - back)
        delay = self._seconds(messages, index, step, round_)
        before = (step >= 1) & self.during(messages.dt * step.astype(np.float64))
        return Effect(delay=np.where(before, delay - back * messages.spacing, 0.0).max(axis=1))

    def _seconds(self, messages: Messages, index: int, step: Ids, round_: Ids) -> Floats:
        """Each message's own delay, for every link (e, ...) at steps and rounds (...)."""
        name = f"delay/{index}"
        jitter, size = (
            messages.streams.key(purpose).reshape(-1, *[1] * step.ndim) for purpose in (name, f"{name}/size")
        )
        delay = self._milliseconds(size, step, round_) + self.jitter_ms * uniform(jitter, step, round_)
        return np.asarray(1e-3 * delay)

    def _milliseconds(self, key: Keys, step: Ids, round_: Ids) -> Floats:
        mean = self.milliseconds
        if self.distribution == "uniform":
            return 2.0 * mean * uniform(key, step, round_)
        if self.distribution == "normal":
            return np.maximum(mean + (self.std_ms or 0.0) * normal(key, step, round_), 0.0)
        if self.distribution == "exponential":
            return mean * exponential(key, step, round_)
        if self.distribution == "pareto":
            return mean * (self.shape - 1.0) / self.shape * np.exp(exponential(key, step, round_) / self.shape)
        return np.full(np.broadcast_shapes(key.shape, step.shape), mean)
