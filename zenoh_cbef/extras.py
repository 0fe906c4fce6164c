"""Packages that only some outputs need, and which extra of this package brings each."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from zenoh_cbef.errors import UserError

EXTRA_OF = {
    "plotly": "report",
    "matplotlib": "report",
    "joblib": "experiment",
    "pyarrow": "experiment",
    "distributed": "dask",
    "lz4": "lz4",
    "foxglove_schemas_protobuf": "viz",
    "mcap_protobuf": "viz",
    "google": "viz",
    "foxglove": "foxglove",
    "rerun": "rerun",
    "pandas": "pandas",
    "xarray": "xarray",
    "rosbags": "ros",
    "starlette": "lab",
    "uvicorn": "lab",
    "websockets": "lab",
    "serial": "receive",
    "pymavlink": "receive",
}


class MissingExtra(UserError):
    """A package of an extra is not installed. A verb that did its main work without it catches this and says so."""


def from_extra(module: str, what: str, *, extra: str | None = None) -> ModuleType:
    """A module of an optional package. Raises MissingExtra, which names the extra; what: what needs the module.

    extra: where another extra than the package's usual one brings it, too.
    """
    package = module.partition(".")[0]
    try:
        return import_module(module)
    except ImportError:
        chosen = extra or EXTRA_OF[package]
        raise MissingExtra(f"{what} needs {package}; run: pip install 'zenoh-cbef[{chosen}]'") from None
