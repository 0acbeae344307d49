"""LightField: `views`, `views/camera_info` and `views/pupil`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.light_field import VIEW_WHITE, LightField, ViewGrid, views_of_mosaic
from pmcl_ros.messages.camera_info import baseline_from, pinhole_from, pinhole_to_message
from pmcl_ros.messages.header import check_same, header_from, promised_by
from pmcl_ros.messages.image import image_message, pixels_of
from pmcl_ros.messages.types import Buffer, CameraInfo, Image
from pmcl_ros.runtime.errors import MessageError


class LightFieldMessages(NamedTuple):
    """`views/camera_info`, `views/pupil` and `views`, in the order in which they are published."""

    camera_info: CameraInfo
    pupil: Image
    views: Image


def light_field_to_messages(light_field: LightField) -> LightFieldMessages:
    """The mosaic of views, their geometry and their light.

    views: rgb16, rows x columns of views, linear, 32768 at the sensor's white; negative light
        becomes 0, light beyond twice the white 65535.
    pupil: 32FC3 of the grid's size: weight, then the position (x, y) in view steps.
    `gamma` stays behind: it is for looking, and the centre picture has it applied.
    """
    grid, header = light_field.grid, light_field.header
    info = pinhole_to_message(header, grid.pinhole, grid.baseline)
    return LightFieldMessages(info, pupil_to_message(light_field), views_to_message(light_field))


def views_to_message(light_field: LightField, buffer: Buffer | None = None) -> Image:
    """`views` alone of `light_field_to_messages`."""
    (rows, columns), pinhole = light_field.grid.shape, light_field.grid.pinhole
    shape = (rows * pinhole.height, columns * pinhole.width)
    message, mosaic = image_message(light_field.header, 'rgb16', shape, buffer)
    tiles = mosaic.reshape(rows, pinhole.height, columns, pinhole.width, 3)
    for row, column in np.ndindex(rows, columns):
        counts = light_field.views[row, column] * np.float32(VIEW_WHITE)
        counts += np.float32(0.5)
        tiles[row, :, column] = np.clip(counts, 0, 65535, out=counts)
    return message


def pupil_to_message(light_field: LightField, buffer: Buffer | None = None) -> Image:
    """`views/pupil` alone of `light_field_to_messages`."""
    grid = light_field.grid
    message, light = image_message(light_field.header, '32FC3', grid.shape, buffer)
    light[..., 0], light[..., 1:] = grid.weights, grid.positions
    return message


def light_field_from(camera_info: CameraInfo, pupil: Image, views: Image) -> LightField:
    """The inverse of `light_field_to_messages`: three messages of one capture."""
    header = header_from(views.header)
    for name, other in (('views/camera_info', camera_info), ('views/pupil', pupil)):
        check_same(name, header_from(other.header), header)
    pinhole, baseline = pinhole_from(camera_info), baseline_from(camera_info)
    light, mosaic = pupil_from(pupil), mosaic_from(views)
    rows, columns = light.shape[:2]
    expected = (rows * pinhole.height, columns * pinhole.width)
    if mosaic.shape[:2] != expected:
        raise MessageError(
            f'views is {mosaic.shape[1]}x{mosaic.shape[0]} pixels, but {columns}x{rows} views '
            f'(views/pupil) of {pinhole.width}x{pinhole.height} (views/camera_info) make '
            f'{expected[1]}x{expected[0]}')
    linear = views_of_mosaic(mosaic, rows, columns)
    with promised_by('views'):
        grid = ViewGrid(pinhole, baseline, light[..., 1:].astype(float), light[..., 0].copy())
        return LightField(header, linear, grid)


def mosaic_from(views: Image) -> NDArray[np.uint16]:
    """(rows * height, columns * width, 3) counts of a `views` message, its own memory."""
    return pixels_of(views, 'rgb16', 'views')


def pupil_from(message: Image) -> NDArray[np.float32]:
    """(rows, columns, 3): weight, x and y of each view, from a `views/pupil` message."""
    light = pixels_of(message, '32FC3', 'views/pupil')
    if not np.isfinite(light).all() or (light[..., 0] < 0).any():
        raise MessageError('views/pupil holds NaN, infinity or a negative weight; expected the '
                           'weight, x and y of every view')
    return light
