"""What the server answers to one page: frames as fast as the page asks, orders, and what there is to open."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from zenoh_cbef.analysis.faulted import faults_of
from zenoh_cbef.errors import UserError
from zenoh_cbef.lab.bench import Bench
from zenoh_cbef.lab.judged import judged
from zenoh_cbef.lab.scene import Arrays, Scene
from zenoh_cbef.lab.sources import LIVE, Source
from zenoh_cbef.lab.under_way import under_way
from zenoh_cbef.log.read.recording import Event
from zenoh_cbef.pages.packing import framed
from zenoh_cbef.plain import Json

_TRAIL_POINTS = 32
_MOST_TRAIL = 2000
_MOST_EVENTS = 500

Asked = Mapping[str, Json]


class Page:
    """One open page. What it asks is a JSON table with `ask`; what it is answered is bytes: see `framed`."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._orders: dict[str, Callable[[Asked], dict[str, object]]] = {
            "what": lambda _: bench.offered(),
            "open": lambda asked: bench.open_log(_text(asked, "log")),
            "join": lambda asked: bench.join(_text(asked, "run")),
            "start": lambda asked: bench.start(_text(asked, "scenario"), _texts(asked, "set")),
            "fault": self._fault,
            "undo": lambda _: bench.undo(),
            "clear": lambda asked: bench.clear(_number(asked, "number")),
            "stop": lambda _: bench.stop(),
            "hold": self._hold,
        }

    def answer(self, asked: Asked) -> bytes:
        """Answer one question. A mistake of the user is answered with its sentence as `error`."""
        what = asked.get("ask")
        try:
            if what == "frame":
                return self._frame(asked)
            if what == "scene":
                return self._scene()
            return framed({"answer": what, **self.order(asked)})
        except UserError as error:
            return framed({"answer": what, "error": str(error)})

    def order(self, asked: Asked) -> dict[str, object]:
        """Carry out an order. Raises UserError."""
        what = asked.get("ask")
        order = self._orders.get(what if isinstance(what, str) else "")
        if order is None:
            raise UserError(f"the lab does not know what {what!r:.40} is; load the page again")
        return order(asked)

    def answered(self, asked: Asked) -> None:
        """Called when an answer is on its way."""
        if asked.get("ask") == "frame":
            for source in (self._bench.source, self._bench.beside):
                if source is not None:
                    source.shown.set()

    def waits(self, asked: Asked) -> bool:
        """Whether a page asks for a frame newer than there is."""
        source = self._bench.source
        newer = asked.get("after")
        if asked.get("ask") != "frame" or source is None or not isinstance(newer, int) or source.state not in LIVE:
            return False
        if "under" in asked:  # which round of the step after the newest is shown, the page knows alone
            return False
        with source.lock:
            return source.scene.newest <= newer

    def _fault(self, asked: Asked) -> dict[str, object]:
        table, seconds = asked.get("table"), asked.get("seconds")
        if not isinstance(table, dict):
            raise UserError("the fault is no table; load the page again")
        return self._bench.inject(table, float(seconds) if isinstance(seconds, int | float) else None)

    def _hold(self, asked: Asked) -> dict[str, object]:
        steps, rounds = (_number({name: 0, **asked}, name) for name in ("steps", "rounds"))
        return self._bench.hold(on=asked.get("on") is True, steps=steps, rounds=rounds)

    def _source(self) -> Source:
        source = self._bench.source
        if source is None:
            raise UserError("nothing is open; choose a scenario, a run or a log")
        return source

    def _scene(self) -> bytes:
        source = self._source()
        with source.lock:
            scene = source.scene
            told = {"answer": "scene", **scene.described(), "live": source.live, "number": self._bench.number}
            told |= {"newest": scene.newest, "state": source.state}
        if (other := self._bench.beside) is not None:
            with other.lock:
                told["beside"] = other.scene.described() | {"newest": other.scene.newest}
        return framed(told)

    def _frame(self, asked: Asked) -> bytes:
        """A step's frame, with the curves that the page lacks, and with trails where it asks for them."""
        source = self._source()
        with source.lock:
            scene = source.scene
            newest = scene.newest
            step = _within(asked.get("step"), 1, newest)
            arrays, told = _moment(scene, step, asked.get("curves"))
            if isinstance(trail := asked.get("trail"), int):
                found = scene.trail(step, _within(trail, 1, _MOST_TRAIL), _TRAIL_POINTS)
                arrays |= {f"trail {name}": values for name, values in found.items()}
            told |= {"answer": "frame", "number": self._bench.number, "newest": newest, "state": source.state}
            told["events"] = _events(scene.recording.events, asked.get("events"), scene.plan.scenario.dt)
            if asked.get("marks") is True:
                told["marks"] = scene.marks(step)
            if (round_ := _between(asked.get("under"), newest)) is not None:
                found, told["marks"] = under_way(scene, newest + 1, round_)
                arrays |= found
                told["under"] = round_
        if self._bench.beside is not None:
            told["beside"] = _beside(self._bench.beside, step * source.scene.plan.scenario.dt, asked, arrays)
        return framed(told, arrays)


