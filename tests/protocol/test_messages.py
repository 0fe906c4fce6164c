"""Messages are read back as written, and anything else is refused with one kind of error."""

from __future__ import annotations

import math

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import examples
from tests.protocol.made import RUN, SENDER, read_or_refused, written
from zenoh_cbef.protocol.fields import FARTHEST
from zenoh_cbef.protocol.kinds import MESSAGE_KINDS
from zenoh_cbef.protocol.messages import (
    VERSION,
    BadMessage,
    decode,
    json_schema,
    pack_floats,
    peek,
)
from zenoh_cbef.tracking.diagnostics import NAMES
from zenoh_cbef.tracking.moderation import LARGEST_SENT

COUNTS = st.integers(0, 2**63 - 1)


NUMBERS = st.floats(-FARTHEST, FARTHEST)


NUMBERS_OR_NIL = st.one_of(st.none(), NUMBERS)


MOMENTS = st.floats(0.0, 9e9)


TEXTS = st.text(st.characters(exclude_categories=["Cc", "Cs"]), max_size=30)


PAYLOADS = st.lists(st.floats(-LARGEST_SENT, LARGEST_SENT), max_size=30).map(lambda one: pack_floats(np.array(one)))


DOUBLES = st.lists(NUMBERS, max_size=30).map(lambda values: pack_floats(np.array(values, dtype=float)))


SMALL = st.integers(0, (1 << 40) - 1)


def numbers(size):
    return st.lists(NUMBERS, min_size=size, max_size=size)


BODY = {
    "truth": st.fixed_dictionaries({"k": COUNTS, "state": numbers(6)}),
    "beacon": st.fixed_dictionaries(
        {"k": COUNTS, "emitted": NUMBERS_OR_NIL, "arrived": NUMBERS_OR_NIL},
        optional={"signal": st.sampled_from(["start", "end"]), "at": MOMENTS, "by_rounds": st.booleans()},
    ),
    "signal": st.fixed_dictionaries(
        {"k": COUNTS, "signal": st.sampled_from(["start", "end", "round"])}, optional={"at": MOMENTS, "l": COUNTS}
    ),
    "range": st.fixed_dictionaries({"k": COUNTS, "position": numbers(3), "range": NUMBERS_OR_NIL}),
    "round": st.fixed_dictionaries({"k": COUNTS, "l": COUNTS, "payload": PAYLOADS}),
    "estimate": st.fixed_dictionaries(
        {
            "k": COUNTS,
            "state": numbers(6),
            "innovation": NUMBERS_OR_NIL,
            "weight": NUMBERS_OR_NIL,
            **{name: st.lists(SMALL, max_size=5) for name in ("neighbours", "received", "lost", "late")},
            "latency": st.lists(NUMBERS_OR_NIL, max_size=5),
            "covariance": st.one_of(st.none(), DOUBLES),
        },
        optional=dict.fromkeys({*NAMES} - {"innovation", "weight", "nis_degrees"}, NUMBERS_OR_NIL)
        | {"nis_degrees": COUNTS},
    ),
    "smoothed": st.fixed_dictionaries(
        {
            "k": COUNTS,
            "until": SMALL,
            "state": numbers(6),
            "covariance": numbers(36).map(lambda values: pack_floats(np.array(values))),
        }
    ),
    "faults": st.fixed_dictionaries({"tables": TEXTS}),
    "event": st.fixed_dictionaries(
        {"kind": TEXTS, "text": TEXTS}, optional={"data": st.dictionaries(TEXTS, st.one_of(COUNTS, TEXTS))}
    ),
}


ANY_KIND = st.sampled_from(sorted(MESSAGE_KINDS))


MESSAGES = ANY_KIND.flatmap(lambda kind: st.tuples(st.just(kind), BODY[kind]))


ANYTHING = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(2**63), 2**64 - 1),
        st.floats(),
        st.text(max_size=5),
        st.binary(max_size=17),
        st.builds(msgpack.ExtType, st.integers(0, 127), st.binary(max_size=4)),
        st.just(msgpack.Timestamp(1, 2)),
    ),
    lambda inner: st.one_of(st.lists(inner, max_size=7), st.dictionaries(st.text(max_size=5), inner, max_size=3)),
    max_leaves=10,
)


