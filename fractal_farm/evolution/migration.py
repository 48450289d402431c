"""Migration between islands: who sends to whom, who leaves, and who makes room (DESIGN section 4).

Policies are small functions with one signature each, chosen by name. Everything depends on epoch numbers, never on
timing: island i at epoch e receives what its sources sent at the end of epoch e - lag.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from fractal_farm.evolution.designs import Designs, total_order, without_repeats
from fractal_farm.random_streams import Purpose, stream

Merit = npt.NDArray[np.float64]


def sources(topology: str, islands: int, degree: int, seed: int) -> list[tuple[int, ...]]:
    """For each island the islands it receives from, in index order.

    Args:
        topology: "ring" (the `degree` nearest on a circle), "full", "random" (a random graph in which every island
            has `degree` sources and `degree` destinations, fixed by the seed) or "isolated".
        islands: number of islands.
        degree: sources of an island in "ring" and "random", less than `islands` or cut to that.
        seed: the run's seed.

    Returns:
        One sorted tuple for each island; never the island itself.
    """
    circle = list(range(islands))
    reach = min(degree, islands - 1)
    if topology == "isolated" or islands == 1:
        steps: list[int] = []
    elif topology == "full":
        steps = list(range(1, islands))
    elif topology == "ring":
        nearest = [step for k in range(1, islands) for step in (-k, k)]
        steps = list(dict.fromkeys(step % islands for step in nearest))[:reach]
    else:
        rng = stream(seed, Purpose.TOPOLOGY)
        circle = rng.permutation(islands).tolist()
        # One step on the circle connects all islands; the others are shortcuts.
        steps = [1, *(2 + rng.permutation(islands - 2)).tolist()][:reach]
    place = {island: k for k, island in enumerate(circle)}
    return [tuple(sorted(circle[(place[island] + step) % islands] for step in steps)) for island in range(islands)]


def _best(library: Designs, merit: Merit, count: int, _rng: np.random.Generator) -> list[int]:
    order = np.lexsort((library["slot"], library["generation"], library["island"], -merit))
    return [int(index) for index in order[:count]]


def _random(library: Designs, _merit: Merit, count: int, rng: np.random.Generator) -> list[int]:
    return sorted(rng.permutation(len(library))[:count].tolist())


SELECTIONS: dict[str, Callable[[Designs, Merit, int, np.random.Generator], list[int]]] = {
    "best": _best,
    "random": _random,
}


def emigrants(
    library: Designs, merit: Merit, selection: str, count: int, seed: int, island: int, generation: int
) -> list[int]:
    """Indices of the library's members whose copies leave at the end of an epoch.

    Args:
        library: members.
        merit: (members,) float64, by which some are better than others.
        selection: name of the policy.
        count: how many leave, at most.
        seed: the run's seed.
        island: the island that they leave.
        generation: the last generation of the epoch.
    """
    return SELECTIONS[selection](library, merit, count, stream(seed, Purpose.EMIGRANTS, island, generation))


def _worst_if_better(library: Designs, arrival: Designs, _rng: np.random.Generator) -> int | None:
    worst = int(total_order(library)[-1])
    return worst if arrival["fitness"] > library["fitness"][worst] else None


def _worst(library: Designs, _arrival: Designs, _rng: np.random.Generator) -> int | None:
    return int(total_order(library)[-1])


def _random_member(library: Designs, _arrival: Designs, rng: np.random.Generator) -> int | None:
    return int(rng.integers(len(library)))


REPLACEMENTS: dict[str, Callable[[Designs, Designs, np.random.Generator], int | None]] = {
    "worst_if_better": _worst_if_better,
    "worst": _worst,
    "random": _random_member,
}


def settle(
    library: Designs, arrivals: Designs, replacement: str, seed: int, island: int, generation: int
) -> tuple[Designs, int]:
    """Let arrivals take the places of members.

    Args:
        library: members.
        arrivals: rows of the same dtype in their order of arrival; those already present are turned away.
        replacement: name of the policy that gives each arrival a place, or turns it away.
        seed: the run's seed.
        island: the receiving island.
        generation: the first generation of the epoch.

    Returns:
        The new library and the number of arrivals that settled.
    """
    rng = stream(seed, Purpose.REPLACEMENT, island, generation)
    policy = REPLACEMENTS[replacement]
    settled = 0
    library = library.copy()
    for index in range(len(arrivals)):
        arrival = without_repeats(arrivals[index : index + 1], library)
        if len(arrival) and not len(library):
            library = arrival.copy()
            settled += 1
            continue
        place = policy(library, arrival[0], rng) if len(arrival) else None
        if place is not None:
            library[place] = arrival[0]
            settled += 1
    return library, settled
