"""A decoder for a camera of which nothing is known but a picture and perhaps a white image."""

import logging

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.calibration.lattice_fit import fit_lattice, lattice_from_picture
from pmcl_ros.lightfield.calibration.light_from_picture import light_from_picture
from pmcl_ros.lightfield.decode import VIEWS, Decoder

_LOG = logging.getLogger(__name__)
_PITCH = 10  # raw px for each view pixel


def uncalibrated_decoder(frame: RawFrame, white: RawFrame | None = None, views: int = VIEWS,
                         size: tuple[int, int] | None = None) -> Decoder:
    """Decodes lattice-aligned views: without a calibration their geometry is not known.

    The lattice is estimated from the white image, or else from the picture, as is the light under
    its lenslets then. views, size: as of `Decoder`.
    Raises LightFieldError when no lattice of lenslets is seen.
    """
    fit = lattice_from_picture(frame) if white is None else fit_lattice(white)
    _LOG.info('lattice from the %s: %s', 'picture itself' if white is None else 'white image',
              fit.lattice)
    height, width = (side // _PITCH for side in frame.counts.shape)
    calibration = Calibration.aligned(fit.lattice, width, height)
    if white is not None:
        return Decoder(calibration, white, views, size)
    light = light_from_picture(frame, fit.lattice)
    return Decoder.of_light(calibration, light, frame.metadata.serial, views, size)
