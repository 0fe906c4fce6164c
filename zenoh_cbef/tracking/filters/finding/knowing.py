"""A network that knows what its estimate is worth: whether it acquires, tracks, coasts, or has lost its target."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.around.hearers import Hearers
from zenoh_cbef.tracking.filters.around.mirror_images import undecided
from zenoh_cbef.tracking.filters.around.returning import FEW_BEND, widened
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping, denied
from zenoh_cbef.tracking.filters.base import Belief, Bias, Update
from zenoh_cbef.tracking.filters.information_form import unchanged
from zenoh_cbef.tracking.filters.models.contending import apart
from zenoh_cbef.tracking.filters.settings import UNLIKELY, FilterSettings
from zenoh_cbef.tracking.linalg import leading_trace
from zenoh_cbef.tracking.ranging import Measurement, own_range
from zenoh_cbef.tracking.status import ACQUIRING, COASTING, CUT, LOST, TRACKING, WRONG, Status, most_misfit, wrong_among


def former_of(update: Update) -> Status:
    """What agents knew before an update of `Knowing`."""
    return Status(*update.kept[:-1])


@dataclass(frozen=True)
class Knowing(Wrapping):
    """Any filter of information, with two numbers more in its payload: whether it had a range, and whether those fit.

        y_i = ([r_i was measured], 9 [e_i > 3.6])                 zeros without a range
        c_i = max(min(NIS_i, 9), 9 d_i, 9 [w_i b_i^2 > 16 var b])
        e_i <- e_i + (min(c_i, c_i of the range before) - e_i)/15
        n times the average of y: the network's ranges of this step, and nine times those of agents they do not fit

    Two kinds of agents have a small NIS and count as not fitting all the same: one that distrusts its receiver by d_i,
    as it expects large errors, and one that explains its ranges by a bias b_i, relied on by w_i, far beyond its prior.
    Where receivers may fall silent, agents count those that have heard the target lately (see `Hearers`): ranges of
    fewer agents than the target has axes fit a whole curve, and a filter that takes them in is soon too sure of one
    point.

    Agents that tell each other their ranges begin a payload with what each predicts, so its average is the mean of all.
    One that is far off the mean for what it claims (settings.compares) does not say that it tracks: agents that were
    cut off from each other may hold on to a place that fits three ranges, and take the others for wrong.

    From these sums and its covariance, which the network agrees on but for what consensus left, every agent decides
    what the estimate is (see Status). An agent that hears no neighbour goes on by prediction, so its ranges count as
    none, and so do those of a group that is too small to find the target. Once it coasts, such a group does not track
    again before others are back (settings.alone_bend).
    """

    settings: FilterSettings

    @classmethod
    def numbers(cls, settings: FilterSettings) -> int:
        """How many numbers a payload has more."""
        return 2 + (Hearers(settings).numbers if settings.hearing else 0)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, and the two numbers."""
        inner = belief.parts[0] if belief.parts else belief
        passed = (measurement.step or 1) - 1 if self.settings.joins_fix else 0
        status = belief.status or Status.first(len(belief.state), passed, proves=self.settings.proves)
        if self.settings.hearers_count and not (self.settings.tells_ranges or self.settings.squares):
            few = (status.scarce > 0.0) & (status.steps >= self.settings.first_fix)
            unsure = self.settings.space, inner, measurement, self.settings.range_std
            measurement = widened(few, *unsure, times=FEW_BEND)
        update = self.filter.update(inner, measurement)
        nis, degrees = update.diagnostics.nis, update.diagnostics.nis_degrees
        heard = np.isfinite(nis) & (degrees > 0)
        if measurement.few is not None:
            heard &= ~measurement.few
        fit = np.minimum(nis / np.maximum(degrees, 1), CUT)
        fit[~heard] = 0.0
        if self.settings.judges_agents:
            counts = heard & (status.steps >= self.settings.first_fix)
            # How badly ranges fit, also where the filter has come to terms with them.
            misfit = np.fmax(fit, CUT * update.diagnostics.distrust)
            if inner.bias is not None:
                misfit[self._explains_nothing(inner.bias, inner.state, measurement)] = CUT
            status = status.judging(misfit, counts)
            fit = CUT * (counts & (status.own > self._wrong))
        count, size = update.payload.shape
        payload = np.empty((count, size + self.numbers(self.settings)))
        payload[:, :size], payload[:, size], payload[:, size + 1] = update.payload, heard, fit
        if self.settings.hearing:
            status = status.hearing(np.isfinite(measurement.range))
            lately = status.unheard < self.settings.hearing
            payload[:, size + 2 :] = Hearers(self.settings).told(belief.memory, measurement.agent, lately)
        in_few = np.zeros(count) if measurement.few is None else measurement.few.astype(np.float64)
        return Update(payload, update.diagnostics, (*vars(status).values(), in_few), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and what it is worth."""
        more = self.numbers(self.settings)
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, :-more]), update.parts[0])
        former, few, settings = former_of(update), update.kept[-1] > 0.0, self.settings
        hearers = Hearers(settings)
        count, axes, dt = settings.network_size, settings.space.axes, settings.motion.dt
        numbers = np.nan_to_num(payload[:, -more:])
        if count > 1:
            alone = unchanged(payload, update.payload)
            # Of who hears the target an agent knows what it knew.
            numbers[alone, : 2 if settings.hearers_count else more] = 0.0
        mean, hearing = np.fmin(np.fmax(numbers[:, :2], 0.0), CUT), numbers[:, 2:]
        hear = hearers.count(hearing) if settings.hearing else None
        judges = np.fmin(np.rint(hear), count) if hear is not None and settings.hearers_count else float(count)
        most = self._most(inner.bias, judges) if settings.judges_agents else None
        covariance = inner.known_covariance
        status = former.after(
            heard=count * np.minimum(mean[:, 0], 1.0),
            misfit=count * mean[:, 1],
            spread=np.sqrt(leading_trace(covariance, axes)),
            axes=axes,
            fix=settings.first_fix,
            dt=dt,
            most=most,
            agents=0 if settings.presumes else count,
            whole=settings.hearers_count,
            enough=None if hear is None else hear > axes - 0.5,
            proves=settings.proves,
        )
        off = few & (former.which != TRACKING) & (settings.alone_bend is not None)
        if settings.compares:
            off |= apart(payload[:, :axes] - update.payload[:, :axes], covariance, axes)
        if off.any():
            which = np.where(former.which == ACQUIRING, ACQUIRING, COASTING)
            status = status.told(off & (status.which == TRACKING), which, former, dt)
        status = self.undecided(status, former, inner)
        memory = hearers.memory(hearing, former.unheard < settings.hearing) if settings.hearing else ()
        return Belief(inner.state, inner.covariance, inner.bias, memory, (inner,), status, excess=inner.excess)

    def undecided(self, status: Status, former: Status, inner: Belief) -> Status:
        """What agents say that do not know which of several places the target is at. former: a step ago."""
        settings, dt = self.settings, self.settings.motion.dt
        if settings.undetermined:
            status = status.told(status.which == TRACKING, ACQUIRING, former, dt)
        if settings.plane:
            told = status.which == TRACKING if settings.blends else status.which != LOST
            rows = undecided(self.filter, inner) & told
            status = status.told(rows, ACQUIRING, former, dt)
        if settings.seeks:
            rows = denied(self.filter, inner) & (status.which == TRACKING)
            status = status.told(rows, ACQUIRING, former, dt)
        return status

    def _explains_nothing(self, bias: Bias, state: Floats, measurement: Measurement) -> Bools:
        """Which agents (n,) rely on a bias far beyond its prior."""
        settings = self.settings
        variance: float | Floats = settings.common_bias_std**2 + settings.own_bias_std**2
        if settings.scale_std:
            distance, _ = own_range(settings.space, state, measurement.position, measurement.age)
            variance = variance + (settings.scale_std * distance) ** 2
        return np.asarray(bias.weight * bias.value**2 > UNLIKELY**2 * variance)

    @cached_property
    def _wrong(self) -> float:
        """The mean misfit of an agent whose ranges do not fit; a filter that seeks holds among more outliers."""
        told = self.settings.outliers
        return wrong_among(told[0]) if self.settings.seeks and told is not None else WRONG

    def _most(self, bias: Bias | None, agents: float | Floats) -> Floats:
        """The mean misfit of a network that has lost its target, where agents rely on a bias and where they do not.

        agents: how many judge the place; by the fifteenth rules also those of which the target is not heard.
        """
        axes = self.settings.space.axes
        most = most_misfit(axes, agents)
        return most if bias is None else np.where(bias.weight > 0.5, most_misfit(axes + 1, agents), most)
