"""RawFrame: one picture in the counts of the sensor, with the camera's metadata."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.geometry.header import Header
from pmcl_ros.runtime.errors import CameraError

# The mosaic of every first-generation Lytro: row 0 is B G B G, row 1 is G R G R.
TILE, UPPER_LEFT = 'r,gr:gb,b', 'b'


@dataclass(frozen=True)
class RawFrame:
    """One picture and its metadata.

    counts: (height, width) uint16, 0..4095, BGGR mosaic.
    """

    header: Header
    counts: NDArray[np.uint16]
    metadata: CameraMetadata

    def __post_init__(self) -> None:
        image = self.metadata.image
        if self.counts.shape != (image.height, image.width):
            size = 'x'.join(str(side) for side in self.counts.shape[::-1])
            raise CameraError(f'raw frame is {size} pixels, its metadata says {image.width}x'
                              f'{image.height}; do the .RAW and the .TXT belong together?')
        mosaic = image.rawDetails.mosaic
        if (mosaic.tile, mosaic.upperLeftPixel) != (TILE, UPPER_LEFT):
            raise CameraError(
                f'mosaic {mosaic.tile!r} from {mosaic.upperLeftPixel!r} is not supported, only '
                f'{TILE!r} from {UPPER_LEFT!r} (BGGR), as of a first-generation Lytro')
        if int(self.counts.max(initial=0)) > 4095:
            raise CameraError(
                f'raw frame holds a count of {self.counts.max()}, a 12-bit sensor ends at 4095; '
                'publish the counts of the camera itself, not shifted to 16 bits')

    def linear(self) -> NDArray[np.float32]:
        """(height, width) linear light: 0 at the black level, 1 at the white level."""
        black, white = self.metadata.black, self.metadata.white
        return (self.counts - np.float32(black)) * np.float32(1 / (white - black))
