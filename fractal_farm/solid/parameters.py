"""What a solid is to be: its size, its wall and how finely it is computed."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from typing import ClassVar

from fractal_farm.errors import InputError

PIPELINE_VERSION = "solid-1"


@dataclass(frozen=True)
class SolidParameters:
    """Parameters of a solid, validated when made.

    Attributes:
        size_mm: longest side of the finished solid, walls included; above 0.
        wall_mm: least thickness, above 0 and below a third of the size, and at least MIN_WALL_VOXELS voxels.
        resolution: voxels along the longest side, 32 to 1000; None for as many as the wall needs, 180 to 400. Holds
            the number afterwards.
        thicken: let the wall grow where the pieces of the design lie too far apart to make one body.

    Raises:
        InputError: a value out of range; names the field, the value and what is allowed.
    """

    MIN_WALL_VOXELS: ClassVar[float] = 3.0
    AUTOMATIC: ClassVar[tuple[int, int]] = (180, 400)

    size_mm: float = 30.0
    wall_mm: float = 0.8
    resolution: int | None = None
    thicken: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "size_mm", float(self.size_mm))
        object.__setattr__(self, "wall_mm", float(self.wall_mm))
        if not (math.isfinite(self.size_mm) and self.size_mm > 0.0):
            raise InputError(f"size_mm is {self.size_mm}; give a length above 0")
        if not (math.isfinite(self.wall_mm) and 0.0 < self.wall_mm < self.size_mm / 3.0):
            raise InputError(
                f"wall_mm is {self.wall_mm}; give a length above 0 and below a third of size_mm ({self.size_mm:g})"
            )
        voxels = self.resolution
        if voxels is None:
            fewest, most = self.AUTOMATIC
            voxels = min(max(fewest, math.ceil(self.MIN_WALL_VOXELS * self.size_mm / self.wall_mm - 1e-9)), most)
            object.__setattr__(self, "resolution", voxels)
        if not 32 <= voxels <= 1000:
            raise InputError(f"resolution is {voxels}; give 32 to 1000 voxels")
        if self.wall_mm < self.MIN_WALL_VOXELS * self.voxel_mm * (1.0 - 1e-9):
            raise InputError(
                f"wall_mm of {self.wall_mm:g} is {self.wall_mm / self.voxel_mm:.1f} voxels; it must be "
                f"{self.MIN_WALL_VOXELS:g}: resolution >= "
                f"{math.ceil(self.MIN_WALL_VOXELS * self.size_mm / self.wall_mm)}, "
                f"wall_mm >= {self.MIN_WALL_VOXELS * self.voxel_mm:.3g}, or "
                f"size_mm <= {self.wall_mm * voxels / self.MIN_WALL_VOXELS:.4g}"
            )

    @property
    def voxel_mm(self) -> float:
        """Edge of a voxel, mm."""
        assert self.resolution is not None
        return self.size_mm / self.resolution

    @property
    def hash(self) -> str:
        """16 hex digits over the parameters and the version of the pipeline."""
        content = json.dumps([PIPELINE_VERSION, asdict(self)], sort_keys=True)
        return hashlib.blake2b(content.encode(), digest_size=8, person=b"farm-solid-1").hexdigest()
