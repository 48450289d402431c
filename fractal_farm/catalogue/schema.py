"""The manifest's columns: one row is one kept design, or an ancestor of one (research 'storage', 4.3; DESIGN, 5).

Every column has a unit and a meaning in its metadata. Minor versions may add nullable columns at the end;
readers ignore what they do not know and find null in what an older part does not have.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import pyarrow as pa

DESCRIPTOR_LENGTH = 14


class Column(NamedTuple):
    """One column: name, Arrow type, unit ("" if it is no quantity), meaning."""

    name: str
    type: Any
    unit: str
    meaning: str


_TEXT = pa.string()
_NUMBER = pa.float64()
_AS_A_SOLID = "30 mm long with a wall of 0.8 mm, whatever size its run makes"
_NUMBERS = pa.list_(pa.field("element", pa.float64()))

PLACE = (
    Column("run_id", _TEXT, "", "run that kept the design"),
    Column("writer", _TEXT, "", "writer whose clouds hold the points: clouds/<writer>"),
    Column("cloud_array", _TEXT, "", "array of the writer's group; null if the cloud is not stored"),
    Column("cloud_row", pa.int64(), "", "row in that array; null if the cloud is not stored"),
    Column("n_points", pa.int32(), "points", "points of the cloud that was scored"),
    Column(
        "origin",
        pa.list_(pa.field("element", pa.float32()), 3),
        "IFS units",
        "xyz = origin + scale * q / 65535",
    ),
    Column("scale", pa.float32(), "IFS units", "xyz = origin + scale * q / 65535"),
    Column("cloud_crc32c", pa.uint32(), "", "CRC32C of the quantised points, little-endian uint16"),
    Column("created_us", pa.timestamp("us"), "us", "time of the commit, UTC"),
)
"""What the writer of a catalogue adds to a row; empty cells where there is no cloud."""

DESIGN = (
    Column("design_id", _TEXT, "", "32 hex digits, hash of the canonical genome; primary key"),
    Column("kind", _TEXT, "", "design, or ancestor: a design's parent that was not kept, without a cloud"),
    Column("island", pa.int16(), "", "island of birth"),
    Column("epoch", pa.int32(), "", "epoch of birth"),
    Column("generation", pa.int32(), "", "generation of birth"),
    Column("slot", pa.int32(), "", "place among the candidates of its generation"),
    Column("n_maps", pa.int8(), "maps", "number of maps N"),
    Column("family", _TEXT, "", "similarity (eq 3.2) or affine (eq 2.1)"),
    Column("influence", _NUMBER, "1", "alpha of eq 3.4"),
    Column("map_form", _TEXT, "", "reading of eq 3.2"),
    Column("rotation_sign", pa.int8(), "1", "1, or -1 for all angles negated"),
    Column("genes", _NUMBERS, "rad | 1", "N rows of 7 (or 12 if affine) in stored order, row-major"),
    Column("maps", _NUMBERS, "1", "N resolved 3 x 4 maps [A | b] in stored order, row-major"),
    Column("probabilities", _NUMBERS, "1", "N selection probabilities in stored order"),
    Column("probabilities_by_hand", pa.bool_(), "", "whether somebody set the probabilities"),
    Column("d0", _NUMBER, "1", "capacity dimension"),
    Column("d2", _NUMBER, "1", "correlation dimension"),
    Column("lle", _NUMBER, "nats/iteration", "largest Lyapunov exponent"),
    Column("fitness", _NUMBER, "1", "eq 3.7, with the constants of the run"),
    Column("d0_error", _NUMBER, "1", "standard error of d0"),
    Column("d2_error", _NUMBER, "1", "standard error of d2"),
    Column(
        "descriptor",
        pa.list_(pa.field("element", pa.float32()), DESCRIPTOR_LENGTH),
        "1",
        "shape, invariant to motion and scale",
    ),
    Column("similarity_dimension", _NUMBER, "1", "solution of Moran's equation"),
    Column("gap", _NUMBER, "longest side of the box", "longest edge between first-level pieces"),
    Column("niche", pa.int32(), "", "niche of the archive; null without one"),
    Column("parents", pa.list_(pa.field("element", _TEXT)), "", "design_ids of the parents"),
    Column("operator", _TEXT, "", "how the design was made from its parents"),
    Column("generator_version", _TEXT, "", "version of the random iteration that grew the cloud"),
    Column("distinct", pa.bool_(), "", "whether its shape was new to its run; if runs were merged: no better has it"),
    Column("grams", _NUMBER, "g", f"estimate: mass of its solid in cast silver, {_AS_A_SOLID}"),
    Column("width_mm", _NUMBER, "mm", f"the second longest side of that solid's box, {_AS_A_SOLID}"),
    Column("depth_mm", _NUMBER, "mm", f"the shortest side of that solid's box, {_AS_A_SOLID}"),
    Column("symmetry", _TEXT, "", "isometries whose images of the attractor make the shape; null means none"),
)
"""What a run knows of a design."""

OPTIONAL = frozenset({"distinct", "niche", "gap", "similarity_dimension", "descriptor", "d0_error", "d2_error"}) | {
    "grams",
    "width_mm",
    "depth_mm",
}
"""Columns that a commit may leave out; they become null."""

KINDS = ("design", "ancestor")
PLANTED = "seed"
"""Operator of a design that was not bred in the run but given to it."""
ORDER_OF_BIRTH = ("epoch", "island", "generation", "slot")


def _schema(columns: tuple[Column, ...]) -> Any:
    return pa.schema([pa.field(c.name, c.type, metadata={"unit": c.unit, "meaning": c.meaning}) for c in columns])


GIVEN_SCHEMA = _schema(DESIGN)
"""The table that `RunWriter.commit` takes."""

DESIGN_SCHEMA = _schema((DESIGN[0], *PLACE[:2], *DESIGN[1:], *PLACE[2:]))
"""The table that `Catalogue.designs` returns."""
