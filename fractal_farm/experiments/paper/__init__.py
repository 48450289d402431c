"""`farm paper`: the experiments, figures and applications of Pang and Hui (2009), made again on the farm.

`cases` says what is run, `trial` runs one of them and keeps its figures, `findings` draws the conclusions, `shapes`
makes the pictures and solids, `page` writes them down beside the paper's, `remake` does all of it.
"""

from fractal_farm.experiments.paper.cases import Scale
from fractal_farm.experiments.paper.remake import FIGURES, remake

__all__ = ["FIGURES", "Scale", "remake"]
