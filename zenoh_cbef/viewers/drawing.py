"""The messages of a scene that Foxglove, Lichtblick and Rerun draw, step by step: for a file, or as a run goes on.

The schemas are those of foxglove (https://docs.foxglove.dev/docs/sdk/schemas), and two of plain numbers for plots.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.trace import Trace
from zenoh_cbef.viewers.colours import TRAIL, TRUTH, WARNINGS, agent_colour, body_size, health_colour
from zenoh_cbef.viewers.numbered import Protobuf, library, numbers_class
from zenoh_cbef.viewers.scene import Scene, SceneEvent


class Drawn(NamedTuple):
    """A message of a topic at a time, ns; made when it is wanted."""

    time: int
    topic: str
    make: Callable[[], Protobuf]


class Drawing:
    """Makes the messages of a run from scenes of its steps, one stretch after the other.

    first: any scene of the run: it tells agents and numbers. topics: the class of each topic's messages. Raises
    MissingExtra without the packages of the extra.
    """

    def __init__(self, first: Scene) -> None:
        self._classes: dict[str, type[Protobuf]] = {}
        for name in (
            *("FrameTransform", "FrameTransforms", "PointCloud", "PackedElementField", "PosesInFrame", "Pose"),
            *("SceneUpdate", "SceneEntity", "SpherePrimitive", "CubePrimitive", "LinePrimitive", "TextPrimitive"),
            *("Color", "Point3", "Vector3", "Quaternion", "Log"),
        ):
            self._classes[name] = getattr(library(f"foxglove_schemas_protobuf.{name}_pb2"), name)
        self._schema_of = library("mcap_protobuf.schema").build_file_descriptor_set
        self._stamp = library("google.protobuf.timestamp_pb2").Timestamp
        self._classes["NetworkMetrics"] = numbers_class("NetworkMetrics", list(first.metrics()))
        self._classes["AgentMetrics"] = numbers_class("AgentMetrics", list(first.agent_metrics(0)))
        self._size = body_size(first.trace)
        paths = ("/target/path", "/estimate/path", *(["/smoothed/path"] if first.smoothed is not None else []))
        self._paths = {path: deque[Floats](maxlen=TRAIL) for path in paths}
        kinds = {"/tf": "FrameTransforms", "/agents": "PointCloud", "/estimates": "PointCloud"}
        kinds |= dict.fromkeys(paths, "PosesInFrame") | {"/scene": "SceneUpdate", "/metrics": "NetworkMetrics"}
        kinds |= {f"/agent/{agent}/metrics": "AgentMetrics" for agent in range(len(first.trace.positions))}
        self.topics = {topic: self._classes[kind] for topic, kind in (kinds | {"/log": "Log"}).items()}

    def schema_of(self, kind: type[Protobuf]) -> bytes:
        """The description of a class of messages, a FileDescriptorSet."""
        described: bytes = self._schema_of(kind).SerializeToString()
        return described

    def remember(self, scene: Scene) -> None:
        """Begin the paths anew, with the steps of a scene that stand before those that are drawn next."""
        for path in self._paths.values():
            path.clear()
        for row in range(len(scene.time)):
            self._lengthen(scene, row)

    def messages(self, scene: Scene) -> Iterator[Drawn]:
        """The messages of a stretch of steps, by time; the stretch before it came before, or was remembered."""
        events = sorted(scene.events, key=lambda event: event.time)
        network = scene.metrics()
        agents = [scene.agent_metrics(agent) for agent in range(len(scene.trace.positions))]
        for row, time in enumerate(scene.time.tolist()):
            while events and events[0].time <= time:
                yield self._event(events.pop(0))
            self._lengthen(scene, row)
            stamp, step = self._stamp(seconds=time // 10**9, nanos=time % 10**9), scene.first + row
            for topic, make in self._step(scene, row, stamp).items():
                yield Drawn(time, topic, make)
            yield Drawn(time, "/metrics", partial(self._numbers, "NetworkMetrics", step, network, row))
            for agent, metrics in enumerate(agents):
                yield Drawn(time, f"/agent/{agent}/metrics", partial(self._numbers, "AgentMetrics", step, metrics, row))
        yield from map(self._event, events)

    def _new(self, name: str, /, **fields: object) -> Protobuf:
        return self._classes[name](**fields)

    def _numbers(self, kind: str, step: int, numbers: Mapping[str, Floats], row: int) -> Protobuf:
        return self._new(kind, step=step, **{name: float(values[row]) for name, values in numbers.items()})

    def _lengthen(self, scene: Scene, row: int) -> None:
        places = {"/target/path": scene.trace.truth[row, :3], "/estimate/path": scene.estimate[row]}
        if scene.smoothed is not None:
            places["/smoothed/path"] = scene.smoothed[row]
        for name, path in self._paths.items():
            path.append(places[name])

    def _event(self, event: SceneEvent) -> Drawn:
        level = "WARNING" if event.kind in WARNINGS else "INFO"
        stamp = self._stamp(seconds=event.time // 10**9, nanos=event.time % 10**9)
        told = {"message": event.text, "name": event.sender, "file": event.kind}
        return Drawn(event.time, "/log", partial(self._new, "Log", timestamp=stamp, level=level, **told))

    def _step(self, scene: Scene, row: int, stamp: Protobuf) -> dict[str, Callable[[], Protobuf]]:
        trace = scene.trace

        def agents() -> Protobuf:
            rows = np.column_stack([trace.positions[:, row], np.arange(len(trace.positions)), trace.ranges[:, row]])
            return self._cloud(stamp, rows, ("x", "y", "z", "agent", "range"))

        def estimates() -> Protobuf:
            errors = scene.analysis.position_error[:, row]
            rows = np.column_stack([trace.estimates[:, row, :3], np.arange(len(errors)), errors])
            return self._cloud(stamp, rows, ("x", "y", "z", "agent", "error"))

        def entities() -> Protobuf:
            found = [self._links(scene, row, stamp), self._bodies(trace, row, stamp)]
            return self._new("SceneUpdate", entities=[*found, *self._uncertainty(scene, row, stamp)])

        return {
            "/tf": partial(self._transforms, trace, row, stamp),
            "/agents": agents,
            "/estimates": estimates,
            **{name: partial(self._path, stamp, list(path)) for name, path in self._paths.items()},
            "/scene": entities,
        }

    def _transforms(self, trace: Trace, row: int, stamp: Protobuf) -> Protobuf:
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

    def _path(self, stamp: Protobuf, places: Sequence[Floats]) -> Protobuf:
        poses = [self._pose(place) for place in places if np.isfinite(place).all()]
        return self._new("PosesInFrame", timestamp=stamp, frame_id="world", poses=poses)

    def _pose(self, place: Floats, orientation: Floats | None = None) -> Protobuf:
        x, y, z, w = (0.0, 0.0, 0.0, 1.0) if orientation is None else orientation.tolist()
        turn = self._new("Quaternion", x=x, y=y, z=z, w=w)
        return self._new("Pose", position=self._new("Vector3", **_xyz(place)), orientation=turn)

    def _colour(self, colour: Sequence[float] | Floats) -> Protobuf:
        red, green, blue, alpha = (float(part) for part in colour)
        return self._new("Color", r=red, g=green, b=blue, a=alpha)

    def _links(self, scene: Scene, row: int, stamp: Protobuf) -> Protobuf:
        """One line per direction: the half of a receiver is of that receiver's colour."""
        points = [self._new("Point3", **_xyz(place)) for half in scene.halves(row) for place in half]
        colours = [self._colour(health_colour(float(share))) for share in np.repeat(scene.delivered[:, row], 2)]
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

    def _bodies(self, trace: Trace, row: int, stamp: Protobuf) -> Protobuf:
        size = self._size
        cubes, texts = [], []
        for agent, place in enumerate(trace.positions[:, row]):
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
        truth = trace.truth[row, :3]
        if np.isfinite(truth).all():
            side = self._new("Vector3", x=size, y=size, z=size)
            spheres = [self._new("SpherePrimitive", pose=self._pose(truth), size=side, color=self._colour(TRUTH))]
        return self._new(
            "SceneEntity", timestamp=stamp, frame_id="world", id="bodies", cubes=cubes, texts=texts, spheres=spheres
        )

    def _uncertainty(self, scene: Scene, row: int, stamp: Protobuf) -> Iterator[Protobuf]:
        """The 95 % ellipsoid of each agent; an entity of its own, which a user can switch off by name."""
        shapes = scene.ellipsoids
        for agent, place in enumerate(scene.trace.estimates[:, row, :3]):
            axes, turn = shapes.axes[agent, row], shapes.orientation[agent, row]
            spheres = []
            if np.isfinite(place).all() and np.isfinite(axes).all():
                colour = self._colour(agent_colour(agent, 0.25))
                size = self._new("Vector3", **_xyz(2.0 * axes))
                spheres = [self._new("SpherePrimitive", pose=self._pose(place, turn), size=size, color=colour)]
            name = f"uncertainty of agent {agent}"
            yield self._new("SceneEntity", timestamp=stamp, frame_id="world", id=name, spheres=spheres)


def _xyz(place: Floats) -> Mapping[str, float]:
    x, y, z = place.tolist()
    return {"x": x, "y": y, "z": z}
