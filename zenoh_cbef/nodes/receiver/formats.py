"""The formats of receivers: a format is a class as in linktrack.py, and a line of FORMATS; of lines see lines.py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from zenoh_cbef.nodes.receiver.lines import FORMS, Lines
from zenoh_cbef.nodes.receiver.linktrack import LinkTrack
from zenoh_cbef.nodes.receiver.mavlink import MavLink
from zenoh_cbef.nodes.receiver.ranged import Reader

FORMATS: Mapping[str, Callable[[], Reader]] = {
    **{form: partial(Lines, form) for form in ("auto", *FORMS)},
    "linktrack": LinkTrack,
    "mavlink": MavLink,
}
