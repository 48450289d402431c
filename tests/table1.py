"""The paper's table 1, and the selection probabilities that NOTES works out by hand."""

from fractal_farm.bench.genomes import TABLE1

__all__ = ["PROBABILITIES", "TABLE1"]

PROBABILITIES = {
    "06447": (0.0833, 0.8333, 0.0833),
    "06582": (0.125, 0.875),
    "06425": (0.0833, 0.1964, 0.7203),
    "06328": (0.4312, 0.4855, 0.0833),
}
