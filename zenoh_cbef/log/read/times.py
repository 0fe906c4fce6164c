"""When the messages of a recording were sent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.faults import ahead, clocks_of
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.log.read.tables import Table
from zenoh_cbef.scenario import Scenario


@dataclass(frozen=True)
class MessageTimes:
    """Sending times, s since the start signal; NaN where the log has no such message. n agents, K steps, L rounds.

    beacons: (n, K). heard: (n, K), whether there was anything in them. sends: (n, K, L + 1), of ranges, which are
    round 0, and consensus messages. estimates: (n, K). events: (process, time, text).
    """

    beacons: Floats
    heard: Bools
    sends: Floats
    estimates: Floats
    events: list[tuple[str, float, str]]

    def sent(self, agent: int, step: int, round_: int) -> float:
        """When an agent sent a range, as round 0, or a consensus message; NaN where the log does not have it."""
        inside = 1 <= step <= self.sends.shape[1] and 0 <= round_ < self.sends.shape[2]
        return float(self.sends[agent, step - 1, round_]) if inside else np.nan

    def used(self, agent: int, step: int, round_: int) -> float:
        """When an agent sent what followed from the messages of a round; infinite where the log does not have it.

        A round beyond the last is one of the steps behind.
        """
        later, round_ = divmod(round_, self.sends.shape[2])
        step += later
        if step > self.estimates.shape[1]:
            return np.inf
        last = round_ + 1 == self.sends.shape[2]
        time = float(self.estimates[agent, step - 1]) if last else self.sent(agent, step, round_ + 1)
        return np.inf if np.isnan(time) else time

    def steps(self) -> dict[int, tuple[float, float]]:
        """When the first agent began each step, and when the last one finished it."""
        there = np.flatnonzero(~np.isnan(self.estimates).all(axis=0))
        end = self.estimates[:, there]
        begin = np.where(np.isnan(self.sends[:, there, 0]) | np.isnan(end), end, self.sends[:, there, 0])
        spans = zip(np.nanmin(begin, axis=0).tolist(), np.nanmax(end, axis=0).tolist(), strict=True)
        return dict(zip((there + 1).tolist(), spans, strict=True))


def times_of(recording: Recording) -> MessageTimes:
    """The times of all messages."""
    tables = (recording.beacons, recording.ranges, recording.rounds, recording.estimates)
    scenario, steps = recording.header.scenario, max(table.last for table in tables)
    began = [one.sent if one.at is None else round(1e9 * one.at) for one in recording.signals if one.step == 0]
    start = began[0] if began else recording.first or 0
    # What the scenario's faults put a clock ahead by is known.
    wrong = _ahead(scenario, steps)
    ranges = _since(recording.ranges, start + wrong)
    rounds = _since(recording.rounds, start + np.repeat(wrong, recording.rounds_per_step, axis=0))
    rounds = rounds.reshape(scenario.count, recording.rounds_per_step, steps)
    heard = np.asarray(np.isfinite(recording.beacons.numbers("heard", steps)).all(axis=2))
    return MessageTimes(
        _since(recording.beacons, np.full_like(wrong, start)),
        heard,
        np.concatenate([ranges[:, :, None], np.moveaxis(rounds, 1, 2)], axis=2),
        _since(recording.estimates, start + wrong),
        [(one.message["from"], 1e-9 * (one.sent - start), one.message["text"]) for one in recording.events],
    )


def _since(table: Table, start: Ints) -> Floats:
    """Sending times in s since some moments (rows, K), ns; NaN where there is no message."""
    steps = start.shape[1]
    return np.where(table.seen(steps), 1e-9 * (table.stamps(steps).sent - start), np.nan)


def _ahead(scenario: Scenario, steps: int) -> Ints:
    """By how much the scenario's faults put the clocks of the agents ahead in each step, ns, (n, K)."""
    found = np.zeros((scenario.count, steps), dtype=np.int64)
    for agent in range(scenario.count):
        if clocks := clocks_of(scenario.fault, agent):
            found[agent] = [round(1e9 * ahead(clocks, step * scenario.dt)) for step in range(1, steps + 1)]
    return found
