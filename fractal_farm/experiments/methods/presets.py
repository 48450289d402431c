"""The ways to search that are compared, each as somebody would configure it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fractal_farm.config import RunConfig
from fractal_farm.errors import InputError


@dataclass(frozen=True)
class Preset:
    """A way to search.

    Attributes:
        name: as the command line has it.
        about: what it is, in a line.
        evolution: the evolution section of its configuration; what it leaves out has its default.
    """

    name: str
    about: str
    evolution: Mapping[str, Any]

    def config(self, seed: int) -> RunConfig:
        """The configuration with a seed."""
        return RunConfig.from_dict({"name": self.name, "evolution": {**self.evolution, "seed": seed}}, self.name)


_ONE_ISLAND = {"islands": 1, "migration": {"topology": "isolated"}}
_ONE_POPULATION = {**_ONE_ISLAND, "similarity_dimension": None}

PRESETS = {
    preset.name: preset
    for preset in (
        Preset("niches", "the default: an archive of distinct designs on each of eight islands", {"method": "niches"}),
        Preset("niches-one", "the same with one archive for all", {**_ONE_ISLAND, "method": "niches"}),
        Preset(
            "paper",
            "the paper's algorithm, as in configs/paper.yaml: a library that grows, one population",
            {**_ONE_POPULATION, "method": "paper", "library": {"growth": "append"}, "accepted": 10},
        ),
        Preset("best", "a library of the best 100 on each of eight islands, crisp candidates only", {"method": "best"}),
        Preset(
            "best-plain",
            "a library of the best 100, one population, any candidate",
            {**_ONE_POPULATION, "method": "best"},
        ),
        Preset("random", "random genomes, crisp candidates only", {"method": "random"}),
        Preset("random-plain", "random genomes, any candidate", {**_ONE_POPULATION, "method": "random"}),
    )
}


def chosen_presets(names: str) -> list[Preset]:
    """The presets in a list with commas.

    Raises:
        InputError: a name that is none, or one that stands there twice.
    """
    wanted = [name.strip() for name in names.split(",")]
    if unknown := [name for name in wanted if name not in PRESETS]:
        raise InputError(f"--methods {unknown[0]!r}: no such method; choose from {', '.join(PRESETS)}")
    if len(set(wanted)) < len(wanted):
        raise InputError(f"--methods {names}: name each method once")
    return [PRESETS[name] for name in wanted]
