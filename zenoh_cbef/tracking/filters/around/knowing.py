"""A network that knows what its estimate is worth: whether it acquires, tracks, coasts, or has lost its target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Floats, Update
from zenoh_cbef.tracking.filters.information_form import unchanged
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.status import CUT, Status


@dataclass(frozen=True)
class Knowing(Wrapping):
    """Any filter of information, with two numbers more in its payload: whether it had a range, and how that fitted.

        y_i = ([r_i was measured], min(NIS_i, 9))               zeros without a range
        n times the average of y: the network's ranges of this step, and their sum of cut NIS

    From these sums and its covariance, which the network agrees on but for what consensus left, every agent decides
    what the estimate is (see Status). An agent that hears no neighbour goes on by prediction, so its ranges count as
    none.
    """

    settings: FilterSettings

    more = 2

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, and the two numbers."""
        inner = belief.parts[0] if belief.parts else belief
        status = Status.first(len(belief.state)) if belief.status is None else belief.status
        update = self.filter.update(inner, measurement)
        degrees = update.diagnostics.nis_degrees
        heard = np.isfinite(update.diagnostics.nis) & (degrees > 0)
        fit = np.where(heard, np.minimum(update.diagnostics.nis / np.maximum(degrees, 1), CUT), 0.0)
        payload = np.concatenate([update.payload, heard[:, None].astype(np.float64), fit[:, None]], axis=1)
        return Update(payload, update.diagnostics, tuple(vars(status).values()), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and what it is worth."""
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, : -self.more]), update.parts[0])
        status = self._status(inner, payload, update)
        return Belief(inner.state, inner.covariance, inner.bias, parts=(inner,), status=status)

    def _status(self, belief: Belief, payload: Floats, update: Update) -> Status:
        count, axes = self.settings.network_size, self.settings.space.axes
        mean = np.fmin(np.fmax(payload[:, -self.more :], 0.0), CUT)  # 0 for what is not a number
        if count > 1:
            mean = np.where(unchanged(payload, update.payload)[:, None], 0.0, mean)
        covariance = belief.known_covariance
        variance = covariance[:, 0, 0]
        for axis in range(1, axes):
            variance = variance + covariance[:, axis, axis]
        return Status(*update.kept).after(
            heard=count * np.minimum(mean[:, 0], 1.0),
            misfit=count * mean[:, 1],
            spread=np.sqrt(variance),
            axes=axes,
            fix=self.settings.first_fix,
            dt=self.settings.motion.dt,
        )
