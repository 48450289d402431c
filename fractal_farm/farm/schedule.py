"""Which epoch of which island may run now (DESIGN section 4, 'Migration depends on epoch numbers').

(island, epoch) needs (island, epoch - 1) and the records of its sources at epoch - lag; if islands tell each other what
they find, also those of all islands an epoch before that. There is no barrier: islands run ahead of each other as far
as their dependencies and `LEAD` allow. Pure bookkeeping, without a clock.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from fractal_farm.evolution.designs import Designs, without_repeats
from fractal_farm.evolution.epoch import ELSEWHERE, STEERED, EpochRecord, IslandState, library_after
from fractal_farm.evolution.hearsay import Hearsay

LEAD = 8


class Schedule:
    """Finished records, running work, and what may start next.

    Attributes:
        sources: islands that each island receives from.
        lag: epochs that migrants travel.
        state: the latest state of every island, without what it has heard.
        hearsay: what was found up to the last complete epoch; None if islands keep it to themselves.
        complete: the last epoch that all islands have finished.
        last_epoch: nothing is started beyond it, unless it is None.
        steering: (first epoch, last epoch, designs to breed from), in the order of the requests.
    """

    def __init__(
        self,
        sources: list[tuple[int, ...]],
        lag: int,
        state: dict[int, IslandState],
        committed: int = -1,
        hearsay: Hearsay | None = None,
    ) -> None:
        """Start from the state of each island after the same epoch.

        Args:
            sources: islands that each island receives from.
            lag: epochs that migrants travel.
            state: state of every island, all after the same epoch (-1: not founded).
            committed: the last epoch that any session has committed; beyond that of the states if a part was lost.
            hearsay: what was found up to the epoch of the states, if islands tell each other.
        """
        self.sources = sources
        self.lag = lag
        self.state = dict(state)
        self.hearsay = hearsay
        self.complete = min(entry.epoch for entry in state.values())
        self.last_epoch: int | None = None
        self.steering: list[tuple[int, int, Designs]] = []
        self._committed = committed
        self._running: set[int] = set()
        self._outbox: dict[tuple[int, int], Designs] = {}
        self._records: dict[int, dict[int, EpochRecord]] = defaultdict(dict)
        self._complete_state = dict(state)

    def remember(self, island: int, epoch: int, leaving: Designs) -> None:
        """Enter the emigrants of an epoch that was committed by an earlier session."""
        self._outbox[island, epoch] = leaving

    def steer(self, first: int, last: int, chosen: Designs) -> None:
        """Let all islands breed from designs in some epochs, none of which has begun in this session."""
        self.steering.append((first, last, chosen))

    def unbegun(self) -> int:
        """The first epoch that no island has begun, and no part holds, not even one beyond a lost part."""
        return 1 + max(
            self._committed, *(state.epoch + (island in self._running) for island, state in self.state.items())
        )

    def ready(self) -> list[tuple[int, int]]:
        """(island, epoch) pairs whose dependencies are met, oldest epoch first."""
        found = []
        for island, state in self.state.items():
            epoch = state.epoch + 1
            if island in self._running or epoch > self.complete + LEAD:
                continue
            if self.last_epoch is not None and epoch > self.last_epoch:
                continue
            has_heard = self.hearsay is None or epoch - self.lag - 1 <= self.complete
            if has_heard and all((source, epoch - self.lag) in self._outbox for source in self._senders(island, epoch)):
                found.append((epoch, island))
        return [(island, epoch) for epoch, island in sorted(found)]

    def start(self, island: int, epoch: int) -> tuple[list[tuple[int, Designs]], IslandState]:
        """Mark a pair as running.

        Returns:
            Its inbox: emigrants in the order of the sources, what other islands found, what somebody chose; and its
            state, with all that it had heard before.
        """
        self._running.add(island)
        inbox = [(source, self._outbox[source, epoch - self.lag]) for source in self._senders(island, epoch)]
        state = self.state[island]
        if self.hearsay is not None:
            news = epoch - self.lag - 1
            state = replace(state, elsewhere=self.hearsay.elsewhere(island, -1, news - 1))
            inbox.append((ELSEWHERE, self.hearsay.elsewhere(island, news, news)))
        return inbox + self._chosen(epoch), state

    def finish(self, record: EpochRecord) -> list[tuple[list[EpochRecord], dict[int, IslandState]]]:
        """Take in a record.

        Returns:
            For every epoch that is now complete for all islands, in order: its records in island order, and the
            states after it.
        """
        island, epoch = record.island, record.epoch
        state = IslandState(epoch, library_after(self.state[island].library, record))
        self._running.discard(island)
        self.state[island] = state
        self._outbox[island, epoch] = state.library[record.emigrants]
        self._records[epoch][island] = record
        completed: list[tuple[list[EpochRecord], dict[int, IslandState]]] = []
        while len(self._records.get(self.complete + 1, ())) == len(self.sources):
            self.complete += 1
            records = self._records.pop(self.complete)
            if self.hearsay is not None:
                self.hearsay.tell([records[k] for k in sorted(records)])
            self._complete_state = {island: self._state_after(records[island]) for island in sorted(records)}
            completed.append(([records[k] for k in sorted(records)], self._complete_state))
            for key in [key for key in self._outbox if key[1] <= self.complete - self.lag]:
                del self._outbox[key]
        return completed

    def _state_after(self, record: EpochRecord) -> IslandState:
        """The state at the end of an epoch that follows the last complete one.

        Islands that have run ahead are followed a second time: to keep all their states would take `LEAD` libraries.
        """
        ahead = self.state[record.island]
        if ahead.epoch == record.epoch:
            return ahead
        before = self._complete_state[record.island]
        return IslandState(record.epoch, library_after(before.library, record))

    @property
    def running(self) -> int:
        """Number of pairs that are running."""
        return len(self._running)

    def _chosen(self, epoch: int) -> list[tuple[int, Designs]]:
        chosen = [designs for first, last, designs in self.steering if first <= epoch <= last]
        if not chosen:
            return []
        together = np.concatenate(chosen)
        return [(STEERED, without_repeats(together, together[:0]))]

    def _senders(self, island: int, epoch: int) -> tuple[int, ...]:
        return self.sources[island] if epoch >= self.lag else ()
