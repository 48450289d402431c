"""Steering requests: designs that somebody wants a run to breed from, bound to epochs (DESIGN section 5, 'Runs').

A wish, runs/<run id>/wish~<time>~<crc32c>.json, may be written by anybody at any time. Whoever holds the run's lock
binds it to epochs that nobody has begun: runs/<run id>/steering~<number>~<crc32c>.json is written once, before the
first of these epochs starts, and from then on belongs to what the run is.
"""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fractal_farm.catalogue.documents import encoded_document, read_document
from fractal_farm.catalogue.durable import put
from fractal_farm.catalogue.layout import crc32c, run_directory
from fractal_farm.errors import FarmError
from fractal_farm.ifs.genome import Genome
from fractal_farm.ifs.symmetry import NO_SYMMETRY

STEERED_EPOCHS = 10
_WISH = re.compile(r"wish~\d{19}~[0-9a-f]{8}\.json")
_STEERING = re.compile(r"steering~(\d{4})~[0-9a-f]{8}\.json")


@dataclass(frozen=True)
class SteeringRequest:
    """A wish that is bound to epochs.

    Attributes:
        first: the first epoch that breeds from the designs.
        last: the last one.
        wish: name of the wish.
        design_ids: the designs, 32 hex digits each.
        genes: their rows, (N, K) float64 each.
        symmetries: their symmetries.
    """

    first: int
    last: int
    wish: str
    design_ids: tuple[str, ...]
    genes: tuple[npt.NDArray[np.float64], ...]
    symmetries: tuple[str, ...]


def record_wish(root: Path, run_id: str, genomes: Sequence[Genome]) -> str:
    """Wish that a run breeds from some genomes, durably; the name of the wish.

    Args:
        root: directory of the catalogue.
        run_id: id of the run.
        genomes: of the run's phenotype, without probabilities set by hand.

    Raises:
        FarmError: the file system failed.
    """
    designs = [
        {"design_id": genome.design_id, "genes": genome.genes.tolist(), "symmetry": genome.symmetry}
        for genome in genomes
    ]
    content = encoded_document({"designs": designs})
    name = f"wish~{time.time_ns():019d}~{crc32c(content):08x}.json"
    put(run_directory(root, run_id) / name, content)
    return name


def bind_wishes(root: Path, run_id: str, epoch: int) -> list[SteeringRequest]:
    """Bind the wishes that wait to an epoch and those after it; the caller holds the run's lock.

    Args:
        root: directory of the catalogue.
        run_id: id of the run.
        epoch: the first epoch that nobody has begun, and nobody can.

    Returns:
        The new requests, in order; they are durable.

    Raises:
        StorageFullError: no space left; wishes before the one that found none are bound.
        FarmError: a document is damaged, or the file system failed.
    """
    directory = run_directory(root, run_id)
    waiting = sorted(path for path in directory.glob("wish~*.json") if _WISH.fullmatch(path.name))
    if not waiting:
        return []
    known = steering_requests(root, run_id)
    bound = {request.wish for request in known}
    number = len(known)
    for path in waiting:
        if path.name not in bound:  # a crash may have left a wish that is bound
            designs = read_document(path)["designs"]
            facts = {"first": epoch, "last": epoch + STEERED_EPOCHS - 1, "wish": path.name, "designs": designs}
            content = encoded_document(facts)
            put(directory / f"steering~{number:04d}~{crc32c(content):08x}.json", content)
            number += 1
        path.unlink()
    return steering_requests(root, run_id)[len(known) :]


def steering_requests(root: Path, run_id: str) -> list[SteeringRequest]:
    """The requests that a run is bound to, in order.

    Raises:
        FarmError: one of them is damaged or missing.
    """
    directory = run_directory(root, run_id)
    found = sorted(path for path in directory.glob("steering~*.json") if _STEERING.fullmatch(path.name))
    requests = []
    for number, path in enumerate(found):
        if not path.name.startswith(f"steering~{number:04d}~"):
            raise FarmError(f"{directory}: steering~{number:04d} is missing; restore it from a copy")
        document = read_document(path)
        requests.append(
            SteeringRequest(
                document["first"],
                document["last"],
                document["wish"],
                tuple(design["design_id"] for design in document["designs"]),
                tuple(np.array(design["genes"], np.float64) for design in document["designs"]),
                tuple(design.get("symmetry", NO_SYMMETRY) for design in document["designs"]),
            )
        )
    return requests
