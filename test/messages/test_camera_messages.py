"""Images and camera_infos of ordinary cameras are read as what they are, or refused."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.camera_info import lens_from
from pmcl_ros.messages.image import colours_from, decompressed_from
from pmcl_ros.runtime.errors import MessageError

RED, GREEN, BLUE = range(3)
# Of the pixels (0, 0), (0, 1), (1, 0), (1, 1), as the names say
BAYER = {'rggb': (RED, GREEN, GREEN, BLUE), 'bggr': (BLUE, GREEN, GREEN, RED),
         'gbrg': (GREEN, BLUE, RED, GREEN), 'grbg': (GREEN, RED, BLUE, GREEN)}


def image(encoding, pixels, padding=0, big=False):
    rows = np.ascontiguousarray(pixels.astype(pixels.dtype.newbyteorder('>' if big else '<')))
    rows = rows.reshape(len(pixels), -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=99)
    return Image(encoding=encoding, height=pixels.shape[0], width=pixels.shape[1],
                 step=rows.shape[1], is_bigendian=int(big), data=rows.tobytes())


@pytest.fixture(scope='module')
def picture():
    smooth = cv2.resize(np.random.default_rng(0).random((4, 5, 3)), (20, 16))
    return np.rint(255 * smooth).astype(np.uint8)


@pytest.mark.parametrize(('encoding', 'order'), [
    ('rgb8', [0, 1, 2]), ('bgr8', [2, 1, 0]), ('rgba8', [0, 1, 2, 0]), ('bgra8', [2, 1, 0, 0]),
    ('8UC3', [2, 1, 0])])
@pytest.mark.parametrize('padding', [0, 5])
def test_colours(picture, encoding, order, padding):
    message = image(encoding, picture[..., order], padding)
    found = colours_from(message)
    np.testing.assert_array_equal(found, picture)
    assert found.flags.writeable
    assert not np.shares_memory(found, np.frombuffer(message.data, np.uint8))


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('padding', [0, 2, 3])
def test_sixteen_bits(picture, padding, big):
    deep = picture.astype(np.uint16) * 256 + 7
    for encoding, order in (('rgb16', 1), ('bgr16', -1)):
        found = colours_from(image(encoding, deep[..., ::order], padding, big))
        assert found.dtype == np.uint16
        np.testing.assert_array_equal(found, deep)
    grey = colours_from(image('mono16', deep[..., 0], padding, big))
    np.testing.assert_array_equal(grey, np.repeat(deep[..., :1], 3, axis=2))


@pytest.mark.parametrize('deep', [False, True])
def test_compressed_images_keep_their_bits(picture, deep):
    pixels = picture.astype(np.uint16) * 256 + 7 if deep else picture
    packed = cv2.imencode('.png', np.ascontiguousarray(pixels[..., ::-1]))[1].tobytes()
    message = CompressedImage(format='rgb8; png compressed bgr8', data=packed)
    found = decompressed_from(message)
    assert found.dtype == pixels.dtype
    np.testing.assert_array_equal(found, pixels)
    message.format = 'bayer_rggb8; png compressed '
    with pytest.raises(MessageError, match='is a mosaic'):
        decompressed_from(message)


def test_compressed_numbers_are_no_picture(picture):
    packed = cv2.imencode('.tiff', picture.astype(np.float32))[1].tobytes()
    with pytest.raises(MessageError, match='float32 values, expected 8 or 16 bits'):
        decompressed_from(CompressedImage(format='tiff', data=packed))


@pytest.mark.parametrize('pattern', BAYER)
@pytest.mark.parametrize('kind', [np.uint8, np.uint16])
def test_bayer_patterns_give_the_colours_their_names_say(pattern, kind):
    colour = np.array([200, 120, 40], kind)
    mosaic = np.tile(colour[list(BAYER[pattern])].reshape(2, 2), (4, 5))
    found = colours_from(image(f'bayer_{pattern}{8 * mosaic.itemsize}', mosaic))
    np.testing.assert_array_equal(found, np.broadcast_to(colour, (8, 10, 3)))


@pytest.mark.parametrize(('encoding', 'order'), [
    ('yuv422', [1, 0, 2, 0]), ('uyvy', [1, 0, 2, 0]), ('yuv422_yuy2', [0, 1, 0, 2]),
    ('yuyv', [0, 1, 0, 2])])
def test_yuv(encoding, order):
    colour = np.array([180, 90, 60.0])
    # ITU-R BT.601, limited range
    y = 16 + colour @ [65.481, 128.553, 24.966] / 255
    u = 128 + colour @ [-37.797, -74.203, 112] / 255
    v = 128 + colour @ [112, -93.786, -18.214] / 255
    pair = np.array([y, u, v])[order].reshape(2, 2)
    pixels = np.rint(np.tile(pair[None], (4, 5, 1))).astype(np.uint8)
    np.testing.assert_allclose(colours_from(image(encoding, pixels)),
                               np.broadcast_to(colour, (4, 10, 3)), atol=3)


def test_values_that_the_encoding_has_not_are_asked_about(caplog):
    """They may be padding. Once: no other test has such rows."""
    message = image('mono8', np.arange(93, dtype=np.uint8).reshape(1, 93))
    for message.width in (30, 1):  # rows of another length, and many times as long, are padded
        colours_from(message)
    assert not caplog.records
    message.width = 31
    for _ in range(2):
        np.testing.assert_array_equal(colours_from(message)[..., 0], np.arange(31)[None])
    assert caplog.text.count('hold 3 values for each of 31 px, and mono8 has 1') == 1


@pytest.mark.parametrize('encoding', ['yuv422', 'yuv422_yuy2'])
def test_an_odd_width_where_two_pixels_share_a_colour(encoding):
    with pytest.raises(MessageError, match=f'5x4 px of {encoding}, where two .* must be even'):
        colours_from(image(encoding, np.zeros((4, 5, 2), np.uint8)))


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'encoding': '32FC1'}, "'32FC1' is none of rgb8"),
    ({'data': b'123'}, '3 bytes of data'),
    ({'step': 10}, 'rows need 60 bytes'),
    ({'width': 0}, '0x16 px'),
])
def test_images_that_are_none_are_refused(picture, changes, reason):
    message = image('rgb8', picture)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(MessageError, match=reason):
        colours_from(message)


def info(**changes):
    values = {'width': 64, 'height': 48, 'distortion_model': 'plumb_bob',
              'd': [-0.1, 0.02, 0.0, 0.0, 0.0], 'k': np.array([50.0, 0, 31, 0, 51, 22, 0, 0, 1]),
              'p': np.array([45.0, 0, 30, 0, 0, 46, 21, 0, 0, 0, 1, 0])} | changes
    return CameraInfo(**values)


def test_lenses():
    lens = lens_from(info(), False)
    assert lens.pinhole == Pinhole(64, 48, 50, 51, 31, 22)
    assert lens.distortion == (-0.1, 0.02, 0, 0, 0)
    assert lens_from(info(), True).pinhole == Pinhole(64, 48, 45, 46, 30, 21)
    assert lens_from(info(), True).distortion == ()
    assert lens_from(info(d=[0.0] * 5, distortion_model=''), False).distortion == ()
    fisheye = lens_from(info(d=[0.1, 0.0, 0.0, 0.0], distortion_model='equidistant'), False)
    assert fisheye.model == 'equidistant'
    whole = RegionOfInterest(width=64, height=48)
    assert lens_from(info(roi=whole, binning_x=1, binning_y=1), False) == lens  # as 0 says


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'k': [0.0] * 9}, 'calibrate the camera'),
    ({'binning_x': 2}, 'send whole images'), ({'binning_y': 2}, 'send whole images'),
    ({'roi': RegionOfInterest(x_offset=3)}, 'send whole images'),
    ({'roi': RegionOfInterest(y_offset=3)}, 'send whole images'),
    ({'roi': RegionOfInterest(width=64, height=10)}, 'send whole images'),
    ({'distortion_model': 'fov'}, "'fov' is not known"),
    ({'width': 0}, 'impossible camera'),
])
def test_camera_infos_that_are_none_are_refused(changes, reason):
    with pytest.raises(MessageError, match=reason):
        lens_from(info(**changes), False)
