"""Reading clouds: the points of designs, wherever they are stored, or grown again where they are not.

The arrays of a writer have holes and slots without a design; readers see only the rows that the manifest
names, as one dense (design, point, axis) array that is read in batches.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, overload

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from fractal_farm.catalogue.layout import CLOUDS, crc32c
from fractal_farm.catalogue.rows import GENOME_COLUMNS, genome_of
from fractal_farm.errors import FarmError, InputError

CLOUD_COLUMNS = (
    *GENOME_COLUMNS,
    "writer",
    "cloud_array",
    "cloud_row",
    "n_points",
    "origin",
    "scale",
    "cloud_crc32c",
)


class CloudArrays:
    """The writers' Zarr arrays of one catalogue, each opened once."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._opened: dict[tuple[str, str], Any] = {}

    def read(self, writer: str, name: str, rows: npt.NDArray[np.int64]) -> npt.NDArray[np.uint16]:
        """Rows of the array clouds/<writer>/<name>, in ascending order; zeros where a shard is missing.

        Raises:
            FarmError: the array is missing or damaged.
        """
        import zarr

        path = self._root / CLOUDS / writer / name
        try:
            if (writer, name) not in self._opened:
                self._opened[writer, name] = zarr.open_array(path, mode="r")
            return np.asarray(self._opened[writer, name].oindex[rows], dtype=np.uint16)
        except (OSError, ValueError, KeyError, RuntimeError) as error:
            raise FarmError(
                f"{path}: missing or damaged ({error}); `farm verify {self._root} --repair` grows it again"
            ) from error


class DenseClouds:
    """The clouds of many designs as one (design, point, axis) array; nothing is read before it is asked for.

    Attributes:
        shape: (m, n, 3).
        design_ids: m ids, in the order of the first axis.
    """

    def __init__(self, arrays: CloudArrays, designs: Any) -> None:
        sizes = designs.column("n_points").unique().to_pylist()
        if len(sizes) > 1:
            raise InputError(f"clouds of {sorted(sizes)} points do not fit one array; choose designs of one run")
        self._arrays = arrays
        self._designs = designs
        self.shape = (designs.num_rows, sizes[0] if sizes else 0, 3)
        self.design_ids: list[str] = designs.column("design_id").to_pylist()

    def __len__(self) -> int:
        return len(self.design_ids)

    @overload
    def __getitem__(self, index: int) -> npt.NDArray[np.float64]: ...
    @overload
    def __getitem__(self, index: slice) -> npt.NDArray[np.float64]: ...
    def __getitem__(self, index: int | slice) -> npt.NDArray[np.float64]:
        """Points of one design, (n, 3) float64, or of a slice of designs, (b, n, 3) float64; IFS units.

        Raises:
            FarmError: a cloud is missing or damaged.
        """
        if isinstance(index, slice):
            return self._read(list(range(len(self))[index]))
        points: npt.NDArray[np.float64] = self._read([range(len(self))[index]])[0]
        return points

    def batches(self, size: int = 256) -> Iterator[npt.NDArray[np.float64]]:
        """All clouds in order, (b, n, 3) float64 at a time, b <= size."""
        for start in range(0, len(self), size):
            yield self[start : start + size]

    def _read(self, rows: list[int]) -> npt.NDArray[np.float64]:
        out = np.empty((len(rows), *self.shape[1:]))
        designs = self._designs.take(pa.array(rows, pa.int64())).to_pylist()
        grown: list[int] = []
        stored: dict[tuple[str, str], list[int]] = {}
        for place, design in enumerate(designs):
            if design["cloud_row"] is None:
                grown.append(place)
            else:
                stored.setdefault((design["writer"], design["cloud_array"]), []).append(place)
        for address, places in stored.items():
            cloud_rows = np.array([designs[place]["cloud_row"] for place in places])
            unique, back = np.unique(cloud_rows, return_inverse=True)
            quantised = self._arrays.read(*address, unique)
            for place, points in zip(places, quantised[back], strict=True):
                out[place] = _checked_points(designs[place], points)
        if grown:
            from fractal_farm.ifs.quantised_cloud import quantised_attractors

            clouds = quantised_attractors([genome_of(designs[place]) for place in grown], self.shape[1])
            for i, place in enumerate(grown):
                out[place] = clouds[i].dequantise()
        return out


def _checked_points(design: dict[str, Any], points: npt.NDArray[np.uint16]) -> npt.NDArray[np.float64]:
    """The points of a stored cloud, after a look at their checksum."""
    from fractal_farm.ifs.quantised_cloud import QuantisedCloud

    if crc32c(points.astype("<u2", copy=False).tobytes()) != design["cloud_crc32c"]:
        raise FarmError(
            f"design {design['design_id']}: row {design['cloud_row']} of {CLOUDS}/{design['writer']} is "
            "missing or damaged; `farm verify --repair` grows it again"
        )
    return QuantisedCloud(points, np.array(design["origin"], np.float32), np.float32(design["scale"])).dequantise()
