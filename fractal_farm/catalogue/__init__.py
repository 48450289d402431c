"""What is kept: immutable Zarr shards for clouds, immutable Parquet parts for the manifest (DESIGN, 5).

`RunWriter` commits designs, `Catalogue` reads them; `layout` draws the tree.
"""

from fractal_farm.catalogue.beginning import begin_run, is_unbegun, what_is_there
from fractal_farm.catalogue.clouds import DenseClouds
from fractal_farm.catalogue.judging import Judgement, judge, judgements, with_judgements, withdraw
from fractal_farm.catalogue.reader import Catalogue, Usage
from fractal_farm.catalogue.records import (
    committed_records,
    committed_until,
    last_epoch,
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
    "Judgement",
    "RunInfo",
    "RunWriter",
    "SolidInfo",
    "Usage",
    "begin_run",
    "committed_records",
    "committed_until",
    "create_run",
    "design_table",
    "is_unbegun",
    "judge",
    "judgements",
    "last_epoch",
    "latest_snapshot",
    "read_run",
    "record_end",
    "remove_orphans",
    "run_ends",
    "run_ids",
    "run_is_live",
    "run_lock",
    "what_is_there",
    "with_judgements",
    "withdraw",
    "write_snapshot",
]
