"""A run for Foxglove, Lichtblick and Rerun: an MCAP file of the schemas that these draw.

The schemas are those of foxglove (https://docs.foxglove.dev/docs/sdk/schemas), and two of plain numbers for plots.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import ClassVar, Protocol

import numpy as np

from zenoh_cbef import __version__
from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.viewers.scene import Scene, SceneEvent

Colour = tuple[float, float, float, float]


class _Described(Protocol):
    full_name: str


class Protobuf(Protocol):
    """A message of protobuf, whose classes are made when their schemas are read."""

    DESCRIPTOR: ClassVar[_Described]

    def SerializeToString(self) -> bytes:  # noqa: N802 - protobuf's name
        """Its bytes."""


Message = tuple[str, Protobuf]

TRAIL = 50
"""Steps that a path shows."""

TRUTH: Colour = (1.0, 1.0, 1.0, 1.0)
_WHOLE, _BROKEN = np.array([0.2, 0.7, 0.3, 0.9]), np.array([0.9, 0.15, 0.1, 0.9])
_UNKNOWN = np.array([0.6, 0.6, 0.6, 0.5])
WARNINGS = ("rejected", "silent", "crashed", "left", "unobservable")


def agent_colour(agent: int, alpha: float = 1.0) -> Colour:
    """One of eight colours that colour-blind readers can tell apart (Okabe and Ito, with grey in place of black)."""
    palette = ("0072B2", "D55E00", "009E73", "CC79A7", "56B4E9", "E69F00", "999999", "F0E442")
    code = palette[agent % len(palette)]
    red, green, blue = (int(code[place : place + 2], 16) / 255.0 for place in (0, 2, 4))
    return red, green, blue, alpha


def health_colour(delivered: float) -> Floats:
    """From green, all messages came in time, to red, none did; grey where that is unknown. (4,), from 0 to 1."""
    return _WHOLE + (1.0 - delivered) * (_BROKEN - _WHOLE) if isfinite(delivered) else _UNKNOWN


def _library(module: str) -> ModuleType:
    return from_extra(module, "the export for viewers")


def write_viz(scene: Scene, output: Path) -> list[Path]:
    """Write the file, and a layout for it beside; returns both. Raises UserError where they cannot be written."""
    builder = _Builder(scene)
    layout = output.with_name(f"{output.stem}-layout.json")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        with McapWriter(output, library=f"zenoh-cbef {__version__}") as writer:
            writer.add_metadata("cbef.viz", {"run": scene.trace.name, "version": __version__})
            _write(builder, writer)
        layout.write_text(
            (files("zenoh_cbef.viewers") / "viz-layout.json").read_text(encoding="utf-8"), encoding="utf-8"
        )
    except OSError as error:
        raise UserError(f"cannot write {output}: {error.strerror}; choose another --output") from None
    return [output, layout]


def _write(builder: _Builder, writer: McapWriter) -> None:
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for sequence, (time, topic, message) in enumerate(builder.messages()):
        if topic not in channels:
            kind = type(message)
            name = kind.DESCRIPTOR.full_name
            if name not in schemas:
                schemas[name] = writer.register_schema(name, "protobuf", builder.schema_of(kind).SerializeToString())
            channels[topic] = writer.register_channel(topic, "protobuf", schemas[name])
        writer.add_message(channels[topic], time, time, sequence, message.SerializeToString())


class _Builder:
    """Makes the messages of a scene, step after step. Raises MissingExtra without the packages of the extra."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self._trace = scene, scene.trace
        self._classes: dict[str, Callable[..., Protobuf]] = {}
        for name in (
            *("FrameTransform", "FrameTransforms", "PointCloud", "PackedElementField", "PosesInFrame", "Pose"),
            *("SceneUpdate", "SceneEntity", "SpherePrimitive", "CubePrimitive", "LinePrimitive", "TextPrimitive"),
            *("Color", "Point3", "Vector3", "Quaternion", "Log"),
        ):
            self._classes[name] = getattr(_library(f"foxglove_schemas_protobuf.{name}_pb2"), name)
        self.schema_of = _library("mcap_protobuf.schema").build_file_descriptor_set
        self._stamp = _library("google.protobuf.timestamp_pb2").Timestamp
        self._network = scene.metrics()
        self._agents = [scene.agent_metrics(agent) for agent in range(len(scene.trace.positions))]
        self._numbers = {
            "NetworkMetrics": _numbers_class("NetworkMetrics", list(self._network)),
            "AgentMetrics": _numbers_class("AgentMetrics", list(self._agents[0])),
        }

    def _new(self, name: str, /, **fields: object) -> Protobuf:
        return self._classes[name](**fields)

    def messages(self) -> Iterator[tuple[int, str, Protobuf]]:
        """Time (ns), topic and message, by time."""
        events = sorted(self._scene.events, key=lambda event: event.time)
        for row, time in enumerate(self._scene.time.tolist()):
            while events and events[0].time <= time:
                yield self._event(events.pop(0))
            stamp = self._stamp(seconds=time // 10**9, nanos=time % 10**9)
            for topic, message in self._step(row, stamp):
                yield time, topic, message
        yield from map(self._event, events)

    def _event(self, event: SceneEvent) -> tuple[int, str, Protobuf]:
        level = "WARNING" if event.kind in WARNINGS else "INFO"
        stamp = self._stamp(seconds=event.time // 10**9, nanos=event.time % 10**9)
        log = self._new("Log", timestamp=stamp, level=level, message=event.text, name=event.sender, file=event.kind)
        return event.time, "/log", log

    def _step(self, row: int, stamp: Protobuf) -> Iterator[Message]:
        trace = self._trace
        yield "/tf", self._transforms(row, stamp)
        agents = np.column_stack([trace.positions[:, row], np.arange(len(trace.positions)), trace.ranges[:, row]])
        yield "/agents", self._cloud(stamp, agents, ("x", "y", "z", "agent", "range"))
        errors = self._scene.analysis.position_error[:, row]
        told = np.column_stack([trace.estimates[:, row, :3], np.arange(len(errors)), errors])
        yield "/estimates", self._cloud(stamp, told, ("x", "y", "z", "agent", "error"))
        first = max(0, row + 1 - TRAIL)
        yield "/target/path", self._path(stamp, trace.truth[first : row + 1, :3])
        yield "/estimate/path", self._path(stamp, self._scene.estimate[first : row + 1])
        if self._scene.smoothed is not None:
            yield "/smoothed/path", self._path(stamp, self._scene.smoothed[first : row + 1])
        entities = [self._links(row, stamp), self._bodies(row, stamp), *self._uncertainty(row, stamp)]
        yield "/scene", self._new("SceneUpdate", entities=entities)
        network = {name: float(values[row]) for name, values in self._network.items()}
        yield "/metrics", self._numbers["NetworkMetrics"](step=row + 1, **network)
        for agent, metrics in enumerate(self._agents):
            numbers = {name: float(values[row]) for name, values in metrics.items()}
            yield f"/agent/{agent}/metrics", self._numbers["AgentMetrics"](step=row + 1, **numbers)

    def _transforms(self, row: int, stamp: Protobuf) -> Protobuf:
        trace = self._trace
        places = {"target": trace.truth[row, :3]}
        places |= {f"agent/{agent}": position for agent, position in enumerate(trace.positions[:, row])}
        places |= {f"agent/{agent}/estimate": state[:3] for agent, state in enumerate(trace.estimates[:, row])}
        transforms = [
            self._new(
                "FrameTransform",
                timestamp=stamp,
                parent_frame_id="world",
                child_frame_id=name,
                translation=self._new("Vector3", **_xyz(place)),
                rotation=self._new("Quaternion", w=1.0),
            )
            for name, place in places.items()
            if np.isfinite(place).all()
        ]
        return self._new("FrameTransforms", transforms=transforms)

    def _cloud(self, stamp: Protobuf, rows: Floats, names: Sequence[str]) -> Protobuf:
        rows = np.ascontiguousarray(rows[np.isfinite(rows[:, :3]).all(axis=1)], dtype="<f4")
        fields = [
            self._new("PackedElementField", name=name, offset=4 * place, type="FLOAT32")
            for place, name in enumerate(names)
        ]
        size = 4 * len(names)
        pose = self._pose(np.zeros(3))
        return self._new(
            "PointCloud",
            timestamp=stamp,
            frame_id="world",
            pose=pose,
            point_stride=size,
            fields=fields,
            data=rows.tobytes(),
        )

    def _path(self, stamp: Protobuf, places: Floats) -> Protobuf:
        poses = [self._pose(place) for place in places if np.isfinite(place).all()]
        return self._new("PosesInFrame", timestamp=stamp, frame_id="world", poses=poses)

    def _pose(self, place: Floats, orientation: Floats | None = None) -> Protobuf:
        x, y, z, w = (0.0, 0.0, 0.0, 1.0) if orientation is None else orientation.tolist()
        turn = self._new("Quaternion", x=x, y=y, z=z, w=w)
        return self._new("Pose", position=self._new("Vector3", **_xyz(place)), orientation=turn)

    def _colour(self, colour: Sequence[float] | Floats) -> Protobuf:
        red, green, blue, alpha = (float(part) for part in colour)
        return self._new("Color", r=red, g=green, b=blue, a=alpha)

    def _links(self, row: int, stamp: Protobuf) -> Protobuf:
        """One line per direction: each half, from its receiver to the middle, is of that receiver's colour."""
        points, colours = [], []
        for (source, destination), share in zip(self._scene.links.tolist(), self._scene.delivered[:, row], strict=True):
            here, there = self._trace.positions[destination, row], self._trace.positions[source, row]
            points += [self._new("Point3", **_xyz(place)) for place in (here, 0.5 * (here + there))]
            colours += 2 * [self._colour(health_colour(float(share)))]
        line = self._new(
            "LinePrimitive",
            type="LINE_LIST",
            pose=self._pose(np.zeros(3)),
            thickness=2.0,
            scale_invariant=True,
            points=points,
            colors=colours,
        )
        return self._new("SceneEntity", timestamp=stamp, frame_id="world", id="links", lines=[line])

    def _bodies(self, row: int, stamp: Protobuf) -> Protobuf:
        size = body_size(self._scene)
        cubes, texts = [], []
        for agent, place in enumerate(self._trace.positions[:, row]):
            side = self._new("Vector3", x=size, y=size, z=size)
            cubes.append(
                self._new("CubePrimitive", pose=self._pose(place), size=side, color=self._colour(agent_colour(agent)))
            )
            label = self._pose(place + np.array([0.0, 0.0, 1.5 * size]))
            texts.append(
                self._new(
                    "TextPrimitive",
                    pose=label,
                    billboard=True,
                    font_size=14.0,
                    scale_invariant=True,
                    color=self._colour(TRUTH),
                    text=str(agent),
                )
            )
        spheres = []
        truth = self._trace.truth[row, :3]
        if np.isfinite(truth).all():
            side = self._new("Vector3", x=size, y=size, z=size)
            spheres = [self._new("SpherePrimitive", pose=self._pose(truth), size=side, color=self._colour(TRUTH))]
        return self._new(
            "SceneEntity", timestamp=stamp, frame_id="world", id="bodies", cubes=cubes, texts=texts, spheres=spheres
        )

    def _uncertainty(self, row: int, stamp: Protobuf) -> Iterator[Protobuf]:
        """The 95 % ellipsoid of each agent; an entity of its own, which a user can switch off by name."""
        shapes = self._scene.ellipsoids
        for agent, place in enumerate(self._trace.estimates[:, row, :3]):
            axes, turn = shapes.axes[agent, row], shapes.orientation[agent, row]
            spheres = []
            if np.isfinite(place).all() and np.isfinite(axes).all():
                colour = self._colour(agent_colour(agent, 0.25))
                size = self._new("Vector3", **_xyz(2.0 * axes))
                spheres = [self._new("SpherePrimitive", pose=self._pose(place, turn), size=size, color=colour)]
            name = f"uncertainty of agent {agent}"
            yield self._new("SceneEntity", timestamp=stamp, frame_id="world", id=name, spheres=spheres)


def body_size(scene: Scene) -> float:
    """The size of an agent's body in the scene, m: a fiftieth of the space that all agents fill."""
    places = scene.trace.positions[:, 0]
    return max(0.05, 0.02 * float(np.linalg.norm(places.max(axis=0) - places.min(axis=0))))


def _numbers_class(name: str, fields: Sequence[str]) -> Callable[..., Protobuf]:
    """The class of a message of plain numbers."""
    descriptor, pool = _library("google.protobuf.descriptor_pb2"), _library("google.protobuf.descriptor_pool")
    file = descriptor.FileDescriptorProto(name=f"cbef/{name}.proto", package="cbef", syntax="proto3")
    message = file.message_type.add(name=name)
    message.field.add(name="step", number=1, type=3, label=1)
    for number, field in enumerate(fields, 2):
        message.field.add(name=field, number=number, type=1, label=1)
    own = pool.DescriptorPool()
    own.Add(file)
    factory = _library("google.protobuf.message_factory")
    made: Callable[..., Protobuf] = factory.GetMessageClass(own.FindMessageTypeByName(f"cbef.{name}"))
    return made


def _xyz(place: Floats) -> Mapping[str, float]:
    x, y, z = place.tolist()
    return {"x": x, "y": y, "z": z}
