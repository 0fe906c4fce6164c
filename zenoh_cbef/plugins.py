"""What other packages add: a class found by its name, and what tells one version of its package from another.

A name is `package.module:Class`, or a short one that a package declares as an entry point. Only names travel and stand
in logs, never code: every process imports what is installed on its own host.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.metadata import Distribution, PackageNotFoundError, distribution, entry_points, packages_distributions
from importlib.util import find_spec
from pathlib import Path
from traceback import walk_tb
from typing import Generic, TypeVar

from pydantic import BaseModel, ValidationError

from zenoh_cbef.errors import UserError
from zenoh_cbef.words import meant

T = TypeVar("T")

_OURS = "zenoh-cbef"
_REFERENCE = re.compile(r"([^\W\d]\w*(?:\.[^\W\d]\w*)*):([^\W\d]\w*)", re.ASCII)
_DIGITS = 16


class NotInstalledError(ValueError):
    """No package on this host has the class of a name."""


@dataclass(frozen=True)
class Plugin:
    """A class of another package. mark: that package, its version, and a hash of its source, in one line."""

    found: type
    mark: str


def short_names(group: str) -> dict[str, str]:
    """What each short name stands for that packages on this host declare; group: filters, motions or faults."""
    return {one.name: one.value for one in entry_points(group=f"zenoh_cbef.{group}")}


@cache
def find(group: str, name: str, own: tuple[str, ...]) -> Plugin:
    """The class of a name that is none of our own; group: filters, motions or faults.

    A module is imported only where its package says that it requires this one, or where it belongs to no package: a
    scenario of a stranger cannot have any other code run. Raises ValueError: what is wrong with the name, and the
    remedy, to stand after a key.
    """
    short = short_names(group)
    reference = _REFERENCE.fullmatch(short.get(name, name))
    if reference is None:
        known = ", ".join((*own, *sorted(short)))
        raise NotInstalledError(f"must be one of {known}, or 'package.module:Class', not {name!r}")
    module, attribute = reference.groups()
    top, spec = _top(module)
    package = _package(top)
    _refuse_strangers(name, top, package)
    try:
        there = import_module(module)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - its code may raise anything, or end the program
        if isinstance(error, ModuleNotFoundError) and error.name and f"{module}.".startswith(f"{error.name}."):
            raise NotInstalledError(_missing(error.name)) from None
        raise ValueError(
            f"names module {module!r}, which cannot be imported ({type(error).__name__}: {error}); correct it"
        ) from None
    classes = {one: value for one, value in vars(there).items() if isinstance(value, type)}
    if attribute not in classes:
        near = meant(attribute, classes, "correct the name behind the colon")
        raise ValueError(f"names {attribute!r}, but module {module!r} has no class of that name; {near}")
    told = f"{package.name} {package.version}" if package else top
    return Plugin(classes[attribute], f"{told} sha256:{_hash(spec)}")


@dataclass(frozen=True)
class Registry(Generic[T]):
    """Classes by name, our own and those of other packages. group: filters, motions or faults.

    plugged: a class of another package, and its name, as what it must be; raises ValueError where it is none. no_class:
    a name that stands for none.
    """

    group: str
    own: Mapping[str, type[T]]
    plugged: Callable[[type, str], type[T]]
    no_class: str | None = None

    def kind_of(self, name: str) -> type[T]:
        """The class of a name. Raises ValueError, to stand after its key, where there is none."""
        return self.own[name] if name in self.own else self.plugged(self._plugin(name).found, name)

    def mark_of(self, name: str) -> str | None:
        """Package, version and source of a class of another package; None for one of our own."""
        return None if name in self.own or name == self.no_class else self._plugin(name).mark

    def options_of(self, name: str, given: Mapping[str, object], key: str) -> dict[str, object]:
        """All options of a class, see `told_options`. Raises ValueError with a sentence that names the option."""
        kind = None if name == self.no_class else self.kind_of(name)
        return told_options(getattr(kind, "options", None), name, given, key)

    def _plugin(self, name: str) -> Plugin:
        return find(self.group, name, (*self.own, *([self.no_class] if self.no_class else [])))


def _missing(module: str) -> str:
    return f"names module {module!r}, which is not installed on this host; install its package on every host"


def _top(module: str) -> tuple[str, ModuleSpec]:
    """The package that a module is of, past namespaces, which several packages share. Raises ValueError."""
    top, *inner = module.split(".")
    if top in sys.stdlib_module_names:
        raise ValueError(f"names module {module!r} of Python itself, which is no plug-in; name a class of a plug-in")
    spec = find_spec(top)
    while spec is not None and spec.origin is None and inner:
        top = f"{top}.{inner.pop(0)}"
        spec = find_spec(top)
    if spec is None:
        raise NotInstalledError(_missing(top))
    return top, spec


def _package(top: str) -> Distribution | None:
    """The installed package of a module; None for a file that is only on the path."""
    try:
        return distribution(top.replace(".", "-"))
    except PackageNotFoundError:
        owners = _owners().get(top.partition(".")[0], [])
        return distribution(owners[0]) if owners else None


@cache
def _owners() -> Mapping[str, list[str]]:
    """The packages of each module that is installed; read once, as all installed packages are searched."""
    return packages_distributions()


def _refuse_strangers(name: str, top: str, package: Distribution | None) -> None:
    """Raise ValueError for a package that was not written to be a plug-in."""
    if package is None and top.partition(".")[0] != __package__:
        return
    needed = {re.split(r"[^\w.-]", one)[0] for one in (package.requires or [] if package else [])}
    if _OURS not in {re.sub(r"[-_.]+", "-", one).lower() for one in needed}:
        told = package.name if package else top
        raise ValueError(
            f"names {name!r}, but package {told} does not require {_OURS}, so it is no plug-in; add {_OURS!r} to its "
            "dependencies, or name a class of a plug-in"
        )


def _hash(spec: ModuleSpec) -> str:
    """A hash of all files of a package, or of a module's one file."""
    found = sha256()
    for folder in map(Path, spec.submodule_search_locations or ()):
        for path in sorted(folder.rglob("*")):
            inside = path.relative_to(folder)
            if path.is_file() and "__pycache__" not in inside.parts:
                found.update(inside.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    if spec.submodule_search_locations is None and spec.origin is not None:
        found.update(Path(spec.origin).read_bytes())
    return found.hexdigest()[:_DIGITS]


def told_options(model: object, name: str, given: Mapping[str, object], key: str) -> dict[str, object]:
    """All options of a plug-in, as JSON has them; `{}` for one that has none.

    model: of pydantic, or None. name: of the plug-in. key: of the table, as in filter.options. Raises ValueError with a
    sentence that names the option.
    """
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        if given:
            raise ValueError(f"{key} has {', '.join(given)}, but {name!r} has no options; leave {key} out")
        return {}
    names = [field.alias or name for name, field in model.model_fields.items()]
    unknown = [name for name in given if name not in names]
    if unknown:
        near = meant(unknown[0], names, f"it has {', '.join(names) or 'none'}")
        raise ValueError(f"{key}.{unknown[0]} is no option of {model.__qualname__}; {near}")
    try:
        return model.model_validate(given).model_dump(mode="json", by_alias=True)
    except ValidationError as error:
        raise ValueError(mistake(error, key)) from None


@contextmanager
def blaming(kind: type, method: str, check: str) -> Iterator[None]:
    """Raise UserError for what a class of another package does wrong in here: which class, where, and what.

    method: of the class, that is called in here. check: what in `zenoh_cbef.testing` tells more of such classes.
    Mistakes of our own classes pass.
    """
    try:
        yield
    except (UserError, MemoryError):
        raise
    except Exception as error:
        if _top_of(kind.__module__) == __package__:
            raise
        first = (str(error).splitlines() or [""])[0]
        raise UserError(
            f"{kind.__qualname__}.{method}() fails at {_place(kind, method, error)} ({type(error).__name__}: {first}); "
            f"correct it: zenoh_cbef.testing.{check} tells more"
        ) from error


def _place(kind: type, method: str, error: Exception) -> str:
    """The last line of the class's package on the way to an error; where the method begins, if there is none."""
    code = getattr(getattr(kind, method, None), "__code__", None)
    place = f"{code.co_filename}:{code.co_firstlineno}" if code else kind.__module__
    for frame, line in walk_tb(error.__traceback__):
        if _top_of(frame.f_globals.get("__name__", "")) == _top_of(kind.__module__):
            place = f"{frame.f_code.co_filename}:{line}"
    return place


def _top_of(module: str) -> str:
    return module.partition(".")[0]


def mistake(error: ValidationError, key: str) -> str:
    """The first mistake of a validation in a sentence that begins with the key of the table."""
    first = error.errors(include_url=False)[0]
    place = ".".join((key, *map(str, first["loc"])))
    if first["type"] == "missing":
        return f"{place} is missing; add it"
    if first["type"] == "string_type":
        given = _shown(first["input"])
        return f"{place} is text, not {given}; put it in quotes, as in --set '{place}=\"{given.lower()}\"'"
    said = first["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if first["type"] == "value_error" and isinstance(first["input"], Mapping):
        return said  # a check of a whole table names its own keys
    return f"{place}: the value {said}, not {_shown(first['input'])}; correct it"


def _shown(value: object) -> str:
    return "a table" if isinstance(value, Mapping) else f"{value!r:.60}"
