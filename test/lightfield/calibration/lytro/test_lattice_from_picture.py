from pathlib import Path

import numpy as np
import pytest
from lattice_frames import discs, frame_of, make_lattice, mosaic, offsets, pixels, texture
from rosbags.typesys import Stores, get_typestore
from scipy.io import loadmat
from scipy.ndimage import map_coordinates

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.mosaic_image import read_mosaic_image
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice_fit import lattice_from_picture
from pmcl_ros.messages.bags import read
from pmcl_ros.runtime.errors import LightFieldError

ROOT = Path(__file__).parents[4]
REAL = ROOT / 'test/data/real_mosaics'
SIDE = 700


def worst(lattice, truth, side=SIDE):
    """95th percentile of the centres' errors over the sensor, px."""
    return np.percentile(lattice.difference(truth, side, side), 95)


@pytest.mark.parametrize('bag', ['wine_glass', 'shaker'])
def test_pictures_of_the_shipped_bags(bag):
    types = get_typestore(Stores.ROS2_JAZZY)
    messages = {each.topic: types.deserialize_cdr(each.cdr, each.type)
                for each in read(ROOT / 'bags' / bag)}
    counts = messages['/image_raw'].data.view(np.uint16).reshape(3280, 3280)
    frame = RawFrame(Header(), counts, CameraMetadata.parse(messages['/metadata'].data))
    fit = lattice_from_picture(frame)
    truth = Calibration.load(ROOT / 'config/cameras/demo.yaml').lattice
    assert worst(fit.lattice, truth, 3280) < 0.02


@pytest.mark.parametrize(('name', 'corner'), [('IMG_2.jpg', 0), ('IMG_1_middle.png', 1128)])
def test_a_real_camera_agrees_with_its_own_table(name, corner):
    frame = read_mosaic_image(REAL / name, gain=1.5)
    lattice = lattice_from_picture(frame).lattice
    # (row, column), 1-based, rounded to whole pixels.
    table = loadmat(REAL / 'image_cords.mat')['image_cords'][..., ::-1].astype(float) - 1 - corner
    seen = ((table >= 0) & (table < frame.counts.shape[0])).all(axis=-1)
    apart = table[seen] - lattice.centres(*lattice.nearest(table[seen]))
    assert len(apart) > 10_000
    assert np.median(np.hypot(*apart.T)) < 0.45  # 0.40 of it are the table's rounding
    assert (np.abs(apart.mean(axis=0)) < 0.15).all()


def test_two_pictures_of_a_real_camera_agree():
    whole, middle = (lattice_from_picture(read_mosaic_image(REAL / name, gain=1.5)).lattice
                     for name in ('IMG_2.jpg', 'IMG_1_middle.png'))
    x, y = middle.centre_px
    moved = middle.model_copy(update={'centre_px': (x + 1128, y + 1128)})
    centres = moved.centres(*np.meshgrid(np.arange(-50, 50), np.arange(-50, 50)))
    apart = centres - whole.centres(*whole.nearest(centres))
    assert np.percentile(np.hypot(*np.moveaxis(apart, -1, 0)), 95) < 0.2


@pytest.mark.parametrize(('size', 'pitch'), [(3, 9.93), (12, 9.93), (60, 9.93), (12, 7.1),
                                             (20, 16.3)])
def test_a_textured_scene(camera_text, size, pitch):
    truth = make_lattice(pitch, rotation=0.03, centre=(SIDE / 2, SIDE / 3))
    scene = texture(SIDE, size) * mosaic([0.3, 0.7, 0.7, 1.3], SIDE)
    assert (scene > 1).any()  # saturated
    fit = lattice_from_picture(frame_of(scene * discs(truth, SIDE) + 0.01, camera_text))
    assert worst(fit.lattice, truth) < 0.05


def test_dark_and_saturated_parts(camera_text):
    truth = make_lattice()
    scene = np.full((SIDE, SIDE), 0.4)
    scene[:, :400] = 0
    scene[600:, 500:] = 30
    fit = lattice_from_picture(frame_of(scene * discs(truth, SIDE) + 0.002, camera_text))
    assert worst(fit.lattice, truth) < 0.05


@pytest.mark.parametrize('parallax', [-2, 0, 3])
def test_a_scene_out_of_focus(camera_text, parallax):
    """Under each lenslet lies a small picture of the scene: its disc is uneven."""
    truth = make_lattice()
    points = pixels(SIDE)
    apart = offsets(truth, points)
    seen = points - apart + parallax * apart
    scene = map_coordinates(texture(SIDE, 12), np.moveaxis(seen[..., ::-1], -1, 0), order=1,
                            mode='wrap')
    fit = lattice_from_picture(frame_of(scene * discs(truth, SIDE) + 0.01, camera_text))
    assert worst(fit.lattice, truth) < 0.15


def test_a_picture_without_lenslets_is_refused(camera_text):
    with pytest.raises(LightFieldError, match='no lattice of lenslets'):
        lattice_from_picture(frame_of(texture(SIDE, 3), camera_text))
