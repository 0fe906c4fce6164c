"""The typed description of a run, and everything that follows from it alone.

model: the keys. load: files, built-ins, overrides. checks: refuse what cannot work. network, world, build:
the graph, the emulated target and receivers, and the tracker that a scenario describes, as pure functions. plan: all
that follows from a scenario, made once and handed down.
"""

from zenoh_cbef.scenario.model import Scenario

__all__ = ["Scenario"]
