"""Faults, one kind per file. Adding one is a file with a class as in loss.py, and a line in KINDS.

A fault of another package is named by its class, see plugins.py.
"""

from __future__ import annotations

from typing import Annotated, get_args

from zenoh_cbef.faults.absence import Absence, Absences
from zenoh_cbef.faults.base import Effect, Fault, LinkFault, MessageFault, Messages
from zenoh_cbef.faults.burst_loss import BurstLoss
from zenoh_cbef.faults.byzantine import Byzantine
from zenoh_cbef.faults.clock import Clock, ahead, clocks_of
from zenoh_cbef.faults.corrupt import Corrupt
from zenoh_cbef.faults.crash import Crash
from zenoh_cbef.faults.delay import Delay
from zenoh_cbef.faults.duplicate import Duplicate
from zenoh_cbef.faults.fates import Fate, Fates
from zenoh_cbef.faults.injected import Injected
from zenoh_cbef.faults.loss import Loss
from zenoh_cbef.faults.outage import Outage
from zenoh_cbef.faults.outgoing import Outgoing, SenderFault
from zenoh_cbef.faults.partition import Partition
from zenoh_cbef.faults.pause import Pause
from zenoh_cbef.faults.plugged import PLUGGED, ByKind, fault_of
from zenoh_cbef.faults.rate_limit import RateLimit
from zenoh_cbef.faults.reorder import Reorder
from zenoh_cbef.faults.sensing import Readings, SensorFault, measured_ranges
from zenoh_cbef.faults.sensor_bias import SensorBias
from zenoh_cbef.faults.sensor_dropout import SensorDropout
from zenoh_cbef.faults.sensor_spikes import SensorSpikes
from zenoh_cbef.faults.sensor_stuck import SensorStuck
from zenoh_cbef.plugins import Registry

__all__ = [
    "KINDS",
    "PLUGGED",
    "Absence",
    "Absences",
    "AnyFault",
    "BurstLoss",
    "Byzantine",
    "Clock",
    "Corrupt",
    "Crash",
    "Delay",
    "Duplicate",
    "Effect",
    "Fate",
    "Fates",
    "Fault",
    "Injected",
    "LinkFault",
    "Loss",
    "MessageFault",
    "Messages",
    "Outage",
    "Outgoing",
    "Partition",
    "Pause",
    "RateLimit",
    "Readings",
    "Reorder",
    "SenderFault",
    "SensorBias",
    "SensorDropout",
    "SensorFault",
    "SensorSpikes",
    "SensorStuck",
    "ahead",
    "clocks_of",
    "kind_of",
    "mark_of",
    "measured_ranges",
]

KINDS: dict[str, type[Fault]] = {
    str(get_args(one.model_fields["kind"].annotation)[0]): one
    for one in (
        Loss,
        BurstLoss,
        Delay,
        Duplicate,
        Reorder,
        Corrupt,
        RateLimit,
        Partition,
        Outage,
        Pause,
        Crash,
        Byzantine,
        Clock,
        SensorBias,
        SensorSpikes,
        SensorDropout,
        SensorStuck,
    )
}

_REGISTRY: Registry[Fault] = Registry("faults", KINDS, fault_of)
kind_of, mark_of = _REGISTRY.kind_of, _REGISTRY.mark_of

AnyFault = Annotated[Fault, ByKind(_REGISTRY)]
"""A fault of any kind, as a scenario's field: a table is read by the class that its `kind` names."""
