"""Results remembered by the identity of their arguments: robots and covers hold arrays, so don't hash."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

_REMEMBERED = 32

Value = TypeVar("Value")


class ByIdentity:
    """Results for the last few arguments, told apart by identity. Only for arguments that can't change."""

    def __init__(self) -> None:
        self._entries: OrderedDict[tuple[int, ...], tuple[tuple[object, ...], Any]] = OrderedDict()

    def get(self, keys: tuple[object, ...], make: Callable[[], Value]) -> Value:
        """What `make` returned for these very objects, or returns now."""
        identity = tuple(map(id, keys))
        entry = self._entries.get(identity)
        if entry is not None:
            value: Value = entry[1]
            return value
        value = make()
        # The keys are held too, so that no other object takes over their identity.
        self._entries[identity] = (keys, value)
        if len(self._entries) > _REMEMBERED:
            self._entries.popitem(last=False)
        return value
