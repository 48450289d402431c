"""What is kept: immutable Zarr shards for clouds, immutable Parquet parts for the manifest (DESIGN, 5).

`RunWriter` commits designs, `Catalogue` reads them; `layout` draws the tree.
"""

from fractal_farm.catalogue.clouds import DenseClouds
from fractal_farm.catalogue.reader import Catalogue, Usage
from fractal_farm.catalogue.records import (
    committed_records,
    committed_until,
    latest_snapshot,
    remove_orphans,
    write_snapshot,
)
from fractal_farm.catalogue.rows import design_table
from fractal_farm.catalogue.runs import (
    RunInfo,
    create_run,
    read_run,
    record_end,
    run_ends,
    run_ids,
    run_is_live,
    run_lock,
)
from fractal_farm.catalogue.solids import SolidInfo
from fractal_farm.catalogue.writer import CommitReceipt, RunWriter

__all__ = [
    "Catalogue",
    "CommitReceipt",
    "DenseClouds",
    "RunInfo",
    "RunWriter",
    "SolidInfo",
    "Usage",
    "committed_records",
    "committed_until",
    "create_run",
    "design_table",
    "latest_snapshot",
    "read_run",
    "record_end",
    "remove_orphans",
    "run_ends",
    "run_ids",
    "run_is_live",
    "run_lock",
    "write_snapshot",
]