def _between(asked: object, newest: int) -> int | None:
    """The round after which the step after the newest stands, where a page asks for that and it is not over."""
    step, round_ = asked if isinstance(asked, list) and len(asked) == 2 else (None, None)
    return round_ if step == newest + 1 and isinstance(round_, int) and round_ >= 0 else None


def _beside(other: Source, time: float, asked: Asked, arrays: Arrays) -> dict[str, object]:
    """The same moment (s) of the run that is shown beside; its numbers are added to the arrays, as "beside ..."."""
    with other.lock:
        scene = other.scene
        step = _within(round(time / scene.plan.scenario.dt), 1, scene.newest)
        found, told = _moment(scene, step, asked.get("beside"))
        arrays |= {f"beside {name}": values for name, values in found.items()}
        return told


def _moment(scene: Scene, step: int, known: object) -> tuple[Arrays, dict[str, object]]:
    """The numbers of a step, with the curves that a page lacks which knows so many steps of them, and what to tell."""
    since = _within(known, 0, scene.newest)
    curves = {f"curve {name}": values for name, values in scene.curves(since, scene.newest).items()}
    told = {"step": step, "verdict": list(judged(scene, step)), "faults": faults_of(scene.plan.scenario)}
    return scene.frame(step) | curves, told | {"curves": [since, scene.newest]}


def _within(asked: object, least: int, most: int) -> int:
    """A number that a page asks for, within limits; the largest where it asks for none."""
    return min(max(asked, least), most) if isinstance(asked, int) else most


def _events(events: list[Event], known: object, dt: float) -> list[dict[str, object]]:
    """The events that the page lacks, with their step where they say one."""
    fresh = events[known if isinstance(known, int) and known >= 0 else 0 :][:_MOST_EVENTS]
    told: list[dict[str, object]] = []
    for one in fresh:
        step = one.message.get("data", {}).get("step")
        time = step * dt if isinstance(step, int) else None
        told.append(
            {"from": one.message["from"], "kind": one.message["kind"], "text": one.message["text"], "time": time}
        )
    return told


def _text(asked: Asked, name: str) -> str:
    value = asked.get(name)
    if not isinstance(value, str) or not value:
        raise UserError(f"the order lacks {name}; load the page again")
    return value


def _texts(asked: Asked, name: str) -> list[str]:
    value = asked.get(name)
    return [one for one in value if isinstance(one, str)] if isinstance(value, list) else []


def _number(asked: Asked, name: str) -> int:
    value = asked.get(name)
    if not isinstance(value, int) or isinstance(value, bool):
        raise UserError(f"the order lacks {name}; load the page again")
    return value
