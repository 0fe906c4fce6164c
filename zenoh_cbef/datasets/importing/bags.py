"""ROS 1 and ROS 2 bags (.bag, .db3, .mcap) by rosbags, which needs no ROS."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from zenoh_cbef.datasets.importing.raw import Raw
from zenoh_cbef.datasets.importing.units import LENGTHS, TIMES, Units
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.words import meant

SUFFIXES = (".bag", ".db3", ".mcap")

RANGES: Mapping[str, Mapping[str, str]] = {
    "sensor_msgs/msg/Range": {"t": "header.stamp", "anchor": "header.frame_id", "range": "range"},
    "px4_msgs/msg/SensorUwb": {"t": "timestamp|us", "anchor": "mac_dest", "range": "distance"},
}
"""The fields of messages that are ranges, by type; `|us` is the unit of a number."""

POSITIONS: Mapping[str, str] = {
    "geometry_msgs/msg/PointStamped": "point",
    "geometry_msgs/msg/PoseStamped": "pose.position",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose.position",
    "geometry_msgs/msg/TransformStamped": "transform.translation",
    "nav_msgs/msg/Odometry": "pose.pose.position",
}
"""The field with the position, by type of message."""


class _Connection(Protocol):
    topic: str
    msgtype: str


class _Typestore(Protocol):
    fielddefs: dict[str, object]

    def register(self, types: object) -> None:
        """Make types known."""


@dataclass
class Bags:
    """One import. mapped: fields by meaning, for types of the user's own. topics: of ranges; all if empty.

    truth: topic of the target's true positions. types: files with definitions (.msg) that a bag lacks.
    """

    mapped: Mapping[str, str]
    units: Units
    topics: Sequence[str] = ()
    truth: str | None = None
    types: Sequence[Path] = ()

    def read(self, path: Path) -> Raw:
        """Everything that a bag holds of ranges and truth. Raises UserError where it cannot be read."""
        highlevel = from_extra("rosbags.highlevel", "a ROS bag")
        raw, seen = Raw(), Counter[str]()
        try:
            with highlevel.AnyReader([path], default_typestore=_typestore()) as reader:
                self._refuse_unknown(path, {one.topic for one in reader.connections})
                chosen = [one for one in reader.connections if self._wanted(one)]
                seen.update(one.msgtype for one in reader.connections)
                self._define(reader.typestore, seen, {one.msgtype for one in chosen})
                for connection, logged, data in reader.messages(connections=chosen) if chosen else ():
                    self._take(raw, connection, logged, reader.deserialize(data, connection.msgtype))
                if not raw.truth:
                    could = sorted({one.topic for one in reader.connections if one.msgtype in POSITIONS})
                    raw.notes += [f"{topic} could be the truth: --truth {topic}" for topic in could[:3]]
        except UserError:
            raise
        except Exception as error:  # noqa: BLE001 - rosbags raises errors of many kinds where a bag is damaged
            raise UserError(f"cannot read {path} as a ROS bag: {error}; is it complete?") from None
        if not raw.ranges:
            kinds = ", ".join(sorted(seen)) or "nothing"
            raise UserError(
                f"{path} has no range that is known; its messages are {kinds}; for your own type say --topic TOPIC "
                "--map anchor=FIELD --map range=FIELD"
            )
        return raw

    def _refuse_unknown(self, path: Path, there: Collection[str]) -> None:
        """Raise UserError for a topic that the user names and a bag lacks. there: those that it has."""
        named = [*(("--topic", one) for one in self.topics), *([("--truth", self.truth)] if self.truth else [])]
        for option, topic in named:
            if topic not in there:
                near = meant(topic, sorted(there), f"its topics are {', '.join(sorted(there)) or 'none'}")
                raise UserError(f"{option} {topic}: {path} has no such topic; {near}")

    def _define(self, store: _Typestore, seen: Iterable[str], needed: Iterable[str]) -> None:
        """Make the types of files known. seen: all names of a bag's types; needed: those that are read."""
        typesys = from_extra("rosbags.typesys", "a ROS bag")
        for path in self.types:
            package = path.parent.parent.name if path.parent.name == "msg" else path.parent.name
            names = [name for name in seen if name.endswith(f"/{path.stem}")] or [f"{package}/msg/{path.stem}"]
            try:
                text = path.read_text(encoding="utf-8")
                for name in names:
                    if name not in store.fielddefs:
                        store.register(typesys.get_types_from_msg(text, name))
            except OSError as error:
                raise UserError(f"cannot read --types {path}: {error.strerror}; name a .msg file") from None
            except (ValueError, typesys.TypesysError):
                raise UserError(f"--types {path} defines no message; name a .msg file") from None
        if lacking := sorted(set(needed) - store.fielddefs.keys()):
            one = lacking[0]
            file = one.replace("/msg/", "/").rpartition("/")
            raise UserError(
                f"the bag does not define {one}; name a file that does, as in --types {file[0]}/msg/{file[2]}.msg"
            )

    def _fields(self, connection: _Connection) -> Mapping[str, str]:
        return {**RANGES.get(connection.msgtype, {}), **self.mapped}

    def _wanted(self, connection: _Connection) -> bool:
        if connection.topic == self.truth:
            return True
        named = connection.topic in self.topics if self.topics else connection.msgtype in RANGES
        return named and "range" in self._fields(connection)

    def _take(self, raw: Raw, connection: _Connection, logged: int, message: object) -> None:
        if connection.topic == self.truth:
            place = _field(message, POSITIONS.get(connection.msgtype, "position"))
            x, y, z = (float(str(_field(place, axis))) for axis in "xyz")
            raw.truth.append((_seconds(message, None, logged), (x, y, z)))
            return
        fields = self._fields(connection)
        scale = float(self.units.length("ranges", "range", fields["range"].replace(".", "_")))
        name = str(_field(message, fields["anchor"]) if "anchor" in fields else "").strip().replace(",", "_")
        value = _field(message, fields["range"].partition("|")[0])
        told = fields["range"].partition("|")[2]
        distance = float(str(value)) * (float(LENGTHS[told]) if told in LENGTHS else scale)
        time = _seconds(message, fields.get("t"), logged)
        raw.ranges.append((time, name or connection.topic.strip("/").rpartition("/")[2], distance))


