"""What every fault must hold to: `check_fault(Mine)`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

import numpy as np
from pydantic import ValidationError

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults import KINDS, kind_of
from zenoh_cbef.faults.answers import flaw_of_array, flaw_of_effect, flaw_of_ranges, flaw_of_sent
from zenoh_cbef.faults.base import Effect, Fault, MessageFault, Messages
from zenoh_cbef.faults.outgoing import SenderFault, Sent
from zenoh_cbef.faults.plugged import fault_of, read_fault
from zenoh_cbef.faults.sensing import Readings, SensorFault
from zenoh_cbef.plugins import blaming, mistake
from zenoh_cbef.streams import LinkStreams, normal, stream
from zenoh_cbef.testing.nonconforming import Nonconforming, only_reading

_AGENTS, _STEPS, _ROUNDS, _DT = 5, 24, 3, 0.1
_PAIRS = np.array([(one, other) for one in range(_AGENTS) for other in range(_AGENTS) if one != other])

_METHODS = (SensorFault, "measured"), (SenderFault, "sent")

Numbers = list[tuple[str, np.ndarray]]
"""What a fault does in each step and round: what it is, and an array with a row for each link or agent."""


def check_fault(kind: type, /, **keys: object) -> None:
    """Ask of a fault all that runs rely on.

    Raises Nonconforming, or ValueError for keys that the fault has not, or a class that is no fault.
    kind: the class that `fault.kind` would name. keys: as in `[[fault]]`, so options={"depth": 3.0}. Faults of agents
    are of agents 1 and 3 where no key says otherwise. The fault goes through 24 steps of all links of five agents.
    """
    chosen = fault_of(kind, kind.__qualname__)
    fault = _made(chosen, keys)
    everything = slice(None)
    found = _answer(fault, 1, 0, everything)
    if not _same(_answer(fault, 1, 0, everything), found):
        raise Nonconforming("the same fault does something else the second time; draw from streams, and keep nothing")
    if not _same(_answer(_made(chosen, keys), 1, 0, everything), found):
        raise Nonconforming("two faults with the same keys do different things; draw from streams, and ask no clock")
    for row in range(len(found[0][1])):
        alone = _answer(fault, 1, 0, slice(row, row + 1))
        if not _same(alone, [(name, each[row : row + 1]) for name, each in found]):
            raise Nonconforming(
                f"link or agent {row} alone meets another fate than among others; use elementwise functions, and draw "
                "from streams that its own numbers name"
            )
    drawn = not _same(_answer(fault, 2, 0, everything), found)
    if drawn and _same(_answer(fault, 1, 1, everything), found):
        raise Nonconforming(
            "two faults of this kind draw the same numbers; put `index` into the purpose of the stream, as in "
            'f"mine/{index}"'
        )


def refuse_broken(name: str, table: Mapping[str, object]) -> None:
    """Raise UserError where a fault of another package that this host has does not do what `check_fault` asks.

    table: as of `[[fault]]`. A name or a key that there is not is left to the process that takes the fault in.
    """
    keys = {key: value for key, value in table.items() if key not in {"kind", "from", "until"}}
    try:
        kind = kind_of(name)
        _made(kind, keys)
    except ValueError:
        return
    if name not in KINDS:
        method = next((method for base, method in _METHODS if issubclass(kind, base)), "effect")
        with blaming(kind, method, "check_fault"):
            check_fault(kind, **keys)


def _made(kind: type[Fault], keys: Mapping[str, object]) -> Fault:
    field = kind.model_fields.get("agents")
    table = {"kind": kind.__qualname__} | ({"agents": [1, 3]} if field is not None else {}) | dict(keys)
    try:
        return read_fault(kind, table)
    except ValidationError as error:
        raise ValueError(mistake(error, "fault")) from None


def _answer(fault: Fault, seed: int, index: int, rows: slice) -> Numbers:
    """What a fault does, by seed of the run, its place in the scenario, and the rows that are asked for at once."""
    if isinstance(fault, MessageFault):
        return _messages(fault, seed, index, rows)
    if isinstance(fault, SenderFault):
        return _sent(fault, seed, index, rows)
    if isinstance(fault, SensorFault):
        return _measured(fault, seed, index, rows)
    raise Nonconforming("it is a fault of nothing; derive it from LinkFault, SenderFault or SensorFault")


def _same(one: Numbers, other: Numbers) -> bool:
    return all(
        name == again and first.tobytes() == second.tobytes()
        for (name, first), (again, second) in zip(one, other, strict=True)
    )


def _fixed(array: np.ndarray) -> np.ndarray:
    array = np.ascontiguousarray(array)
    array.flags.writeable = False
    return array


def _messages(fault: MessageFault, seed: int, index: int, rows: slice) -> Numbers:
    """What becomes of the messages of links, in each step and round, latest step first."""
    source, destination = (_fixed(each) for each in _PAIRS[rows].T)
    seeds = _fixed(np.full(len(source), seed, dtype=np.uint64))
    streams = LinkStreams(seeds, source, destination, range(_ROUNDS + 1))
    with only_reading("selects()"):
        chosen = fault.selects(source, destination)
    _refuse(flaw_of_array(chosen, "selects()", source.shape))
    found: Numbers = [("selects", chosen)]
    for step in (*range(1, _STEPS + 1), *range(_STEPS, 0, -5)):
        for round_ in range(_ROUNDS + 1):
            one = Messages(
                seed=seeds,
                source=source,
                destination=destination,
                step=step,
                round=round_,
                dt=_DT,
                per_step=_ROUNDS + 1,
                ranges=True,
                streams=streams,
            )
            with only_reading("effect()"):
                effect = fault.effect(one, index)
            _refuse(flaw_of_effect(effect, len(source)))
            found += _of_effect(effect, len(source))
    return found


def _of_effect(effect: Effect, count: int) -> Numbers:
    nothing = np.zeros(count)
    told = [(field.name, getattr(effect, field.name)) for field in fields(effect)]
    return [(name, nothing if value is None else value.astype(np.float64)) for name, value in told]


def _refuse(flaw: str) -> None:
    if flaw:
        raise Nonconforming(flaw)


def _measured(fault: SensorFault, seed: int, index: int, rows: slice) -> Numbers:
    """What the receivers of agents measure."""
    agent, step = np.arange(_AGENTS)[:, None], np.arange(1, _STEPS + 1)
    ranges = 5.0 + normal(stream(1, "range noise", agent), step)
    ranges[(agent + step) % 5 == 0] = np.nan
    time = _DT * step.astype(np.float64)
    on = fault.selects(agent) & fault.during(time)
    readings = Readings(
        seed=seed,
        agent=_fixed(agent[rows]),
        step=_fixed(step),
        time=_fixed(time),
        ranges=_fixed(ranges[rows]),
        signal_speed=3e8,
        on=_fixed(on[rows]),
    )
    with only_reading("measured()"):
        told = fault.measured(readings, index)
    _refuse(flaw_of_ranges(told, (len(agent[rows]), _STEPS)))
    return [("measured", np.where(on[rows], told, ranges[rows]))]


def _displaced(message: Floats, offset: Floats) -> Floats:
    return np.asarray(message + offset.sum(axis=1, keepdims=True))


def _sent(fault: SenderFault, seed: int, index: int, rows: slice) -> Numbers:
    """What agents send in place of their messages."""
    found: Numbers = []
    agents = np.arange(_AGENTS)[rows]
    for step in range(1, _STEPS + 1):
        message = normal(stream(1, "message", agents)[:, None], step, np.arange(9))
        sent = Sent(
            seed=_fixed(np.full(len(agents), seed, dtype=np.uint64)),
            agent=_fixed(agents),
            step=step,
            round=1,
            elapsed=step * _DT,
            message=_fixed(message),
            past=_fixed(message - 1.0),
            displaced=_displaced,
        )
        with only_reading("sent()"):
            told = fault.sent(sent, index)
        _refuse(flaw_of_sent(told, message, message))
        found.append(("sent", told))
    return found
