"""A network that knows what its estimate is worth: whether it acquires, tracks, coasts, or has lost its target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.around.mirror_images import undecided
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Bias, Update
from zenoh_cbef.tracking.filters.information_form import unchanged
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.status import ACQUIRING, CUT, LOST, Status, most_misfit

_UNLIKELY = 4.0
"""How many of its prior standard deviations a bias is off that explains nothing."""


@dataclass(frozen=True)
class Knowing(Wrapping):
    """Any filter of information, with two numbers more in its payload: whether it had a range, and whether those fit.

        y_i = ([r_i was measured], 9 [e_i > 3.6])                 zeros without a range
        c_i = max(min(NIS_i, 9), 9 d_i, 9 [w_i b_i^2 > 16 var b])
        e_i <- e_i + (min(c_i, c_i of the range before) - e_i)/15
        n times the average of y: the network's ranges of this step, and nine times those of agents they do not fit

    Two kinds of agents have a small NIS and count as not fitting all the same: one that distrusts its receiver by d_i,
    as it expects large errors, and one that explains its ranges by a bias b_i, relied on by w_i, far beyond its prior.

    From these sums and its covariance, which the network agrees on but for what consensus left, every agent decides
    what the estimate is (see Status). An agent that hears no neighbour goes on by prediction, so its ranges count as
    none, and so do those of a group that is too small to find the target.
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
        if measurement.few is not None:
            heard &= ~measurement.few
        fit = np.where(heard, np.minimum(update.diagnostics.nis / np.maximum(degrees, 1), CUT), 0.0)
        if self.settings.judges_agents:
            counts = heard & (status.steps >= self.settings.first_fix)
            status = status.judging(self._misfit(fit, update.diagnostics.distrust, inner.bias), counts)
            fit = np.where(counts & status.wrong, CUT, 0.0)
        payload = np.concatenate([update.payload, heard[:, None].astype(np.float64), fit[:, None]], axis=1)
        return Update(payload, update.diagnostics, tuple(vars(status).values()), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and what it is worth."""
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, : -self.more]), update.parts[0])
        status = self._status(inner, payload, update)
        if self.settings.plane:
            rows = undecided(self.filter, inner) & (status.which != LOST)
            status = status.told(rows, ACQUIRING, Status(*update.kept), self.settings.motion.dt)
        return Belief(inner.state, inner.covariance, inner.bias, parts=(inner,), status=status, excess=inner.excess)

    def _misfit(self, fit: Floats, distrust: Floats, bias: Bias | None) -> Floats:
        """How badly ranges fit, (n,), also where the filter has come to terms with them."""
        fit = np.fmax(fit, CUT * distrust)
        if bias is None:
            return fit
        variance = self.settings.common_bias_std**2 + self.settings.own_bias_std**2
        return np.where(bias.weight * bias.value**2 > _UNLIKELY**2 * variance, CUT, fit)

    def _most(self, belief: Belief) -> Floats | None:
        """The mean misfit of a network that has lost its target; None: by the first rules."""
        if not self.settings.judges_agents:
            return None
        relied_on = np.zeros(len(belief.state)) if belief.bias is None else belief.bias.weight
        unknowns = self.settings.space.axes + np.where(relied_on > 0.5, 1.0, 0.0)
        return most_misfit(unknowns, self.settings.network_size)

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
            most=self._most(belief),
            agents=0 if self.settings.presumes else count,
        )
