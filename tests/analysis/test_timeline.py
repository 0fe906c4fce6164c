"""The space-time picture: valid, complete, and drawn where times and nodes are."""

import re
from collections import Counter
from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.analysis.timeline import timeline_html, timeline_svg
from zenoh_cbef.trace import Exchange, Fortune, Passage

SVG = "{http://www.w3.org/2000/svg}"
CLASSES = {
    "in time": "time",
    "duplicated": "twice",
    "late": "late",
    "lost": "lost",
    "damaged": "damaged",
    "missed": "missed",
    "unheard": "unheard",
}


def exchange(passages: list[Passage], agents: int = 3) -> Exchange:
    return Exchange(
        name="a run",
        labels=tuple(str(agent) for agent in range(agents)),
        dt=0.1,
        since=1.0,
        until=2.0,
        passages=passages,
        rounds=[(4, 0, 1.0), (4, 1, 1.1), (4, 2, 1.3), (5, 0, 1.6), (5, 1, 1.7)],
        estimates=[(0, 4, 1.5), (1, 4, 1.55)],
        events=[("agent/1", 1.4, "agent 1 said <something>")],
        notes=[],
    )


def arrows(text: str) -> list[tuple[str, str, list[float]]]:
    """Class, hover title, and ends x0 y0 x1 y1 of every message drawn."""
    found = []
    for group in ET.fromstring(text.split("?>", 1)[1]).iter(f"{SVG}g"):
        title = group.find(f"{SVG}title")
        if title is not None:
            path = group.find(f"{SVG}path[@class='near']")
            assert path is not None
            ends = [float(one) for one in re.findall(r"-?[\d.]+", path.attrib["d"])]
            found.append((group.attrib["class"], str(title.text), ends))
    return found


def line_of(text: str, name: str) -> float:
    """The height of a node's line, from its name beside it."""
    sides = [one for one in ET.fromstring(text.split("?>", 1)[1]).iter(f"{SVG}text") if one.get("class") == "side"]
    return next(float(one.attrib["y"]) for one in sides if one.text == name) - 4.0


passages = st.builds(
    Passage,
    source=st.one_of(st.none(), st.integers(0, 2)),
    destination=st.integers(0, 2),
    step=st.integers(1, 10**6),
    round=st.integers(0, 100),
    sent=st.floats(0.0, 3.0),
    ended=st.floats(0.0, allow_nan=False, allow_infinity=True),
    fortune=st.sampled_from(list(CLASSES)),
)


@given(st.lists(passages, max_size=20))
def test_every_message_is_drawn_once_with_its_class_in_valid_xml(drawn):
    text = timeline_svg(exchange(drawn))
    assert Counter(kind for kind, _, _ in arrows(text)) == Counter(CLASSES[one.fortune] for one in drawn)
    assert not re.search(r"\b(nan|inf)\b", text)


def one(fortune: Fortune) -> tuple[str, list[float]]:
    text = timeline_svg(exchange([Passage(0, 2, 4, 1, 1.2, 1.4, fortune)]))
    [(_, told, ends)] = arrows(text)
    assert told.startswith("agent 0 → agent 2, step 4, round 1: ")
    assert ends[1] == pytest.approx(line_of(text, "agent 0"), abs=0.1)
    return text, ends


def test_what_arrives_reaches_its_receivers_line_and_what_is_lost_does_not():
    for fortune in ("in time", "late", "duplicated", "damaged", "missed"):
        text, (x0, _, x1, y1) = one(fortune)
        assert y1 == pytest.approx(line_of(text, "agent 2"), abs=0.1)
        assert x1 > x0
    text, (_, y0, _, y1) = one("lost")
    assert y0 < y1 < line_of(text, "agent 2") - 10.0


def test_times_are_to_scale():
    sent = (1.1, 1.2, 1.9)
    drawn = arrows(timeline_svg(exchange([Passage(1, 0, 4, 1, when, when + 0.05, "in time") for when in sent])))
    first, second, third = (ends[0] for _, _, ends in drawn)
    assert (third - first) / (second - first) == pytest.approx(8.0, rel=0.01)


def test_names_are_escaped_and_the_page_fetches_nothing():
    hostile = replace(exchange([Passage(0, 1, 4, 1, 1.2, 1.4, "lost")]), name="<a&b>", labels=("<x>", "y&z", '"'))
    for title in (arrows(timeline_svg(hostile))[0][1],):
        assert title.startswith("agent <x> → agent y&z")
    page = timeline_html(hostile)
    assert "<a&b>" not in page
    assert "<x>" not in page
    assert "said &lt;something&gt;" in page
    assert not re.search(r"(src|href)=", page)
    ET.fromstring(page[page.index("<svg") : page.index("</svg>") + 6])


def test_events_have_the_times_of_the_axis_not_of_the_picture():
    page = timeline_html(exchange([]))
    assert "<td>1.4000 s</td>" in page
    assert "Times since the start" in page
