"""Points to numbers: fractal dimensions, Lyapunov exponent, fitness (eq 3.7) and the shape descriptor.

`evaluate` scores genomes, `evaluate_batch` is the hot path of the farm, and the other names measure single clouds.
"""

from fractal_farm.fitness.descriptor import shape_descriptor
from fractal_farm.fitness.dimensions import capacity_dimension, correlation_dimension, pair_counts
from fractal_farm.fitness.evaluation import Evaluation, evaluate, evaluate_batch
from fractal_farm.fitness.foreseen import Foreseen, foresee
from fractal_farm.fitness.formula import FitnessFormula
from fractal_farm.fitness.lyapunov import lyapunov_exponent
from fractal_farm.ifs.genome import Refusal

__all__ = [
    "Evaluation",
    "FitnessFormula",
    "Foreseen",
    "Refusal",
    "capacity_dimension",
    "correlation_dimension",
    "evaluate",
    "evaluate_batch",
    "foresee",
    "lyapunov_exponent",
    "pair_counts",
    "shape_descriptor",
]
