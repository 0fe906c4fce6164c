"""A run in lockstep that stands still by order, and goes on by single steps, or by single rounds of a step."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

_LOOK_SECONDS, _BEGUN_SECONDS = 0.02, 1.0


class Hold:
    """Whether the run stands still: between steps, or where it was told to go by rounds, between those of a step.

    Between steps the target begins none, so its agents wait for their beacons. Where a step goes by rounds its beacons
    say so, and agents make each round when the target lets them. by_rounds: whether the step goes so; round: the last
    one of it that agents were let make, None where no such step is under way.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self.on, self._steps, self._rounds = False, 0, 0
        self.by_rounds = False
        self.round: int | None = None

    def order(self, *, on: bool, steps: int, rounds: int) -> None:
        """Let the run stand still after so many more ends of steps, or rounds, or go on. Returns after those rounds.

        From another thread than the target's own. A round that was ordered before, and is still to come, is made.
        """
        with self._changed:
            self.on, self._steps, self._rounds = on, steps, max(rounds, self._rounds) if on else 0
            self._changed.notify_all()
            self._changed.wait_for(lambda: not self._rounds, timeout=_BEGUN_SECONDS)

    def wait(self, meanwhile: Callable[[], None], stopping: Callable[[], bool]) -> None:
        """Wait until the next step may begin. meanwhile: called again and again."""
        with self._changed:
            self._stand(meanwhile, stopping)
            self.by_rounds = self.on and not self._steps and not stopping()
            if not self.by_rounds:
                self._steps = max(self._steps - 1, 0)

    def rounds(self, number: int, meanwhile: Callable[[], None], stopping: Callable[[], bool]) -> Iterator[int]:
        """The rounds of a step that goes by rounds, each when it may be made; none of another step."""
        if not self.by_rounds:
            return
        for round_ in range(1, number + 1):
            with self._changed:
                self.round = round_ - 1
                self._stand(meanwhile, stopping)
            yield round_
            with self._changed:
                self.round = round_
                self._rounds = max(self._rounds - 1, 0) if round_ < number else 0
                self._changed.notify_all()
        with self._changed:
            self.by_rounds, self.round, self._rounds, self._steps = False, None, 0, max(self._steps - 1, 0)

    def _stand(self, meanwhile: Callable[[], None], stopping: Callable[[], bool]) -> None:
        while self.on and not self._steps and not self._rounds and not stopping():
            meanwhile()
            self._changed.wait(_LOOK_SECONDS)
