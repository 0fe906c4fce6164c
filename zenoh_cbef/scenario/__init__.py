"""The typed description of a run, and everything that follows from it alone.

model: the keys. load: files, built-ins, overrides. checks: refuse what cannot work. network, world, build:
the graph, the emulated target and receivers, and the tracker that a scenario describes, as pure functions. plan: all
that follows from a scenario, made once and handed down.

The package can be called: `zenoh_cbef.scenario("tracking", seed=7)` is the scenario of that name.
"""

import sys
from importlib import import_module
from types import ModuleType

from zenoh_cbef.scenario.model import Scenario

__all__ = ["Scenario"]


class _Called(ModuleType):
    """The package as a function: Python puts it where `zenoh_cbef.scenario` is looked for."""

    def __call__(self, what: object = "tracking", /, **values: object) -> Scenario:
        """As `zenoh_cbef.api.scenario`."""
        found: Scenario = import_module("zenoh_cbef.scenario.calling").described(what, values).scenario
        return found


sys.modules[__name__].__class__ = _Called