def test_every_kind_has_its_strategy():
    assert BODY.keys() == MESSAGE_KINDS.keys()


@settings(deadline=None)
@given(MESSAGES, st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1))
def test_a_message_is_read_back_as_it_was_written(message, seq, sent):
    kind, body = message
    data = written(body, seq=seq, sent=sent)
    expected = {"v": VERSION, "run": RUN, "from": SENDER, "seq": seq, "sent": sent, **body}
    assert decode(MESSAGE_KINDS[kind], data, run=RUN, sender=SENDER) == expected
    assert decode(MESSAGE_KINDS[kind], data, run=RUN) == expected
    if "k" in body:
        assert peek(MESSAGE_KINDS[kind], data, run=RUN, sender=SENDER) == body["k"]


@examples(100)
@given(MESSAGES, st.data())
def test_flipped_cut_or_extended_bytes_are_read_soundly_or_refused(message, data):
    kind, body = message
    mutated = bytearray(written(body))
    how = data.draw(st.sampled_from(["flip", "cut", "extend", "insert", "several"]))
    place = data.draw(st.integers(0, len(mutated) - 1))
    if how == "cut":
        mutated = mutated[:place]
    elif how == "extend":
        mutated += data.draw(st.binary(min_size=1, max_size=20))
    elif how == "insert":
        mutated[place:place] = data.draw(st.binary(min_size=1, max_size=5))
    else:
        for _ in range(1 if how == "flip" else 5):
            mutated[data.draw(st.integers(0, len(mutated) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    result = read_or_refused(kind, bytes(mutated))
    if how in {"cut", "extend"}:
        assert result is None


@settings(deadline=None)
@given(ANY_KIND, st.binary(max_size=100))
def test_noise_is_refused(kind, data):
    assert read_or_refused(kind, data) is None


@examples(100)
@given(MESSAGES, st.data())
def test_a_field_of_any_other_value_is_read_soundly_or_refused(message, data):
    kind, body = message
    fields = msgpack.unpackb(written(body))
    name = data.draw(st.sampled_from(sorted(fields)))
    fields[name] = data.draw(ANYTHING)
    result = read_or_refused(kind, msgpack.packb(fields))
    if result is not None and name != "data":
        assert type(result[name]) is type(fields[name])


@settings(deadline=None)
@given(MESSAGES, st.data())
def test_an_extra_or_missing_field_is_refused(message, data):
    kind, body = message
    fields = msgpack.unpackb(written(body))
    name = data.draw(st.sampled_from(sorted(fields)))
    less = {key: value for key, value in fields.items() if key != name}
    result = read_or_refused(kind, msgpack.packb(less))
    field = MESSAGE_KINDS[kind].fields.get(name)
    assert (result is not None) == (field is not None and field.optional)
    assert read_or_refused(kind, msgpack.packb({**fields, "extra": 1})) is None
    assert read_or_refused(kind, msgpack.packb({**fields, b"k": 1})) is None
    assert read_or_refused(kind, msgpack.packb({**fields, 7: 1}, strict_types=False)) is None


@settings(deadline=None)
@given(ANY_KIND, ANYTHING)
def test_what_is_no_map_is_refused(kind, value):
    assert read_or_refused(kind, msgpack.packb(value)) is None


@settings(deadline=None)
@given(MESSAGES.filter(lambda message: "k" in message[1]), st.data())
def test_a_glance_at_the_step_refuses_what_is_not_from_its_sender(message, data):
    kind, body = message
    fields = {**msgpack.unpackb(written(body))}
    name = data.draw(st.sampled_from(["run", "from", "v", "k"]))
    fields[name] = data.draw(st.sampled_from(["other", -1, None, [1], {"a": 1}, math.nan]))
    with pytest.raises(BadMessage):
        peek(MESSAGE_KINDS[kind], msgpack.packb(fields), run=RUN, sender=SENDER)


@pytest.mark.parametrize("kind", sorted(MESSAGE_KINDS))
def test_schemas_describe_every_field(kind):
    schema = json_schema(MESSAGE_KINDS[kind])
    assert schema["properties"].keys() == {"v", "run", "from", "seq", "sent", *MESSAGE_KINDS[kind].fields}
    optional = {name for name, field in MESSAGE_KINDS[kind].fields.items() if field.optional}
    assert set(schema["required"]) == schema["properties"].keys() - optional
