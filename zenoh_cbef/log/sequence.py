"""The numbers that a sender gave its messages on one key: what is missing, and whether it was started again."""

from __future__ import annotations

from dataclasses import dataclass, replace

_LISTED = 1000


@dataclass(frozen=True)
class _Life:
    """From one start of a sender to the next.

    earlier: what was sent in the lives before. gaps: where its gaps begin in the list. told: what the sender said that
    it sent. next: of a life that is over.
    """

    earlier: int = 0
    gaps: int = 0
    told: int | None = None
    next: int = 0


class Sequence:
    """One sender's numbers on one key, in the order of a log.

    A 0 after higher numbers means that the sender was started again: it begins another life, whose numbers are counted
    for themselves. next: one past the highest number of this life.
    """

    def __init__(self) -> None:
        self.next = 0
        self._missing = 0
        self._gaps: list[tuple[int, int]] = []
        self._life = _Life()
        self._before = _Life()

    @property
    def sent(self) -> int:
        """How many messages were sent, in all lives: what the sender told, or else one past its highest number."""
        return self._life.earlier + (self.next if self._life.told is None else self._life.told)

    @property
    def missing(self) -> int:
        """How many numbers are not there, in all lives."""
        return self._missing + max(0, (self._life.told or 0) - self.next)

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """First and last of the missing numbers, as they were met: the first thousand stretches of them."""
        told = self._life.told or 0
        return [*self._gaps, (self.next, told - 1)] if told > self.next else [*self._gaps]

    def take(self, number: int) -> None:
        """Count one message."""
        if number == self.next:
            self.next += 1
        elif number > self.next:
            self._doubt(number)
            self._skip_to(number)
            self.next = number + 1
        elif number == 0 and self.next > 1:
            self._skip_to(self._life.told or 0)
            self._before = replace(self._life, next=self.next)
            self._life = _Life(earlier=self.sent, gaps=len(self._gaps))
            self.next = 1
        else:
            self._fill(number)

    def take_all(self, numbers: list[int]) -> None:
        """Count several messages, in order."""
        following = self.next + len(numbers)
        if numbers == list(range(self.next, following)):
            self.next = following
        else:
            for number in numbers:
                self.take(number)

    def tell(self, count: int) -> None:
        """Take the sender's word for how many it sent in this life, which may come before the last of them does.

        A number beyond is not its own.
        """
        self._doubt(count)
        self._life = replace(self._life, told=count)
        for place in reversed(range(self._life.gaps, len(self._gaps))):
            first, last = self._gaps[place]
            beyond = last + 1 - max(first, count)
            if beyond > 0:
                self._gaps[place : place + 1] = [(first, count - 1)] if first < count else []
                self._missing -= beyond

    def _doubt(self, number: int) -> None:
        """Where numbers go on as if nothing had been, the 0 was somebody else's: the life before goes on."""
        if self.next == 1 < self._before.next <= number:
            self.next, self._life = self._before.next, self._before

    def _skip_to(self, number: int) -> None:
        if number > self.next:
            if len(self._gaps) < _LISTED:
                self._gaps.append((self.next, number - 1))
            self._missing += number - self.next
            self.next = number

    def _fill(self, number: int) -> None:
        """A message that comes late is not missing any more; one that comes twice never was."""
        for place in range(self._life.gaps, len(self._gaps)):
            first, last = self._gaps[place]
            if first <= number <= last:
                parts = [(first, number - 1), (number + 1, last)]
                self._gaps[place : place + 1] = [part for part in parts if part[0] <= part[1]]
                self._missing -= 1
                return
