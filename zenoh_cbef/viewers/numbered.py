"""Protobuf for viewers: the classes of messages, and those of plain numbers, which are made here."""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import ClassVar, Protocol

from zenoh_cbef.extras import from_extra


class _Described(Protocol):
    full_name: str


class Protobuf(Protocol):
    """A message of protobuf, whose classes are made when their schemas are read."""

    DESCRIPTOR: ClassVar[_Described]

    def __init__(self, **fields: object) -> None: ...

    def SerializeToString(self) -> bytes:  # noqa: N802 - protobuf's name
        """Its bytes."""


def library(module: str) -> ModuleType:
    """A module of the extra `viz`. Raises MissingExtra."""
    return from_extra(module, "what viewers show")


def numbers_class(name: str, fields: Sequence[str]) -> type[Protobuf]:
    """The class of a message of plain numbers."""
    descriptor, pool = library("google.protobuf.descriptor_pb2"), library("google.protobuf.descriptor_pool")
    file = descriptor.FileDescriptorProto(name=f"cbef/{name}.proto", package="cbef", syntax="proto3")
    message = file.message_type.add(name=name)
    message.field.add(name="step", number=1, type=3, label=1)
    for number, field in enumerate(fields, 2):
        message.field.add(name=field, number=number, type=1, label=1)
    own = pool.DescriptorPool()
    own.Add(file)
    factory = library("google.protobuf.message_factory")
    made: type[Protobuf] = factory.GetMessageClass(own.FindMessageTypeByName(f"cbef.{name}"))
    return made
