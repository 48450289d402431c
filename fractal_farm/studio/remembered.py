"""Results that somebody may ask for again, by what they were computed from; the oldest are forgotten."""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from collections.abc import Awaitable, Callable, Hashable


class Remembered:
    """Bytes by key.

    Args:
        most_bytes: of all results together.
    """

    def __init__(self, most_bytes: int) -> None:
        self._known: OrderedDict[Hashable, bytes] = OrderedDict()
        self._computing: dict[Hashable, asyncio.Task[bytes]] = {}
        self._left = most_bytes

    async def get(self, key: Hashable, compute: Callable[[], Awaitable[bytes]]) -> bytes:
        """The result of a key; computed once, however many ask at the same time."""
        if key in self._known:
            self._known.move_to_end(key)
            return self._known[key]
        if key not in self._computing:
            self._computing[key] = asyncio.create_task(self._compute(key, compute))
        return await asyncio.shield(self._computing[key])

    async def _compute(self, key: Hashable, compute: Callable[[], Awaitable[bytes]]) -> bytes:
        try:
            found = await compute()
        finally:
            del self._computing[key]
        self._known[key] = found
        self._left -= len(found)
        while self._left < 0:
            _, forgotten = self._known.popitem(last=False)
            self._left += len(forgotten)
        return found