def _typestore() -> object:
    """The types of ROS, as up to Humble, for bags without definitions: later ones bring theirs."""
    typesys = from_extra("rosbags.typesys", "a ROS bag")
    store: object = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    return store


def _field(message: object, path: str) -> object:
    for part in path.split("."):
        if not hasattr(message, part):
            raise UserError(f"the messages have no field {path}; name one with --map")
        message = getattr(message, part)
    return message


def _seconds(message: object, path: str | None, logged: int) -> float:
    """A message's own time, s: a stamp, or a number with its unit; without one or if it is 0, when it was logged.

    path: the field; None: the stamp of the header, if there is one. Raises UserError where there is no such field.
    """
    if path is None and not hasattr(message, "header"):
        return 1e-9 * logged
    path, _, unit = (path or "header.stamp").partition("|")
    value = _field(message, path)
    if hasattr(value, "sec") and hasattr(value, "nanosec"):
        value = (value.sec * 10**9 + value.nanosec) * 1e-9
    else:
        value = float(str(value)) * float(TIMES.get(unit or "s", "1"))
    return value or 1e-9 * logged


def bag_in(source: Path) -> bool:
    """Whether a path is a bag, or the folder of a ROS 2 bag."""
    return source.suffix in SUFFIXES or (source / "metadata.yaml").is_file()


def bags_in(folder: Path) -> list[Path]:
    """The bags that lie in a folder which is none itself."""
    return sorted(one for one in folder.iterdir() if one.suffix in SUFFIXES)


def bag_of(source: Path) -> Path:
    """The bag that a path means: a database beside a metadata.yaml is part of its folder's."""
    return source.parent if source.suffix == ".db3" and (source.parent / "metadata.yaml").is_file() else source
