"""What is run: the paper's three cases, and readings of what is not legible in it, each as a run's configuration.

A run has as many islands as there are experiments. They are isolated, and one island is one population, so that each
of them is the paper's experiment with random numbers of its own.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fractal_farm.config import RunConfig
from fractal_farm.experiments.methods.presets import PRESETS

CASES = ("case1", "case2", "case3")
_KEPT_WHOLE = ("ours", "clipped")  # of these all accepted offspring are kept, not only distinct designs


@dataclass(frozen=True)
class Scale:
    """How much is run; the paper's numbers by default.

    Attributes:
        experiments: of each case.
        generations: of case 3.
        accepted: offspring in a generation.
        library: random genomes that case 3 begins with.
        fractals: of cases 1 and 2.
        seed: of all of it.
    """

    experiments: int = 10
    generations: int = 15
    accepted: int = 10
    library: int = 100
    fractals: int = 100
    seed: int = 2009


@dataclass(frozen=True)
class Reading:
    """How something illegible may be read.

    Attributes:
        name: a word or two.
        about: what differs from our default reading.
        overrides: of the configuration's evolution section.
    """

    name: str
    about: str
    overrides: tuple[str, ...] = ()

    def config(self, case: str, scale: Scale) -> RunConfig:
        """The run of "case1", "case2" or "case3" under this reading.

        Overrides that mean nothing to a case are left out: random genomes know no operators, and general affine maps
        know neither map form nor sign.
        """
        told: Sequence[str] = self.overrides
        fields = [f"islands={scale.experiments}", "migration.emigrants=0"]
        if case == "case3":
            fields += [f"library.size={scale.library}", f"accepted={scale.accepted}"]
            fields += [f"generations_per_epoch={scale.generations}"]
        else:
            meaningful = ("fitness.",) if case == "case1" else ("fitness.", "phenotype.", "library.map_counts")
            told = [override for override in told if override.startswith(meaningful)]
            fields += ["method=random", "library.size=2", "elimination=0", "generations_per_epoch=1"]
            fields += ["accepted=null", f"offspring={scale.fractals}"]
            fields += ["phenotype.family=affine"] if case == "case1" else []
        whole = case == "case3" and self.name in _KEPT_WHOLE
        run = ["stop.epochs=1", "solids.max=0", f"catalogue.keep={'accepted' if whole else 'distinct'}"]
        preset = PRESETS["paper"].config(scale.seed).to_dict()
        return RunConfig.from_dict(preset, case, [*(f"evolution.{field}" for field in (*fields, *told)), *run])


READINGS = tuple(
    Reading(entry["name"], entry["about"], tuple(entry["overrides"]))
    for entry in tomllib.loads(Path(__file__).with_name("readings.toml").read_text("utf-8"))["reading"]
)
OURS = READINGS[0]
