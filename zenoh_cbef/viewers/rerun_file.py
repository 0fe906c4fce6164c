"""A run as a recording of Rerun (https://rerun.io), with what to show where."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from zenoh_cbef.extras import from_extra
from zenoh_cbef.viewers.colours import TRAIL, TRUTH, WARNINGS, agent_colour, body_size, health_colour
from zenoh_cbef.viewers.scene import Scene
from zenoh_cbef.writing import whole

if TYPE_CHECKING:
    from rerun import RecordingStream
    from rerun.blueprint import Blueprint


_SOURCE = "source"
"""The timeline of a recording's own clock."""
_LEAST_SHOWN = ("position_error", "smoothed_position_error", "centralized_position_error", "disagreement")


def write_rrd(scene: Scene, output: Path) -> list[Path]:
    """Write the recording. Raises UserError without the package rerun-sdk, and where it cannot be written."""
    rerun = from_extra("rerun", "the export for Rerun")
    with whole(output) as fresh:
        recording = rerun.RecordingStream("zenoh-cbef", recording_id=scene.trace.name)
        recording.save(str(fresh), default_blueprint=_layout(rerun.blueprint, len(scene.trace.positions)))
        _Writer(scene, rerun, recording).write()
        recording.flush()
        recording.disconnect()
    return [output]


def _layout(blueprint: ModuleType, count: int) -> Blueprint:
    delivered = [f"agents/{agent}/delivered" for agent in range(count)]
    plots = [
        blueprint.TimeSeriesView(name="errors (m)", contents=[f"metrics/{name}" for name in _LEAST_SHOWN]),
        blueprint.TimeSeriesView(name="honesty", contents=["metrics/nees", "metrics/nis"]),
        blueprint.TimeSeriesView(name="messages in time", contents=delivered),
        blueprint.TextLogView(name="events", origin="events"),
    ]
    world = blueprint.Spatial3DView(name="world", origin="world")
    return blueprint.Blueprint(
        blueprint.Horizontal(world, blueprint.Vertical(*plots), column_shares=[3, 2]), collapse_panels=True
    )


class _Writer:
    def __init__(self, scene: Scene, rerun: ModuleType, recording: RecordingStream) -> None:
        self._scene, self._trace, self._rr, self._recording = scene, scene.trace, rerun, recording
        self._colours = [agent_colour(agent) for agent in range(len(scene.trace.positions))]
        self._faint = [agent_colour(agent, 0.25) for agent in range(len(scene.trace.positions))]
        self._labels = list(scene.trace.scenario.agents.names)
        self._radius = 0.5 * body_size(scene.trace)

    def write(self) -> None:
        """Log everything."""
        for row in range(len(self._trace.time)):
            self._recording.set_time("run", duration=float(self._trace.time[row]))
            self._recording.set_time("step", sequence=row + 1)
            if self._trace.source_time is not None:
                self._recording.set_time(_SOURCE, timestamp=np.datetime64(int(self._scene.time[row]), "ns"))
            self._step(row)
        self._curves()
        start = int(self._scene.time[0]) - round(1e9 * self._trace.scenario.dt)
        self._recording.reset_time()
        for event in self._scene.events:
            self._recording.set_time("run", duration=max(0.0, 1e-9 * (event.time - start)))
            if self._trace.source_time is not None:
                self._recording.set_time(_SOURCE, timestamp=np.datetime64(event.time, "ns"))
            level = "WARN" if event.kind in WARNINGS else "INFO"
            self._log("events", self._rr.TextLog(f"{event.sender}: {event.text}", level=level))

    def _log(self, entity: str, what: object) -> None:
        self._recording.log(entity, what)

    def _step(self, row: int) -> None:
        rr, trace, first = self._rr, self._trace, max(0, row + 1 - TRAIL)
        bodies = {"colors": self._colours, "labels": self._labels, "show_labels": True}
        self._log("world/agents", rr.Points3D(trace.positions[:, row], radii=self._radius, **bodies))
        truth = trace.truth[first : row + 1, :3]
        if np.isfinite(truth).all():
            self._log("world/target", rr.Points3D([truth[-1]], radii=self._radius, colors=[TRUTH]))
            self._log("world/target/path", rr.LineStrips3D([truth], colors=[TRUTH]))
        places, axes = trace.estimates[:, row, :3], self._scene.ellipsoids.axes[:, row]
        there = np.asarray(np.isfinite(places).all(axis=1))
        colours = [colour for colour, known in zip(self._colours, there, strict=True) if known]
        self._log("world/estimates", rr.Points3D(places[there], radii=0.3 * self._radius, colors=colours))
        sure = np.asarray(there & np.isfinite(axes).all(axis=1))
        shapes = rr.Ellipsoids3D(
            centers=places[sure],
            half_sizes=axes[sure],
            quaternions=self._scene.ellipsoids.orientation[sure, row],
            colors=[colour for colour, known in zip(self._faint, sure, strict=True) if known],
            fill_mode="solid",
        )
        self._log("world/uncertainty", shapes)
        paths = {"world/estimates/path": self._scene.estimate, "world/smoothed/path": self._scene.smoothed}
        for name, path in paths.items():
            if path is not None:
                trail = path[first : row + 1]
                self._log(name, rr.LineStrips3D([trail[np.isfinite(trail).all(axis=1)]]))
        self._links(row)

    def _links(self, row: int) -> None:
        colours = [health_colour(float(share)) for share in self._scene.delivered[:, row]]
        self._log("world/links", self._rr.LineStrips3D(self._scene.halves(row), colors=colours))

    def _curves(self) -> None:
        curves = {f"metrics/{name}": values for name, values in self._scene.metrics().items()}
        for agent in range(len(self._trace.positions)):
            metrics = self._scene.agent_metrics(agent)
            curves |= {f"agents/{agent}/{name}": values for name, values in metrics.items()}
        rr, time = self._rr, self._trace.time
        for name, values in curves.items():
            known = np.isfinite(values)
            steps = np.flatnonzero(known)
            indexes = [rr.TimeColumn("run", duration=time[steps]), rr.TimeColumn("step", sequence=steps + 1)]
            if self._trace.source_time is not None:
                indexes.append(rr.TimeColumn(_SOURCE, timestamp=self._scene.time[steps].astype("datetime64[ns]")))
            if len(steps):
                self._recording.send_columns(name, indexes=indexes, columns=rr.Scalars.columns(scalars=values[steps]))
