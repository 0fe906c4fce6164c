"""Which keys of a log are played, and what they are called."""

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.tools.playlist import Selection
from zenoh_cbef.protocol.keys import matches

PARTS = st.sampled_from(["a", "b", "ab", "a.b"])
KEYS = st.lists(PARTS, min_size=1, max_size=4).map("/".join)
EXPRESSIONS = st.lists(st.one_of(PARTS, st.sampled_from(["*", "**", "a$*", "$*b"])), min_size=1, max_size=4)


@given(EXPRESSIONS, KEYS)
def test_key_expressions_stand_for_the_keys_that_they_stand_for_in_zenoh(parts, key):
    expression = zenoh.KeyExpr.autocanonize("/".join(parts))
    assert matches(str(expression), key) == expression.includes(zenoh.KeyExpr(key))


def test_what_is_left_out_is_stronger_than_what_is_taken():
    one = Selection(topics=["cbef/*/agent/**"], exclude=["**/round"], regex=["truth$"], exclude_regex=["agent/[3-5]/"])
    taken = ["agent/0/estimate", "agent/0/round", "agent/3/estimate", "target/truth", "event"]
    assert [one.takes(f"cbef/x/{key}") for key in taken] == [True, False, False, True, False]


def test_the_first_rule_that_fits_whole_parts_of_a_key_renames_it():
    one = Selection(remap=["cbef/x/agent/1:=lab/one", "cbef/x:=cbef/y"])
    names = {"cbef/x/agent/1/round": "lab/one/round", "cbef/x/agent/12/round": "cbef/y/agent/12/round"}
    names |= {"cbef/x": "cbef/y", "cbef/xx/event": "cbef/xx/event"}
    assert {key: one.renamed(key) for key in names} == names


@pytest.mark.parametrize("rule", [{"remap": ["a=b"]}, {"remap": [":=b"]}, {"regex": ["("]}, {"exclude_regex": ["["]}])
def test_a_rule_that_is_none_is_refused(rule):
    with pytest.raises(UserError, match=r"OLD:=NEW|regular expression"):
        Selection(**rule)
