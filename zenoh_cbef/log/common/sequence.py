"""The numbers that a sender gave its messages on one key: what is missing, and whether it was started again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

_LISTED = 1000

LARGEST_JUMP = 1_000_000
"""How many numbers can be lost at once: more than any recorder misses. A number beyond that is taken for wrong."""


_SENDERS, _CROWD = 100, 10_000
"""Of how many senders the numbers on one key are counted: more than a run has receivers for one agent. Beyond the
first two of a key, only as long as there are not so many altogether.
"""


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
    for themselves. next: one past the highest number of this life. absurd: how many numbers were out of all
    proportion, and example: the first of them, with the one that was expected. Nothing counts as missing for them:
    they are passed over, but where a second one follows on the first the sender goes on from there.
    """

    def __init__(self) -> None:
        self.next = 0
        self.absurd = 0
        self.example = (0, 0)
        self._strange = -1
        self._missing = 0
        self._gaps: list[tuple[int, int]] = []
        self._life = _Life()
        self._before = _Life()
        self._cut = self._healed = False
        self._unheard: list[tuple[int, int]] = []

    @property
    def sent(self) -> int:
        """How many messages were sent, in all lives: the sender's own count, or else one past its highest number."""
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

    @property
    def unheard(self) -> int:
        """How many of the missing were sent while the recorder was cut off from the sender."""
        spans = [*self._unheard, (self.next, (self._life.told or 0) - 1)] if self._cut else self._unheard
        return sum(
            max(0, min(last, until) - max(first, since) + 1) for first, last in self.gaps for since, until in spans
        )

    def cut_off(self) -> None:
        """The recorder loses sight of the sender: messages that are missing from now on could not be heard."""
        self._cut, self._healed = True, False

    def heal(self) -> None:
        """The recorder sees the sender again."""
        self._healed = True

    def lacks(self, number: int) -> bool:
        """Whether a number has not come in this life."""
        gaps = self._gaps[self._life.gaps :]
        return number >= self.next or any(first <= number <= last for first, last in gaps)

    def take(self, number: int) -> None:
        """Count one message."""
        if number == self.next:
            self.next += 1
            self._cut &= not self._healed
        elif number > self._reach:
            self._wonder(number)
            if number == self._strange + 1:
                skipped = self._strange - self.next
                self._life = replace(self._life, earlier=self._life.earlier - skipped)
                self.next = number + 1
            self._strange = number
        elif number > self.next:
            self._doubt(number)
            if self._cut:
                self._unheard.append((self.next, number - 1))
                self._cut = False
            self._skip_to(number)
            self.next = number + 1
        elif number == 0 and self.next > 1 and not self.lacks(0):
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
            self._cut &= not self._healed
        else:
            for number in numbers:
                self.take(number)

    def tell(self, count: int) -> None:
        """Take the sender's word for how many it sent in this life, which may come before the last of them does.

        A number beyond is not its own.
        """
        if count > self._reach:
            self._wonder(count)
            return
        self._doubt(count)
        self._life = replace(self._life, told=count)
        for place in reversed(range(self._life.gaps, len(self._gaps))):
            first, last = self._gaps[place]
            beyond = last + 1 - max(first, count)
            if beyond > 0:
                self._gaps[place : place + 1] = [(first, count - 1)] if first < count else []
                self._missing -= beyond

    @property
    def _reach(self) -> int:
        """The highest number that can be true."""
        return max(self.next, self._before.next if self.next == 1 else 0) + LARGEST_JUMP

    def _wonder(self, number: int) -> None:
        self.example = self.example if self.absurd else (number, self.next)
        self.absurd += 1

    def _doubt(self, number: int) -> None:
        """Go on with the life before where numbers continue as in that life: the 0 was sent by another process."""
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


class Sequences:
    """The numbers of all senders, by key and sender."""

    def __init__(self) -> None:
        self._all: dict[tuple[str, str], Sequence] = {}
        self._senders: Counter[str] = Counter()

    def __iter__(self) -> Iterator[tuple[tuple[str, str], Sequence]]:
        return iter(sorted(self._all.items()))

    def all_of(self, sender: str | None) -> Iterator[tuple[tuple[str, str], Sequence]]:
        """As iteration, but of one sender alone, or all for None, and in the order of their first messages."""
        return (one for one in self._all.items() if sender in (None, one[0][1]))

    @property
    def missing(self) -> int:
        """How many numbers are missing altogether."""
        return sum(sequence.missing for sequence in self._all.values())

    @property
    def sent(self) -> int:
        """How many messages were sent altogether."""
        return sum(sequence.sent for sequence in self._all.values())

    def of(self, key: str, sender: str) -> Sequence:
        """The numbers of a sender on a key; those of one sender too many are counted nowhere."""
        found = self._all.get((key, sender))
        if found is None:
            found = Sequence()
            self._senders[key] += 1
            if self._senders[key] <= (_SENDERS if len(self._all) < _CROWD else 2):
                self._all[key, sender] = found
        return found

    def next(self, key: str, sender: str) -> int:
        """One past the highest number of a sender on a key, 0 where there is none."""
        found = self.find(key, sender)
        return found.next if found else 0

    def find(self, key: str, sender: str) -> Sequence | None:
        """The numbers of a sender on a key, None where there are none."""
        return self._all.get((key, sender))
