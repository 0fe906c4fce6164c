"""CPU of a simulated agent's step beside a step of other libraries' extended Kalman filters, in turn.

Ours has ten rounds of consensus, noise, faults and the analysis in it; theirs predict and take in one range that is
given. Both libraries are for this benchmark only: an arm whose package is not installed is left out, and says so.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import partial
from importlib import import_module
from statistics import median
from typing import Any

import numpy as np

from benchmarks.common import Row, at_least
from zenoh_cbef.arrays import Floats
from zenoh_cbef.trace import Trace

RANGE_STD, ACCELERATION_STD = 0.1, 0.5
"""m and m/s^2; what a step costs does not depend on them."""


@dataclass(frozen=True)
class Heard:
    """What one agent measured: positions (K, 3), ranges (K,), m; where the target is at first, (6,); dt, s."""

    positions: Floats
    ranges: Floats
    begin: Floats
    dt: float


Arm = Callable[[Sequence[Heard]], None]


def heard_by(traces: Sequence[Trace]) -> list[Heard]:
    """What every agent of some runs measured."""
    return [
        Heard(positions, ranges, trace.truth[0], trace.scenario.dt)
        for trace in traces
        for positions, ranges in zip(trace.positions, trace.ranges, strict=True)
    ]


def filterpy_arm() -> Arm:
    """FilterPy's ExtendedKalmanFilter; state (p, v)."""
    kalman = import_module("filterpy.kalman")

    def away(state: Floats, place: Floats) -> Floats:
        return np.array([[np.linalg.norm(state[:3, 0] - place)]])

    def rows(state: Floats, place: Floats) -> Floats:
        apart = state[:3, 0] - place
        return np.concatenate([apart / np.linalg.norm(apart), np.zeros(3)])[None, :]

    def run(agents: Sequence[Heard]) -> None:
        for heard in agents:
            one = kalman.ExtendedKalmanFilter(dim_x=6, dim_z=1)
            one.x, one.R = heard.begin[:, None].copy(), np.array([[RANGE_STD**2]])
            one.F = np.eye(6) + heard.dt * np.eye(6, k=3)
            one.Q = ACCELERATION_STD**2 * np.diag([heard.dt**3 / 3.0] * 3 + [heard.dt] * 3)
            for place, range_ in zip(heard.positions, heard.ranges, strict=True):
                one.predict()
                one.update(np.array([[range_]]), rows, away, args=(place,), hx_args=(place,))

    return run


def stone_soup_arm() -> Arm:
    """Stone Soup's extended Kalman predictor and updater; state (x, vx, y, vy, z, vz)."""
    base = import_module("stonesoup.models.measurement.nonlinear").NonLinearGaussianMeasurement
    types = import_module("stonesoup.types.state")
    arrays = import_module("stonesoup.types.array")
    linear = import_module("stonesoup.models.transition.linear")
    detections = import_module("stonesoup.types.detection")
    hypotheses = import_module("stonesoup.types.hypothesis")
    predictor_of = import_module("stonesoup.predictor.kalman").ExtendedKalmanPredictor
    updater_of = import_module("stonesoup.updater.kalman").ExtendedKalmanUpdater

    class Range(base):  # type: ignore[misc, valid-type] # of a library that may be missing
        """The distance of the target from a place, with its Jacobian."""

        place: Floats
        ndim_meas = 1

        def function(self, state: Any, **_: object) -> Any:
            apart = np.asarray(state.state_vector, dtype=np.float64)[::2, 0] - self.place
            return arrays.StateVector([np.linalg.norm(apart)])

        def jacobian(self, state: Any, **_: object) -> Floats:
            apart = np.asarray(state.state_vector, dtype=np.float64)[::2, 0] - self.place
            row = np.zeros((1, 6))
            row[0, ::2] = apart / np.linalg.norm(apart)
            return row

    def run(agents: Sequence[Heard]) -> None:
        for heard in agents:
            now = datetime(2000, 1, 1)  # noqa: DTZ001 - as that library counts time
            motion = [linear.ConstantVelocity(ACCELERATION_STD**2)] * 3
            predictor = predictor_of(linear.CombinedLinearGaussianTransitionModel(motion))
            begin = arrays.StateVector(heard.begin.reshape(2, 3).T.ravel())
            state = types.GaussianState(begin, np.eye(6), timestamp=now)
            model = Range(ndim_state=6, mapping=(0, 2, 4), noise_covar=arrays.CovarianceMatrix([[RANGE_STD**2]]))
            updater = updater_of(model)
            for place, range_ in zip(heard.positions, heard.ranges, strict=True):
                now, model.place = now + timedelta(seconds=heard.dt), place
                seen = detections.Detection(arrays.StateVector([range_]), timestamp=now, measurement_model=model)
                prediction = predictor.predict(state, timestamp=now)
                state = updater.update(hypotheses.SingleHypothesis(prediction, seen))

    return run


ARMS = {
    "Stone Soup's EKF": ("stonesoup", stone_soup_arm, 30.0),
    "FilterPy's EKF": ("filterpy", filterpy_arm, 7.0),
}
"""By name: the package, what makes the arm, and how many times ours it should take at least."""


def compared(ours: Callable[[], Sequence[Trace]], what: str, repeats: int) -> Iterator[Row]:
    """CPU of each arm over ours for the same number of agent-steps, medians of runs in turn."""
    agents = heard_by(ours())
    steps = sum(len(one.ranges) for one in agents)
    arms = dict[str, Arm]()
    for name, (package, make, _) in ARMS.items():
        try:
            arms[name] = make()
        except ImportError:
            yield Row(f"{name} over ours", f"not measured; run: pip install {package}")
    spent = {name: list[float]() for name in ("ours", *arms)}
    for _ in range(repeats if arms else 0):
        spent["ours"].append(_cpu(ours))
        for name, arm in arms.items():
            spent[name].append(_cpu(partial(arm, agents)))
    for name in arms:
        times = median(theirs / own for theirs, own in zip(spent[name], spent["ours"], strict=True))
        yield at_least(f"{name} over ours, {what}, CPU of {steps} agent-steps", times, ARMS[name][2])


def _cpu(work: Callable[[], object]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin
