"""A run as a bag of ROS 2, written without ROS: MCAP with CDR, of the standard messages as Jazzy has them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.viewers.colours import TRUTH, agent_colour, body_size, health_colour
from zenoh_cbef.viewers.scene import Scene
from zenoh_cbef.writing import whole

_UNKNOWN_TURN = 1e6
"""Variance of an attitude that is not estimated, rad^2: a point has none."""

_CUBE, _SPHERE, _LINES, _TEXT = 1, 2, 5, 9
_ADD, _DELETE = 0, 2
_THIN = 0.02


class Ros(Protocol):
    """A message of ROS, whose classes are made from their definitions when they are read."""

    __msgtype__: ClassVar[str]


Message = tuple[str, Ros]


def write_ros2(scene: Scene, output: Path) -> list[Path]:
    """Write a folder, a bag with its metadata.yaml; returns it. A bag that is there already is written over.

    Raises UserError without the package rosbags, where the folder is something else, or cannot be written.
    """
    rosbag2 = from_extra("rosbags.rosbag2", "the export for ROS 2")
    messages = _Messages(scene)
    with whole(output) as fresh:
        with rosbag2.Writer(fresh, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
            connections: dict[str, object] = {}
            for time, topic, message in messages.all():
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=messages.store)
                writer.write(connections[topic], time, messages.store.serialize_cdr(message, kind))
        _clear(output)
    return [output]


def _clear(output: Path) -> None:
    """Take away a bag, and nothing else. Raises UserError where the place holds something else."""
    if not output.exists():
        return
    files = list(output.iterdir()) if output.is_dir() else []
    if {one.name for one in files} != {"metadata.yaml", f"{output.name}.mcap"}:
        raise UserError(f"{output} is no bag, and a bag is a folder of its own; name another --output")
    for one in files:
        one.unlink()
    output.rmdir()


class _Messages:
    """Makes the messages of a scene, step after step. store: the types of Jazzy."""

    def __init__(self, scene: Scene) -> None:
        typesys = from_extra("rosbags.typesys", "the export for ROS 2")
        self.store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
        self._scene, self._trace = scene, scene.trace
        self._size = body_size(scene.trace)

    def _new(self, kind: str, *values: object, **named: object) -> Ros:
        package, name = kind.split("/")
        made: Ros = self.store.types[f"{package}/msg/{name}"](*values, **named)
        return made

    def _stamp(self, time: int) -> Ros:
        return self._new("builtin_interfaces/Time", time // 10**9, time % 10**9)

    def _header(self, stamp: Ros, frame: str = "world") -> Ros:
        return self._new("std_msgs/Header", stamp, frame)

    def all(self) -> Iterator[tuple[int, str, Ros]]:
        """Time (ns), topic and message, by time."""
        for row, time in enumerate(self._scene.time.tolist()):
            for topic, message in self._step(row, self._stamp(time)):
                yield time, topic, message

    def _step(self, row: int, stamp: Ros) -> Iterator[Message]:
        trace, header = self._trace, self._header(stamp)
        yield "/tf", self._transforms(row, header)
        if np.isfinite(trace.truth[row, :3]).all():
            yield "/target/odometry", self._odometry(header, "target", trace.truth[row], np.zeros((6, 6)))
        for agent, state in enumerate(trace.estimates[:, row]):
            if np.isfinite(state).all():
                covariance = np.nan_to_num(trace.covariances[agent, row])
                frame = f"agent_{agent}_estimate"
                yield f"/agent_{agent}/odometry", self._odometry(header, frame, state, covariance)
                uncertain = self._uncertain(state, covariance)
                yield f"/agent_{agent}/pose", self._new("geometry_msgs/PoseWithCovarianceStamped", header, uncertain)
            if np.isfinite(measured := trace.ranges[agent, row]):
                yield f"/agent_{agent}/range", self._range(row, agent, float(measured))
        if trace.smoothed is not None:
            for agent, state in enumerate(trace.smoothed.states[:, row]):
                if np.isfinite(state).all():
                    covariance = np.nan_to_num(trace.smoothed.covariances[agent, row])
                    smoothed = self._odometry(header, f"agent_{agent}_smoothed", state, covariance)
                    yield f"/agent_{agent}/smoothed", smoothed
        yield "/markers", self._new("visualization_msgs/MarkerArray", list(self._markers(row, header)))

    def _transforms(self, row: int, header: Ros) -> Ros:
        trace = self._trace
        places = {"target": trace.truth[row, :3]}
        places |= {f"agent_{agent}": place for agent, place in enumerate(trace.positions[:, row])}
        places |= {f"agent_{agent}_estimate": state[:3] for agent, state in enumerate(trace.estimates[:, row])}
        turn = self._turn()
        transforms = [
            self._new(
                "geometry_msgs/TransformStamped",
                header,
                name,
                self._new("geometry_msgs/Transform", self._new("geometry_msgs/Vector3", *place.tolist()), turn),
            )
            for name, place in places.items()
            if np.isfinite(place).all()
        ]
        return self._new("tf2_msgs/TFMessage", transforms)

    def _turn(self, orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Ros:
        return self._new("geometry_msgs/Quaternion", *orientation)

    def _pose(self, place: Floats, orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Ros:
        point = self._new("geometry_msgs/Point", *place.tolist())
        return self._new("geometry_msgs/Pose", point, self._turn(orientation))

    def _uncertain(self, state: Floats, covariance: Floats) -> Ros:
        """Where the target is, with a covariance."""
        return self._new("geometry_msgs/PoseWithCovariance", self._pose(state[:3]), _with_turns(covariance[:3, :3]))

    def _odometry(self, header: Ros, frame: str, state: Floats, covariance: Floats) -> Ros:
        """A state (6,) with its covariance (6, 6), all zeros where there is none."""
        still = self._new("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
        twist = self._new("geometry_msgs/Twist", self._new("geometry_msgs/Vector3", *state[3:].tolist()), still)
        return self._new(
            "nav_msgs/Odometry",
            header,
            frame,
            self._uncertain(state, covariance),
            self._new("geometry_msgs/TwistWithCovariance", twist, _with_turns(covariance[3:, 3:])),
        )

    def _range(self, row: int, agent: int, measured: float) -> Ros:
        """A range, stamped with the time at which it was measured."""
        age = float(self._trace.age[agent, row])
        stamp = self._stamp(int(self._scene.time[row]) - (round(1e9 * age) if np.isfinite(age) else 0))
        placed = self._header(stamp, f"agent_{agent}")
        variance = self._trace.plan.range_std**2
        return self._new("sensor_msgs/Range", placed, 0, 2.0 * np.pi, 0.0, float("inf"), measured, variance)

    def _markers(self, row: int, header: Ros) -> Iterator[Ros]:
        trace, size = self._trace, np.full(3, self._size)
        for agent, place in enumerate(trace.positions[:, row]):
            colour = agent_colour(agent)
            yield self._marker(header, ("agents", agent, _CUBE), place, size, colour)
            above = place + np.array([0.0, 0.0, 1.5 * self._size])
            yield self._marker(header, ("numbers", agent, _TEXT), above, 2.0 * size, TRUTH, text=str(agent))
        yield self._marker(header, ("target", 0, _SPHERE), trace.truth[row, :3], size, TRUTH)
        shapes = self._scene.ellipsoids
        for agent, place in enumerate(trace.estimates[:, row, :3]):
            axes, turn = shapes.axes[agent, row], shapes.orientation[agent, row].tolist()
            colour = agent_colour(agent, 0.25)
            yield self._marker(header, ("uncertainty", agent, _SPHERE), place, 2.0 * axes, colour, orientation=turn)
        yield self._links(row, header)

    def _links(self, row: int, header: Ros) -> Ros:
        """Each half of a link in the colour of what its receiver got."""
        scene = self._scene
        points = [self._new("geometry_msgs/Point", *place) for half in scene.halves(row).tolist() for place in half]
        shares = np.repeat(scene.delivered[:, row], 2).tolist()
        colours = [self._new("std_msgs/ColorRGBA", *map(float, health_colour(share))) for share in shares]
        width = np.array([_THIN, 0.0, 0.0])
        return self._marker(header, ("links", 0, _LINES), np.zeros(3), width, TRUTH, points=points, colors=colours)

    def _marker(
        self,
        header: Ros,
        which: tuple[str, int, int],
        place: Floats,
        size: Floats,
        colour: Sequence[float],
        *,
        orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
        points: Sequence[Ros] = (),
        colors: Sequence[Ros] = (),
        text: str = "",
    ) -> Ros:
        """A marker; without a place or a size it takes away that of the step before. which: namespace, number, kind."""
        name, number, kind = which
        there = bool(np.isfinite(place).all() and np.isfinite(size).all())
        nothing = np.zeros(0, dtype=np.uint8)
        return self._new(
            "visualization_msgs/Marker",
            header=header,
            ns=name,
            id=number,
            type=kind,
            action=_ADD if there else _DELETE,
            pose=self._pose(place, orientation) if there else self._pose(np.zeros(3)),
            scale=self._new("geometry_msgs/Vector3", *(size if there else np.zeros(3)).tolist()),
            color=self._new("std_msgs/ColorRGBA", *map(float, colour)),
            lifetime=self._new("builtin_interfaces/Duration", 0, 0),
            frame_locked=False,
            points=list(points),
            colors=list(colors),
            texture_resource="",
            texture=self._new("sensor_msgs/CompressedImage", header, "", nothing),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=self._new("visualization_msgs/MeshFile", "", nothing),
            mesh_use_embedded_materials=False,
        )


def _with_turns(covariance: Floats) -> Floats:
    """A covariance (3, 3) as ROS has it, (36,), with turns that are not known; all zeros where it is not known."""
    full = np.zeros((6, 6))
    full[:3, :3] = covariance
    if covariance.any():
        full[3:, 3:] = _UNKNOWN_TURN * np.eye(3)
    return full.ravel()
