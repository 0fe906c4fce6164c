"""What the processes of a run reported, as a table: time, words, and numbers with their units."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime

from zenoh_cbef.numbers import number, written
from zenoh_cbef.pages.parts import NOTHING, Table
from zenoh_cbef.trace import Trace, began

_MOST_ROWS = 200
_ENVELOPE = ("v", "run", "seq", "sent", "from", "kind", "text", "data")
_SHOWN = 400
_UNITS = {"clock": (1e3, "ms"), "round_trip": (1e3, "ms"), "late": (1e3, "ms"), "seconds": (1.0, "s")}
_DAY = 86_400.0


def events_table(trace: Trace) -> Table | None:
    """The events in order; None where there are none."""
    events = trace.events
    if not events:
        return None
    start = began(events)
    rows = [_row(event, start) for event in events[:_MOST_ROWS]]
    caption = "What the processes reported, in order, s after the start by their clocks"
    if len(events) > _MOST_ROWS:
        caption += f"; the first {_MOST_ROWS} of {len(events)}"
    return Table(caption, ["time (s)", "from", "kind", "text", "data"], rows)


def _row(event: Mapping[str, object], start: float | None) -> list[str]:
    data = event.get("data")
    rest = {key: value for key, value in event.items() if key not in _ENVELOPE}
    rest |= data if isinstance(data, Mapping) else {}
    details = ", ".join(f"{key.replace('_', ' ')} = {_value(key, value)}" for key, value in rest.items())
    words = [str(event.get(key, NOTHING)) for key in ("from", "kind", "text")]
    return [_when(event, start), *words, details[:_SHOWN]]


def _when(event: Mapping[str, object], start: float | None) -> str:
    sent = event.get("sent")
    return f"{1e-9 * sent - start:.3f}" if isinstance(sent, int) and start is not None else NOTHING


def _value(key: str, value: object) -> str:
    """A value with its unit. Moments since the epoch are dates; numbers of messages by key are their sum."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if key == "at" and isinstance(value, float) and value > _DAY:
        return f"{datetime.fromtimestamp(value, UTC):%Y-%m-%d %H:%M:%S} UTC"
    if key in _UNITS and isinstance(value, int | float):
        factor, unit = _UNITS[key]
        return number(factor * value, unit)
    if key == "sent" and isinstance(value, Mapping):
        counts = [one for one in value.values() if isinstance(one, int)]
        return f"{sum(counts)} messages"
    return written(value)
