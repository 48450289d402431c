"""The deep look: is every number in the manifest what its genome gives?

Each cloud is grown again and compared with the stored one, each design scored again with the constants of its run;
identities, parents, repeated rows and the content digest are looked at across the whole catalogue.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.formula import formula_by_hand, formula_of
from fractal_farm.catalogue.layout import HAND, crc32c
from fractal_farm.catalogue.parts import PartGoneError, read_commits
from fractal_farm.catalogue.rows import design_table, genome_of
from fractal_farm.catalogue.schema import DESIGN_SCHEMA, ORDER_OF_BIRTH
from fractal_farm.catalogue.shards import SHARD, decoded_slot
from fractal_farm.catalogue.verify.contents import Contents, Part, take_successor
from fractal_farm.catalogue.verify.findings import Finding
from fractal_farm.catalogue.verify.structure import GROW
from fractal_farm.errors import FarmError
from fractal_farm.fitness import FitnessFormula, evaluate, shape_descriptor
from fractal_farm.ifs.gap import gap
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.quantised_cloud import STEPS, QuantisedCloud, dequantise, quantised_attractors
from fractal_farm.ifs.random_iteration import GENERATOR_VERSION, attractor_points
from fractal_farm.ifs.similarity_dimension import similarity_dimension

_SCORES = ("d0", "d2", "lle", "fitness", "d0_error", "d2_error")
_BLOCK = 4 * SHARD
_STEPS_ALIKE = 2
_ALIKE = 1e-6
_COPY = "restore it from a copy"
_ELSEWHERE = "nothing; grown on another kind of machine, or with other versions of numpy and numba"


def content_findings(contents: Contents) -> Iterator[Finding]:
    """What growing and scoring everything again tells."""
    formulas = {run_id: formula_of(description) for run_id, description in contents.runs.items()}
    lineage: dict[str, set[str]] = {}
    parents: dict[str, dict[str, str]] = {}
    births: dict[tuple[Any, ...], tuple[int, str]] = {}
    for part, rows in _blocks(contents):
        formula = formulas.get(part.run_id)
        if part.run_id == HAND:
            formula = formula_by_hand(read_commits(contents.root, part.name)[0].records)
        yield from _block(contents, part, rows, formula)
        for row in rows:
            lineage.setdefault(part.run_id, set()).add(row["design_id"])
            for parent in row["parents"] or ():
                parents.setdefault(part.run_id, {}).setdefault(parent, row["design_id"])
            birth = (row["run_id"], row["design_id"], row["kind"], *(row[name] for name in ORDER_OF_BIRTH))
            told = hash(_told(row))
            first, where = births.setdefault(birth, (told, part.key))
            if first != told:
                problem = f"a row differs from its repetition in {where}"
                yield Finding(part.key, "row", problem, _COPY, (row["design_id"],))
    lineage[HAND] = set().union(*lineage.values())  # what people make may come of any run
    for run_id, children in parents.items():
        for parent, child in sorted(children.items()):
            if parent not in lineage[run_id]:
                problem = f"parent {parent} is not in the manifest of run {run_id}"
                yield Finding(f"runs/{run_id}", "row", problem, "restore the part that held it", (child,))


def _blocks(contents: Contents) -> Iterator[tuple[Part, list[dict[str, Any]]]]:
    """The rows of all parts, some at a time, in the order in which their clouds lie."""
    for part in contents.parts:
        try:
            table = contents.rows(part, DESIGN_SCHEMA.names).sort_by("cloud_row")
        except PartGoneError:  # merged since it was listed: its rows come with those of its successor, at the end
            if take_successor(contents, part.name):
                continue
            raise
        for start in range(0, table.num_rows, _BLOCK):
            yield part, table.slice(start, _BLOCK).to_pylist()


def _block(
    contents: Contents, part: Part, rows: list[dict[str, Any]], formula: FitnessFormula | None
) -> Iterator[Finding]:
    genomes: list[Genome] = []
    sound: list[dict[str, Any]] = []
    for row in rows:
        try:
            genomes.append(genome_of(row))
            sound.append(row)
        except (FarmError, ValueError, TypeError, KeyError):
            problem = "the genome is not the one that the design_id stands for"
            yield Finding(part.key, "row", problem, _COPY, (str(row["design_id"]),))
    if other := {row["generator_version"] for row in sound} - {GENERATOR_VERSION}:
        problem = f"grown by generator {', '.join(map(str, sorted(other)))}, this is {GENERATOR_VERSION}; not compared"
        yield Finding(part.key, "row", problem, "verify with the version that grew it", damage=False)
        return
    yield from _compared_clouds(contents, part, sound, genomes)
    yield from _compared_numbers(part, sound, genomes, formula)


def _compared_clouds(
    contents: Contents, part: Part, rows: list[dict[str, Any]], genomes: list[Genome]
) -> Iterator[Finding]:
    """Stored clouds against the manifest and against those that the genomes give."""
    places = [i for i, row in enumerate(rows) if row["cloud_crc32c"] is not None]
    if not places:
        return
    grown = quantised_attractors([genomes[i] for i in places], rows[places[0]]["n_points"])
    shards: dict[str, bytes | str] = {}
    for number, place in enumerate(places):
        row, cloud, points = rows[place], grown[number], None
        concerned = (row["design_id"],)
        if row["cloud_row"] is not None:
            key = f"clouds/{row['writer']}/{row['cloud_array']}/c.{row['cloud_row'] // SHARD}.0.0"
            if key not in contents.accepted:
                yield Finding(part.key, "row", f"its cloud should lie in {key}, which no part names", _COPY, concerned)
                continue
            if key not in shards:
                shards = {key: contents.read(key)}
            shard = shards[key]
            if isinstance(shard, bytes):
                points = decoded_slot(shard, row["cloud_row"] % SHARD, row["n_points"])
            told = isinstance(shard, str) or concerned[0] in contents.lost.get(key, ())
            if not told and (points is None or _checksum(points) != row["cloud_crc32c"]):
                problem = f"row {row['cloud_row']} is not the cloud that the manifest says"
                yield Finding(key, "cloud", problem, GROW, concerned)
                continue
        if not _grew_alike(row, cloud):
            damage = points is not None and not _nearly_alike(row, points, cloud)
            problem = f"the recorded cloud has {'other points' if damage else 'other bits'} than its genome gives here"
            yield Finding(part.key, "row", problem, _COPY if damage else _ELSEWHERE, concerned, damage=damage)


def _grew_alike(row: Mapping[str, Any], cloud: QuantisedCloud) -> bool:
    """Whether a cloud that was grown again is the recorded one, bit for bit."""
    same_box = np.array_equal(cloud.origin, np.array(row["origin"], np.float32))
    same_box = same_box and bool(cloud.scale == np.float32(row["scale"]))
    return same_box and _checksum(cloud.points) == row["cloud_crc32c"]


def _nearly_alike(row: Mapping[str, Any], points: npt.NDArray[np.uint16], cloud: QuantisedCloud) -> bool:
    """Whether two clouds differ by rounding alone, whatever the order of their points."""
    recorded = np.sort(dequantise(points, row["origin"], row["scale"]), axis=0)
    apart = np.abs(recorded - np.sort(cloud.dequantise(), axis=0)).max()
    return bool(apart <= _STEPS_ALIKE * float(cloud.scale) / STEPS)


def _compared_numbers(
    part: Part, rows: list[dict[str, Any]], genomes: list[Genome], formula: FitnessFormula | None
) -> Iterator[Finding]:
    if not rows:
        return
    others = {commit.fitness for commit in part.commits} - {None, formula.identity if formula else None}
    if others:
        scored_by = ", ".join(sorted(map(str, others)))
        ours = "a configuration that this version does not know" if formula is None else formula.identity
        problem = f"scored by another version of the fitness ({scored_by}, here {ours}); scores not compared"
        yield Finding(part.key, "row", problem, "verify with the version that scored it", damage=False)
        formula = None
    again = recomputed(rows, genomes, formula)
    for name in dict.fromkeys(name for numbers in again for name in numbers):
        pairs = zip(rows, again, strict=True)
        apart = [_difference(row[name], new[name]) if name in new else 0.0 for row, new in pairs]
        worst = int(np.argmax(apart))
        if apart[worst] == 0.0:
            continue
        damage = apart[worst] > _ALIKE
        concerned = tuple(row["design_id"] for row, distance in zip(rows, apart, strict=True) if distance > 0.0)
        problem = f"{name} of {concerned[0] if len(concerned) == 1 else 'these'} is not what the genome gives"
        example = f"{rows[worst]['design_id'][:8]} has {rows[worst][name]}, not {again[worst][name]}"
        remedy = f"{_COPY}, unless another version of the farm computed it" if damage else _ELSEWHERE
        yield Finding(part.key, "row", f"{problem}: {example}", remedy, concerned, damage=damage)


def recomputed(
    rows: Sequence[Mapping[str, Any]], genomes: Sequence[Genome], formula: FitnessFormula | None
) -> list[dict[str, Any]]:
    """What the genomes of rows give here and now: column -> value, for every number that a row holds.

    Args:
        rows: of one run, one or more.
        genomes: theirs.
        formula: constants of eq 3.7; without them no scores.
    """
    again: list[dict[str, Any]] = design_table(genomes, {}).select(["n_maps", "maps", "probabilities"]).to_pylist()
    for genome, row, numbers in zip(genomes, rows, again, strict=True):
        if row["similarity_dimension"] is not None:
            numbers["similarity_dimension"] = similarity_dimension(genome)
        if row["gap"] is not None:
            numbers["gap"] = gap(genome)
        if row["descriptor"] is not None:
            numbers["descriptor"] = shape_descriptor(attractor_points(genome, row["n_points"])).tolist()
    if formula is not None:
        scores = evaluate(genomes, rows[0]["n_points"], formula)
        for name in _SCORES:
            for numbers, value in zip(again, getattr(scores, name).tolist(), strict=True):
                numbers[name] = value
    return again


def _difference(recorded: Any, recomputed: Any) -> float:
    """0 for equal numbers or lists of them; infinite for another length, or a number where there is none."""
    first = np.atleast_1d(np.array(recorded, np.float64))
    second = np.atleast_1d(np.array(recomputed, np.float64))
    if first.shape != second.shape or not np.array_equal(np.isfinite(first), np.isfinite(second)):
        return math.inf
    apart: npt.NDArray[np.float64] = np.abs(first - second) / np.maximum(1.0, np.abs(first))
    return float(np.nanmax(apart, initial=0.0))


def _told(row: Mapping[str, Any]) -> tuple[Any, ...]:
    """What a row says of its design, as far as it is the same however and wherever it was stored."""
    left_out = ("writer", "cloud_array", "cloud_row", "created_us", "distinct")
    return tuple(_hashable(value) for name, value in row.items() if name not in left_out)


def _hashable(value: Any) -> Any:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(map(_hashable, value))
    return "nan" if isinstance(value, float) and math.isnan(value) else value


def _checksum(points: npt.NDArray[np.uint16]) -> int:
    return crc32c(points.astype("<u2", copy=False).tobytes())
