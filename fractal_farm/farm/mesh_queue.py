"""Which designs become solids, and when (DESIGN section 4).

Printable designs come first (their wall makes one body without thickening), then the fitter. While evolution goes on,
the budget is spent in step with the run's progress: what is best in the end still finds room.
"""

from __future__ import annotations

import heapq
import math

from fractal_farm.farm.work import MeshOrder


class MeshQueue:
    """Designs that wait to be meshed, best first."""

    def __init__(self, limit: int | None, printable_gap: float, done: int = 0) -> None:
        """An empty queue.

        Args:
            limit: solids that the run may make in all, None for no limit.
            printable_gap: largest gap (relative to the longest side) that the wall bridges.
            done: solids that exist already.
        """
        self.limit = limit
        self.started = done
        self._printable_gap = printable_gap
        self._heap: list[tuple[bool, float, str, MeshOrder]] = []
        self._seen: set[str] = set()

    def offer(self, order: MeshOrder, fitness: float, gap: float) -> None:
        """Enter a design once."""
        identity = order.genome.design_id
        if identity not in self._seen:
            self._seen.add(identity)
            heapq.heappush(self._heap, (gap > self._printable_gap, -fitness, identity, order))
            if self.limit is not None and len(self._heap) > 8 * self.limit + 64:
                self._heap = heapq.nsmallest(4 * self.limit + 32, self._heap)

    def skip(self, design_id: str) -> None:
        """Never mesh this one: it has its solid already."""
        self._seen.add(design_id)

    @property
    def left(self) -> bool:
        """Whether a design waits, and the budget allows it."""
        return bool(self._heap) and (self.limit is None or self.started < self.limit)

    def take(self, progress: float) -> MeshOrder | None:
        """The next design, if the share of the budget that goes with `progress` (0 .. 1) is not yet spent."""
        allowed = math.inf if self.limit is None else math.floor(self.limit * min(progress, 1.0))
        if not self._heap or self.started >= allowed:
            return None
        self.started += 1
        return heapq.heappop(self._heap)[3]

    def again(self, order: MeshOrder) -> None:
        """Put back an order whose worker was lost."""
        self.started -= 1
        heapq.heappush(self._heap, (False, -math.inf, order.genome.design_id, order))
