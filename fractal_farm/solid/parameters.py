"""What a solid is to be: its size, its wall, how finely it is computed, and what is built onto it."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar

from fractal_farm.errors import InputError

PIPELINE_VERSION = "solid-4"
BASES = ("none", "plate", "stand")
BAILS = ("none", "ring")
_ALWAYS = ("size_mm", "wall_mm", "resolution", "thicken")


@dataclass(frozen=True)
class SolidParameters:
    """Parameters of a solid, validated when made.

    Attributes:
        size_mm: longest side of the finished fractal, walls included; above 0. Base, bail and sprue do not count: they
            are put onto a body of this size.
        wall_mm: least thickness, above 0 and below a third of the size, and at least MIN_WALL_VOXELS voxels.
        resolution: voxels along the longest side, 32 to 1000; None for as many as the wall needs, 180 to 400. Holds
            the number afterwards.
        thicken: let the wall grow where the pieces of the design lie too far apart to make one body.
        bridges: join pieces that lie apart by struts as thick as the wall, repeated at all scales; the wall then stays.
        closing_mm: radius below which creases and slits are filled, 0 to a quarter of the size; 0: none.
        shell_mm: what is thicker than `shell_above_mm` is hollowed as far as this thickness, and drained; 0: nothing,
            else at least the wall.
        shell_above_mm: thickness that is still left solid; above twice the shell by 2 voxels at least.
        drain_mm: diameter of the holes through which hollows open: 2 voxels to half of `shell_above_mm`.
        base: "none"; "plate": a disc that the lowest part stands in; "stand": a disc with a column below the piece.
        bail: "none", or "ring": a ring on the highest point, to hang the piece by.
        bail_hole_mm: inner diameter of the ring, 0.5 to 20.
        engrave: cut the design code into the underside of the base, 0.4 walls deep.
        sprue: a cone below the lowest point through which metal flows in; not together with a base.

    Raises:
        InputError: a value out of range; names the field, the value and what is allowed.
    """

    MIN_WALL_VOXELS: ClassVar[float] = 3.0
    AUTOMATIC: ClassVar[tuple[int, int]] = (180, 400)

    size_mm: float = 30.0
    wall_mm: float = 0.8
    resolution: int | None = None
    thicken: bool = True
    bridges: bool = False
    closing_mm: float = 0.0
    shell_mm: float = 0.0
    shell_above_mm: float = 4.0
    drain_mm: float = 2.0
    base: str = "none"
    bail: str = "none"
    bail_hole_mm: float = 3.0
    engrave: bool = False
    sprue: bool = False

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name.endswith("_mm"):
                object.__setattr__(self, field.name, float(getattr(self, field.name)))
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
        self._check_features()

    @property
    def voxel_mm(self) -> float:
        """Edge of a voxel, mm."""
        assert self.resolution is not None
        return self.size_mm / self.resolution

    @property
    def asked_for(self) -> dict[str, Any]:
        """Size, wall, resolution, thickening, and of the rest what differs from its default; fit for JSON.

        What a solid without a feature is called does not change when there are more features.
        """
        values = asdict(self)
        defaults = {field.name: field.default for field in fields(self)}
        return {name: value for name, value in values.items() if name in _ALWAYS or value != defaults[name]}

    @property
    def hash(self) -> str:
        """16 hex digits over what is asked for and the version of the pipeline."""
        content = json.dumps([PIPELINE_VERSION, self.asked_for], sort_keys=True)
        return hashlib.blake2b(content.encode(), digest_size=8, person=b"farm-solid-1").hexdigest()

    def _check_features(self) -> None:
        voxel = self.voxel_mm
        if not 0.0 <= self.closing_mm <= self.size_mm / 4.0:
            raise InputError(
                f"closing_mm is {self.closing_mm:g}; give 0 to a quarter of size_mm ({self.size_mm / 4.0:g})"
            )
        if not (math.isfinite(self.shell_mm) and (self.shell_mm == 0.0 or self.shell_mm >= self.wall_mm)):
            raise InputError(f"shell_mm is {self.shell_mm:g}; give 0 or at least wall_mm ({self.wall_mm:g})")
        if self.shell_mm > 0.0:
            least = 2.0 * self.shell_mm + 2.0 * voxel
            if not self.shell_above_mm >= least:
                raise InputError(
                    f"shell_above_mm is {self.shell_above_mm:g}, no room for a hollow inside a shell_mm of "
                    f"{self.shell_mm:g}: shell_above_mm >= {math.ceil(least * 100.0) / 100.0:g}, or shell_mm <= "
                    f"{math.floor((0.5 * self.shell_above_mm - voxel) * 100.0) / 100.0:g}"
                )
            if not 2.0 * voxel <= self.drain_mm <= self.shell_above_mm / 2.0:
                raise InputError(
                    f"drain_mm is {self.drain_mm:g}; give {2.0 * voxel:.3g} (2 voxels) to half of shell_above_mm "
                    f"({self.shell_above_mm / 2.0:g})"
                )
        for name, allowed in (("base", BASES), ("bail", BAILS)):
            if getattr(self, name) not in allowed:
                raise InputError(f"{name} is {getattr(self, name)!r}; choose from {', '.join(allowed)}")
        if not 0.5 <= self.bail_hole_mm <= 20.0:
            raise InputError(f"bail_hole_mm is {self.bail_hole_mm:g}; give 0.5 to 20")
        if self.engrave and self.base == "none":
            raise InputError("engrave is True, and there is no base to engrave; give a base, plate or stand")
        if self.sprue and self.base != "none":
            raise InputError(f"sprue and base {self.base!r} would both be below the piece; leave one out")
