"""Peer-to-peer target tracking with consensus filters over Zenoh.

`import zenoh_cbef as zc` gives simulate, run, load, reestimate, scenario, live and Run (docs/api.md). Each is imported
when it is first used.
"""

# Every verb imports this file, which imports next to nothing itself: Ctrl-C in here would be a traceback.
from importlib import import_module

TYPE_CHECKING = False  # as `typing` has it, which takes a while to import
if TYPE_CHECKING:
    from zenoh_cbef.api.live import LiveEstimate, live
    from zenoh_cbef.api.logs import load, reestimate
    from zenoh_cbef.api.run import Run
    from zenoh_cbef.api.running import run
    from zenoh_cbef.api.simulating import scenario, simulate
    from zenoh_cbef.errors import UserError

__all__ = ["LiveEstimate", "Run", "UserError", "live", "load", "reestimate", "run", "scenario", "simulate"]

VERSION = "0.2.0"

__version__: str
"""The version, with the commit in a checkout."""

_HOMES = {
    "LiveEstimate": "api.live",
    "Run": "api.run",
    "UserError": "errors",
    "live": "api.live",
    "load": "api.logs",
    "reestimate": "api.logs",
    "run": "api.running",
    "scenario": "api.simulating",
    "simulate": "api.simulating",
}


def __getattr__(name: str) -> object:
    if name == "__version__":
        found = import_module(f"{__name__}.checkout").here()
        globals()[name] = version = f"{VERSION}+g{found}" if found else VERSION
        return version
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
