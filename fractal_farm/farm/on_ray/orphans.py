"""Waiting for tasks whose answer may never come.

Ray fails the work of a node that dies, but not a request for one of its workers that was open when the node fell
silent, and all later requests of the same kind queue up behind that one: the process that asked is an orphan, and
waits for ever. Only a new process can ask anew.
"""

from __future__ import annotations

import time
from typing import Any

import ray

LOOK_SECONDS = 5.0
_DOUBT_SECONDS = 2 * LOOK_SECONDS


class Nodes:
    """The cluster's nodes, as far as this process knows."""

    def __init__(self) -> None:
        self._living = _living()
        self._loss = float("-inf")

    def outlived(self, calls: list[Any]) -> bool:
        """Wait for the results of some calls.

        Returns:
            True when all are there; False when a node died meanwhile, or so shortly before that not everybody knew.
        """
        asked = time.monotonic()
        while ray.wait(calls, num_returns=len(calls), timeout=LOOK_SECONDS)[1]:
            living = _living()
            if self._living - living:
                self._loss = time.monotonic()
            self._living = living
            if self._loss > asked - _DOUBT_SECONDS:
                return False
        return True


def _living() -> set[str]:
    return {entry["NodeID"] for entry in ray.nodes() if entry["Alive"]}
