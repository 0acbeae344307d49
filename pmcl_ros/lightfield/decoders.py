"""The decoder for a picture: by calibration and white images, or from the picture alone."""

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.camera.white_images import WhiteChoice, WhiteImages
from pmcl_ros.lightfield.calibration.lytro.calibration import RAW_PITCH, Calibration
from pmcl_ros.lightfield.decode import VIEWS, Decoder
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.white_image import is_white_image, unevenness
from pmcl_ros.runtime.errors import LightFieldError

_LOG = logging.getLogger(__name__)


class Decoders:
    """Decodes each picture with its fitting white image; the last decoder is kept.

    white: a white image of the calibrated camera, or a folder of white images. A single file is
    read at once, files of a folder when a picture needs them. chosen: called with the reason of
    each choice, which is also logged. views, size: as of `Decoder`.
    Raises CameraError or LightFieldError when no white image fits the calibration.
    """

    def __init__(self, calibration: Calibration, white: Path | str,
                 chosen: Callable[[str], None] | None = None, views: int = VIEWS,
                 size: tuple[int, int] | None = None) -> None:
        self._calibration, self._whites = calibration, WhiteImages(white)
        self._chosen = chosen
        self._views, self._size = views, size
        self._settings: tuple[object, ...] | None = None  # of the camera, at the last picture
        self._decoder: Decoder | None = None
        self._path: Path | None = None  # of the white image of the decoder
        serials = self._whites.serials
        if calibration.serial and serials and calibration.serial not in serials:
            raise LightFieldError(
                f'the white images at {white} are of camera {", ".join(serials)}, the calibration '
                f'is for {calibration.serial}; use the calibration and the white image of one '
                'camera')
        if self._whites.path.is_file():
            self.decoder_for(self._whites.first)

    @property
    def serial(self) -> str:
        """Serial number of the calibrated camera; empty: unknown."""
        return self._calibration.serial

    def decoder_for(self, picture: CameraMetadata) -> Decoder:
        """The decoder for a picture with these metadata; errors as of `WhiteImages.choose`."""
        settings = picture.serial, picture.zoom, picture.focus
        if self._decoder is None or settings != self._settings:
            self._check_lens(picture)
            choice = self._whites.choose(picture)
            if self._decoder is None or choice.path != self._path:
                self._decoder = Decoder(self._calibration, choice.frame, self._views, self._size)
                self._path = choice.path
                _LOG.info('white image: %s', choice.why)
                _check_white(choice)
                if self._chosen is not None:
                    self._chosen(choice.why)
            self._settings = settings
        return self._decoder

    def decode(self, frame: RawFrame) -> LightField:
        """The views of one raw frame."""
        return self.decoder_for(frame.metadata).decode(frame)

    def _check_lens(self, picture: CameraMetadata) -> None:
        """Warn when zoom or focus differ from the calibration's."""
        calibration = self._calibration
        for name, found, expected in (('zoom', picture.zoom, calibration.zoom),
                                      ('focus', picture.focus, calibration.focus)):
            if None not in (found, expected) and found != expected:
                _LOG.warning('the picture was taken at %s step %g, the calibration is for %g: '
                             'poses will be off; calibrate at the %s of the pictures', name,
                             found, expected, name)


def _check_white(choice: WhiteChoice) -> None:
    """Warn where a picture is taken for a white image, as far as its light tells."""
    if is_white_image(choice.frame):
        return
    uneven = unevenness(choice.frame)
    if np.isfinite(uneven):
        _LOG.warning('%s seems to be no white image: its light is uneven by %.0f %%, that of one '
                     'by 1 %%; views and poses may be wrong', choice.path, 100 * uneven)


def uncalibrated_decoder(frame: RawFrame, white: RawFrame | None = None, views: int = VIEWS,
                         size: tuple[int, int] | None = None) -> Decoder:
    """A decoder of lattice-aligned views, whose geometry is unknown without a calibration.

    The lattice is estimated from the white image, else lattice and light are estimated from the
    picture. views, size: as of `Decoder`.
    Raises LightFieldError when the image shows no lattice of lenslets.
    """
    # Here: they import large parts of scipy, which the decode by a calibration does not need.
    from pmcl_ros.lightfield.calibration.lytro.lattice_fit import fit_lattice, lattice_from_picture
    from pmcl_ros.lightfield.light_from_picture import light_from_picture
    fit = lattice_from_picture(frame) if white is None else fit_lattice(white)
    _LOG.info('lattice from the %s: %s', 'picture itself' if white is None else 'white image',
              fit.lattice)
    height, width = (side // RAW_PITCH for side in frame.counts.shape)
    calibration = Calibration.aligned(fit.lattice, width, height)
    return Decoder(calibration, light_from_picture(frame, fit.lattice) if white is None else white,
                   views, size)
