"""`farm experiment methods`: which way to search finds the most designs that differ, print and are crisp.

`presets` says what is compared, `course` runs it, `remeasured` looks at what was found with other eyes, `trial` keeps
one method and seed, `comparison` runs all of them, `verdict` holds them against the aims, `page` writes it down.
"""

from fractal_farm.experiments.methods.comparison import compare
from fractal_farm.experiments.methods.presets import chosen_presets

__all__ = ["chosen_presets", "compare"]
