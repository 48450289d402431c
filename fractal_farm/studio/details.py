"""All that is known of one design, as the design page shows it: the same from a server and in a static export."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue import SolidInfo
from fractal_farm.catalogue.judging import NONE, Judgement
from fractal_farm.catalogue.layout import HAND
from fractal_farm.catalogue.lineage import Lineage
from fractal_farm.catalogue.rows import genome_of
from fractal_farm.ifs.design_code import design_code
from fractal_farm.ifs.symmetry import NO_SYMMETRY
from fractal_farm.studio.genomes import json_of_genome
from fractal_farm.studio.worker import plain

_SCORES = ("fitness", "d0", "d2", "lle", "gap", "similarity_dimension", "grams", "width_mm", "depth_mm", "niche")
_MOST_MEMBERS = 48
_MOST_CHILDREN = 200
_MOST_RELATIVES = 150
_DEPTH = 12

RowOf = Callable[[str], int | None]


def details(
    row: Mapping[str, Any],
    row_of: RowOf,
    representatives: npt.NDArray[Any],
    children: Sequence[str],
    judgement: Judgement | None,
    solids: Sequence[SolidInfo],
    directory: str,
) -> dict[str, Any]:
    """A design, fit for JSON.

    Args:
        row: its row of the manifest.
        row_of: row of a design on the pages, from its id; None if it has none.
        representatives: (n,) first row of each row's group.
        children: ids of the designs that were made from it.
        judgement: what is thought of it.
        solids: its finished solids.
        directory: how commands name the catalogue.
    """
    identity, place = row["design_id"], row_of(row["design_id"])
    genome = genome_of(row)
    by_hand = row["run_id"] == HAND
    born = None if by_hand else {k: row[k] for k in ("run_id", "island", "epoch", "generation", "slot")}
    told = {
        "design_id": identity,
        "row": place,
        "code": design_code(identity),
        "n_maps": row["n_maps"],
        "genome": json_of_genome(genome),
        "maps": [row["maps"][k : k + 12] for k in range(0, len(row["maps"]), 12)],
        "probabilities": row["probabilities"],
        "scores": {name: row[name] for name in _SCORES},
        "errors": {"d0": row["d0_error"], "d2": row["d2_error"]},
        "symmetry": row["symmetry"] or NO_SYMMETRY,
        "operator": row["operator"],
        "points": row["n_points"],
        "created": None if row["created_us"] is None else f"{row['created_us'].isoformat(timespec='seconds')}Z",
        "by_hand": by_hand,
        "born": born,
        "parents": [{"design_id": parent, "row": row_of(parent)} for parent in dict.fromkeys(row["parents"] or ())],
        "children": [{"design_id": child, "row": row_of(child)} for child in children[:_MOST_CHILDREN]],
        "group": _group(place, representatives),
        "judgement": judgement_json(judgement),
        "solids": [
            {"parameters_hash": solid.parameters_hash, "files": sorted(solid.files), "facts": solid.facts}
            for solid in solids
        ],
        "commands": commands(directory, identity),
    }
    found: dict[str, Any] = plain(told)
    return found


def commands(directory: str, design_id: str) -> dict[str, str]:
    """The command lines that do the same as the page."""
    where, short = shlex.quote(directory), design_id[:8]
    return {
        "show": f"farm show {where} {short}",
        "mesh": f"farm mesh {where} {short} --output solids",
        "certify": f"farm certify {where} {short}",
        "render": f"farm render {where} {short} --output {short}.png",
        "breed": f"farm breed {where} {short} --into",
        "lineage": f"farm lineage {where} {short}",
        "similar": f"farm similar {where} {short}",
        "rate": f"farm rate {where} {short} --stars 5",
    }


def judgement_json(judgement: Judgement | None) -> dict[str, Any]:
    """What is thought of a design; rating 0 where nobody has given stars."""
    thought = judgement or NONE
    return {"rating": thought.stars or 0, "favourite": thought.favourite, "rejected": thought.stars == 0}


def children_of(lineage: Lineage, design_id: str) -> list[str]:
    """Ids of the designs that were made from one, in order of rows."""
    found = lineage.children.of(lineage.find(design_id))
    return list(dict.fromkeys(facts["design_id"] for facts in lineage.facts(found)))


def ancestry(lineage: Lineage, design_id: str, row_of: RowOf) -> list[dict[str, Any]]:
    """A design and its ancestors, nearest first, at most `_MOST_RELATIVES` of them."""
    nodes: list[dict[str, Any]] = []
    for steps, rows in lineage.walk(lineage.parents, lineage.find(design_id), _DEPTH):
        for facts in lineage.facts(rows[: _MOST_RELATIVES - len(nodes)]):
            nodes.append(
                {
                    "design_id": facts["design_id"],
                    "row": row_of(facts["design_id"]),
                    "steps": steps,
                    "operator": facts["operator"],
                    "fitness": facts["fitness"],
                    "generation": facts["generation"],
                    "kind": facts["kind"],
                    "parents": list(dict.fromkeys(facts["parents"] or ())),
                }
            )
        if len(nodes) >= _MOST_RELATIVES:
            break
    found: list[dict[str, Any]] = plain(nodes)
    return found


def _group(row: int | None, representatives: npt.NDArray[Any]) -> dict[str, Any]:
    if row is None:
        return {"representative": None, "members": [], "size": 0}
    first = int(representatives[row])
    members = np.flatnonzero(representatives == first)
    return {"representative": first, "members": members[:_MOST_MEMBERS].tolist(), "size": len(members)}
