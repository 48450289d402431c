"""`farm verify`: is everything there that was committed, and is every bit of it as it was written? (DESIGN, 5 and 10).

`verify` only looks, and may look at a live catalogue; `repair` mends what it finds, under the locks of all runs.
"""

from fractal_farm.catalogue.verify.findings import LEVELS, Finding, Level, Report
from fractal_farm.catalogue.verify.repair import Remakers, repair
from fractal_farm.catalogue.verify.verification import verify

__all__ = ["LEVELS", "Finding", "Level", "Remakers", "Report", "repair", "verify"]
