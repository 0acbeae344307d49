"""views.yaml: pictures of known cameras, read without distortion, and what is refused."""

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import GAMMA, PosedView, PosedViews
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.lightfield.readers.posed_views import ViewsFile, views_of, views_of_sweep
from pmcl_ros.lightfield.readers.read import (
    has_posed_views,
    is_light_field,
    read_light_field,
    read_source,
)
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

WIDTH, HEIGHT = 60, 44
CAMERA = {'fx': 50.0, 'fy': 51.0, 'cx': 30.5, 'cy': 21.0, 'width': WIDTH, 'height': HEIGHT}
PINHOLE = Pinhole(WIDTH, HEIGHT, 50, 51, 30.5, 21)
VALUES = np.random.default_rng(0).random((HEIGHT, WIDTH, 3))


def write(folder, picture, name='one.png', **camera):
    folder.mkdir(exist_ok=True)
    cv2.imwrite(str(folder / name), picture if picture.ndim == 2 else picture[..., ::-1],
                [cv2.IMWRITE_TIFF_COMPRESSION, 1])  # else old OpenCV loses digits
    (folder / 'views.yaml').write_text(yaml.safe_dump(
        {'cameras': {'wrist': CAMERA | camera}, 'views': [{'file': name, 'camera': 'wrist'}]}))
    return folder


def whole(values, white, dtype):
    return np.rint(values * white).astype(dtype)


@pytest.mark.parametrize(('name', 'white', 'dtype'), [
    ('a.png', 255, np.uint8), ('a.png', 65535, np.uint16), ('a.tiff', 65535, np.uint16)])
def test_a_picture_is_read_at_its_full_depth(tmp_path, name, white, dtype):
    folder = write(tmp_path, whole(VALUES, white, dtype), name)
    for source in (folder, folder / 'views.yaml', str(folder)):
        assert is_light_field(source)
        view = read_source(source)
        assert isinstance(view, PosedView)
        assert view.pinhole == PINHOLE
        assert abs(view.picture - VALUES).max() <= 0.5 / white + 1e-7
    assert view.header.stamp_ns == (folder / name).stat().st_mtime_ns


@pytest.mark.parametrize('bits', [10, 12])
def test_a_camera_of_few_bits_is_as_bright_as_another(tmp_path, caplog, bits):
    white = 2 ** bits - 1
    folder = write(tmp_path, whole(VALUES, white, np.uint16))
    assert read_source(folder).picture.max() < 1 / 2 ** (15 - bits)
    assert f'no value above {white}' in caplog.text
    caplog.clear()
    text = (folder / 'views.yaml').read_text()
    (folder / 'views.yaml').write_text(f'{text}bits: {bits}\n')
    assert abs(read_source(folder).picture - VALUES).max() <= 0.5 / white + 1e-5
    assert not caplog.text
    (folder / 'views.yaml').write_text(f'{text}bits: 9\n')
    with pytest.raises(LightFieldError, match=r'one.png: its largest value is .* 9 bits is 511'):
        read_source(folder)


@pytest.mark.parametrize(('cx', 'odd'), [
    (18.0, False), (17.0, True), (43.0, True), (41.0, False), (-9.0, True)])
def test_a_calibration_of_another_resolution_is_told_once(tmp_path, caplog, cx, odd):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8), cx=cx)
    for _ in range(2):
        assert read_source(folder).pinhole.cx == cx  # a cropped picture may have it
    assert caplog.messages == odd * [
        f"camera 'wrist': the principal point ({cx:g}, 21) is far from the middle of "
        f'{WIDTH}x{HEIGHT}: is the calibration of another resolution?']


@pytest.mark.parametrize(('size', 'cx', 'cy', 'asked'), [
    ((64, 48), 23.0, 32.5, True), ((80, 64), 33.0, 38.0, True), ((64, 36), 17.5, 31.5, True),
    ((48, 64), 31.0, 24.0, True), ((64, 48), 32.5, 23.0, False), ((64, 60), 29.0, 32.0, False),
    ((64, 48), 24.0, 24.0, False), ((64, 64), 28.0, 33.0, False)])
def test_a_principal_point_with_its_coordinates_exchanged_is_told(tmp_path, caplog, size, cx, cy,
                                                                 asked):
    width, height = size
    values = whole(np.zeros((height, width, 3), np.float32), 255, np.uint8)
    read_source(write(tmp_path, values, width=width, height=height, cx=cx, cy=cy))
    assert caplog.messages == asked * [
        f"camera 'wrist': the principal point ({cx:g}, {cy:g}) is far from the middle of "
        f'{width}x{height}: are cx and cy exchanged?']


def test_grey_and_jpeg_are_pictures_too(tmp_path):
    grey = whole(VALUES[..., 0], 255, np.uint8)
    view = read_source(write(tmp_path / 'grey', grey))
    for channel in range(3):
        np.testing.assert_allclose(view.picture[..., channel], grey / 255, rtol=1e-6)
    smooth = cv2.GaussianBlur(VALUES, (0, 0), 5)
    view = read_source(write(tmp_path / 'jpeg', whole(smooth, 255, np.uint8), 'a.jpg'))
    assert abs(view.picture - smooth).mean() < 0.01


def test_linear_files_are_encoded(tmp_path):
    view = read_source(write(tmp_path, VALUES.astype(np.float32), 'a.tiff', gamma=1))
    np.testing.assert_allclose(view.linear(), VALUES, atol=1e-5)
    np.testing.assert_allclose(view.picture, VALUES ** (1 / GAMMA), atol=1e-5)


@pytest.mark.parametrize(('model', 'numbers'), [
    ('plumb_bob', (-0.2, 0.05, 0.003, -0.002, 0.01)),
    ('rational_polynomial', (-0.1, 0.02, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0)),
    ('equidistant', (0.05, 0.01, 0.0, 0.0)), ('equidistant', (0.0, 0.0, 0.0, 0.0))])
def test_distortion_is_undone_and_the_camera_matrix_stays(tmp_path, model, numbers):
    """Marks lie where the lens puts points; in the view they lie where the pinhole does."""
    points = np.array([[-0.3, -0.2, 1], [0.25, 0.1, 1], [0.0, 0.3, 1], [-0.2, 0.2, 1]])
    big = Pinhole(240, 176, 200, 204, 122.0, 84.0)
    project = cv2.fisheye.projectPoints if model == 'equidistant' else cv2.projectPoints
    marks = project(points[None], np.zeros(3), np.zeros(3), big.matrix, np.array(numbers))[0]
    v, u = np.mgrid[:big.height, :big.width]
    picture = np.zeros((big.height, big.width))
    for x, y in np.reshape(marks, (-1, 2)):
        picture += np.exp(-((u - x) ** 2 + (v - y) ** 2) / 18)
    folder = write(tmp_path, whole(np.clip(picture, 0, 1), 65535, np.uint16), width=240,
                   height=176, fx=200.0, fy=204.0, cx=122.0, cy=84.0, model=model,
                   distortion=list(numbers))
    view = read_source(folder)
    assert view.pinhole == big
    for x, y in big.project(points):
        near = view.picture[..., 0] * (np.hypot(u - x, v - y) < 9)
        found = np.array([(near * u).sum(), (near * v).sum()]) / near.sum()
        assert found == pytest.approx((x, y), abs=0.1)
    expected = Lens(big, numbers, model).places(np.eye(3), big)
    outside = (expected[0] < -1) | (expected[0] > 240) | (expected[1] < -1) | (expected[1] > 176)
    assert np.isfinite(view.picture[outside]).all()


def test_a_view_can_be_shrunk(tmp_path):
    values = np.tile(VALUES, (2, 2, 1))
    folder = write(tmp_path, whole(values, 65535, np.uint16), width=2 * WIDTH, height=2 * HEIGHT)
    view = read_source(folder, shrink=2)
    whole_pinhole = Pinhole(2 * WIDTH, 2 * HEIGHT, 50, 51, 30.5, 21)
    assert view.pinhole == Reduction(1, 2).pinhole(whole_pinhole)
    means = values.reshape(HEIGHT, 2, WIDTH, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(view.picture, means, atol=1e-4)
    with pytest.raises(LightFieldError, match=r'one.png: it has 120x88 px, shrunk by 3; 32 a s'):
        read_source(folder, shrink=3)


def test_poses_and_their_errors_are_read(tmp_path):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    cv2.imwrite(str(folder / 'two.png'), whole(VALUES, 255, np.uint8))
    pose = [0, -1, 0, 0.1, 1, 0, 0, 0.2, 0, 0, 1, 0.3, 0, 0, 0, 1]
    here = np.eye(4).ravel().tolist()
    views = [{'file': 'one.png', 'camera': 'wrist', 'camera_to_reference': here},
             {'file': 'two.png', 'camera': 'wrist', 'camera_to_reference': pose, 'sigma_mm': 1.5,
              'sigma_deg': 0.2, 'stamp': 12.25, 'group': 'hand-eye'}]
    changed(folder, views=views, reference='base_link')
    first, second = views_of(ViewsFile.load(folder / 'views.yaml'), folder, 'it', Reduction())
    np.testing.assert_array_equal(second.camera_to_reference, np.reshape(pose, (4, 4)))
    assert second.sigma == pytest.approx((0.0015, np.deg2rad(0.2)))
    assert (second.group, first.group) == ('hand-eye', '')
    assert second.header.stamp_ns == 12_250_000_000
    assert first.header.frame_id == second.header.frame_id == 'base_link'
    assert (first.common, second.common) == (1, 1)
    together = read_source(folder)
    assert isinstance(together, PosedViews)
    assert has_posed_views(folder)
    assert [each.name for each in together.views] == ['one.png', 'two.png']
    assert together.header == max(first.header, second.header, key=lambda each: each.stamp_ns)
    for one, other in zip(together.views, (first, second), strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)
        np.testing.assert_array_equal(one.camera_to_reference, other.camera_to_reference)


@pytest.mark.parametrize('apart', [0, 0.001])
def test_one_pose_of_different_pictures_is_told(tmp_path, caplog, apart):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    cv2.imwrite(str(folder / 'two.png'), whole(1 - VALUES, 255, np.uint8))
    pose = np.eye(4)
    pose[0, 3] = apart
    changed(folder, views=[
        view(camera_to_reference=np.eye(4).ravel().tolist())['views'][0],
        view(file='two.png', camera_to_reference=pose.ravel().tolist())['views'][0]])
    assert len(read_source(folder).views) == 2
    assert caplog.messages == (apart == 0) * [
        f'{folder}: all 2 views have the same pose, and different pictures: does each have its '
        'own camera_to_reference?']


def test_a_picture_without_a_pose_is_a_view_one_with_a_pose_is_posed(tmp_path):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    assert isinstance(read_source(folder), PosedView)
    assert not has_posed_views(folder)
    changed(folder, **view(camera_to_reference=np.eye(4).ravel().tolist(), common=0.25))
    assert isinstance(read_source(folder), PosedViews)
    assert read_source(folder).views[0].common == 0.25


def test_a_pose_may_be_four_rows(tmp_path):
    folder = write(tmp_path, np.full((44, 60, 3), 99, np.uint8))
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    changed(folder, **view(camera_to_reference=pose.tolist()))
    one, = read_source(folder).views
    np.testing.assert_array_equal(one.camera_to_reference, pose)


def test_views_of_two_frames_are_refused(tmp_path):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    one = read_source(folder)
    other = replace(one, header=Header(5, 'elsewhere'))
    with pytest.raises(LightFieldError, match='poses in the frames camera, elsewhere; give them'):
        PosedViews((one, other))
    with pytest.raises(LightFieldError, match='there is no view'):
        PosedViews(())


def changed(folder, **values):
    path = folder / 'views.yaml'
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | values))


def view(**values):
    return {'views': [{'file': 'one.png', 'camera': 'wrist'} | values]}


def camera(**values):
    return {'cameras': {'wrist': {key: value for key, value in (CAMERA | values).items()
                                  if value is not None}}}


@pytest.mark.parametrize(('change', 'reason'), [
    (view(file='no.png'), 'there is no .*no.png'),
    (view(file='views.yaml'), 'is no picture'),
    (camera(width=61), "one.png: it has 60x44 px, its camera 'wrist' 61x44: give the calibration "
     'of this size$'),
    (camera(width=30, height=22), "'wrist' 30x22: if the whole picture was resized, its "
     'calibration is fx 100, fy 102, cx 61.5, cy 42.5$'),
    (camera(width=HEIGHT, height=WIDTH), "has 60x44 px, its camera 'wrist' 44x60: the camera was "
     'calibrated with turned pictures; .* whatever EXIF orientation they have: turn the files$'),
    (camera(model='barrel'), r"cameras.wrist.model: .*'plumb_bob', 'rational_polynomial' or"),
    (camera(distortion=[0.1]), 'plumb_bob distortion .* has 1 coefficients'),
    (camera(fx=-3.0), 'fx: .*greater than 1'), (camera(cx=np.nan), 'cx: .*finite'),
    (camera(cy=None), 'cameras.wrist.cy: Field required'),
    (camera(height=None), 'cameras.wrist.height: Field required'),
    (camera(f=3), 'cameras.wrist.f: there is no such key'),
    (camera(widht=3), 'cameras.wrist.widht: there is no such key; did you mean width?'),
    (view(fx=3), 'views.0.fx: there is no such key'),
    ({'view': []}, 'view: there is no such key'),
    ({'views': []}, 'views: there is no view; at least one is needed'),
    ({'cameras': {}}, "of the camera 'wrist', cameras has none"),
    (view(camera='arm'), "is of the camera 'arm', cameras has wrist"),
    (view(pose=[1], place=[2]), r'views.0.place: there is no such key; views.0.pose: there is no '
     r'such key; the keys are file, camera, camera_to_reference, [a-z_, ]*, common$'),
    (view(camera_to_reference=np.eye(4)[:3].tolist()), '4x4, row by row: add 0, 0, 0, 1'),
    (view(mount_to_base=[0.0] * 12), 'mount_to_base: .*4x4, row by row: add 0, 0, 0, 1'),
    (view(camera_to_reference=[1.0] * 15), 'camera_to_reference: a pose has 16 numbers.*not 15'),
    (view(camera_to_reference=(1.002 * np.eye(4)).ravel().tolist()), 'is no pose'),
    (view(camera_to_reference=np.diag([1.002, 1, 1, 1]).ravel().tolist()), 'is no rotation'),
    (view(camera_to_reference=[float('nan')] * 16), 'finite'),
    (view(camera_to_reference=[1.0] * 15 + [float('nan')]),
     r'^[^;]*camera_to_reference.15: Input should be a finite number \(got nan\)$'),
    (view(mount_to_base=[1.0] * 17), 'mount_to_base: a pose has 16 numbers.*not 17'),
    (view(sigma_mm=-1.0), 'sigma_mm: .*greater'),
    ({'views': view()['views'] * 2}, 'has no camera_to_reference; of several views '
     'each needs one, or mount_to_base for pmcl handeye'),
    ({'views': view(camera_to_reference=np.eye(4).ravel().tolist())['views'] * 2},
     'one.png is there more than once'),
    ({'views': [view(file=name, camera_to_reference=np.eye(4).ravel().tolist())['views'][0]
                for name in ('one.png', './one.png', 'no/.././one.png')]},
     'one.png is there more than once')])
def test_what_is_wrong_is_said_in_one_line(tmp_path, change, reason):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    changed(folder, **change)
    with pytest.raises((LightFieldError, SettingsError), match=reason) as caught:
        read_source(folder)
    assert '\n' not in str(caught.value)


def test_a_copy_of_a_picture_with_the_same_pose_is_refused(tmp_path):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    shutil.copy(folder / 'one.png', folder / 'copy.png')
    here = np.eye(4)
    posed = [view(file=name, camera_to_reference=here.tolist())['views'][0]
             for name in ('one.png', 'copy.png')]
    for here[0, 1] in (0.0, -0.0):
        posed[1]['camera_to_reference'] = here.tolist()
        changed(folder, views=posed)
        with pytest.raises(LightFieldError, match=r'one.png and copy.png are one picture with on'):
            read_source(folder)
    here[0, 3] = 1e-6
    posed[1]['camera_to_reference'] = here.tolist()
    changed(folder, views=posed)
    assert len(read_source(folder).views) == 2
    # Another exposure from there differs by its noise.
    cv2.imwrite(str(folder / 'copy.png'), whole(VALUES[::-1], 255, np.uint8))
    posed[1] = posed[0] | {'file': 'copy.png'}
    changed(folder, views=posed)
    assert len(read_source(folder).views) == 2


def test_a_sweep_that_is_no_grid_gives_the_views_that_it_lists(tmp_path):
    camera = {'fx': 150.0, 'fy': 153.0, 'cx': 79.0, 'cy': 71.0, 'distortion': [-0.1, 0, 0, 0]}
    names, places = ('a.png', 'b.png'), np.array([[0, 0, 0], [0.1, 0.2, 0.3]])
    for number, name in enumerate(names):
        values = np.random.default_rng(number).random((140, 160, 3))
        cv2.imwrite(str(tmp_path / name), whole(values, 255, np.uint8))
    (tmp_path / 'sweep.yaml').write_text(yaml.safe_dump({
        'camera': camera, 'gamma': 1.0, 'shrink': 2, 'frames': [
            {'file': name, 'position': place, 'orientation': [0, 0.6, 0, 0.8]}
            for name, place in zip(names, places.tolist(), strict=True)]}))
    found = views_of_sweep(tmp_path / 'sweep.yaml', Reduction(1, 2))
    poses = pose_of(Rotation.from_quat([[0, 0.6, 0, 0.8]] * 2), places)
    expected = views_of(ViewsFile.make({
        'cameras': {'one': camera | {'width': 160, 'height': 140, 'gamma': 1.0}}, 'views': [
            {'file': name, 'camera': 'one', 'camera_to_reference': pose.ravel().tolist()}
            for name, pose in zip(names, poses, strict=True)]}, ''), tmp_path, '', Reduction(1, 4))
    for one, other in zip(found, expected, strict=True):
        assert (one.header.frame_id, one.pinhole) == ('sweep', other.pinhole)
        np.testing.assert_array_equal(one.picture, other.picture)
        np.testing.assert_allclose(one.camera_to_reference, other.camera_to_reference, atol=1e-12)


def test_a_picture_that_is_too_small_is_named(tmp_path):
    folder = write(tmp_path, np.full((60, 8, 3), 99, np.uint8), width=8, height=60, cx=400.0)
    with pytest.raises(LightFieldError, match=r'one.png: it has 8x60 px; 32 a side are needed'):
        read_source(folder)


def test_where_a_light_field_is_needed_a_picture_is_refused(tmp_path):
    with pytest.raises(LightFieldError, match='is of pictures of ordinary cameras'):
        read_light_field(write(tmp_path, whole(VALUES, 255, np.uint8)))


def test_other_sources_are_read_as_before(tmp_path):
    np.savez(tmp_path / 'a.npz', views=np.ones((1, 2, 4, 5, 3), np.float32), fx=9, fy=9, cx=2,
             cy=2, baseline=0.1)
    found = read_source(tmp_path / 'a.npz')
    assert isinstance(found, LightField)
    np.testing.assert_array_equal(found.views, read_light_field(tmp_path / 'a.npz').views)
    with pytest.raises(LightFieldError, match='there is no'):
        read_source(tmp_path / 'no')


def test_a_distortion_that_folds_the_picture_is_told(tmp_path, caplog):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    changed(folder, **camera(distortion=[-5.0, 0.02, 0, 0]))
    read_source(folder)
    assert "camera 'wrist': its distortion, plumb_bob [-5.0, 0.02, 0.0, 0.0], shows" in caplog.text


@pytest.mark.parametrize(('distortion', 'told'), [((-0.35, 0.12, 0, 0), True), ((), False)])
def test_a_distortion_that_leaves_little_of_the_picture_is_told(tmp_path, caplog, distortion,
                                                                told):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8))
    changed(folder, **camera(distortion=list(distortion), fx=0.6 * VALUES.shape[1]))
    read_source(folder)
    assert ("camera 'wrist': without its distortion" in caplog.text) is told


DISTORTED = {'model': 'plumb_bob', 'distortion': [-0.2, 0.03, 0.001, -0.002]}


@pytest.mark.parametrize('camera', [{}, DISTORTED], ids=['pinhole', 'distorted'])
def test_a_mask_leaves_out_the_pixels_of_its_black_ones(tmp_path, camera):
    """The picture is bright where the mask is black: what is left of the picture is dark.

    Elsewhere the mask is of a dark red: only black is left out.
    """
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[HEIGHT // 2:, 10:30] = 0
    bright = np.where(mask, 0, 255).astype(np.uint8)
    folder = write(tmp_path, bright, mask='gripper.png', **camera)
    cv2.imwrite(str(folder / 'gripper.png'), mask[..., None] & np.array([0, 0, 3], np.uint8))
    view = read_source(folder)
    assert view.mask.shape == view.picture.shape[:2]
    assert view.picture[view.mask].max() <= 0.6
    assert (~view.mask).mean() == pytest.approx((mask == 0).mean(), rel=0.25)
    assert write(tmp_path, mask) == folder
    assert read_source(folder).mask is None


@pytest.mark.parametrize(('mask', 'message'), [
    (None, 'there is no .*gripper.png'),
    (np.zeros((HEIGHT, WIDTH), np.uint8), 'gripper.png: the mask is black everywhere'),
    (np.ones((HEIGHT, WIDTH + 1), np.uint8), 'gripper.png: the mask has 61x44 px, .* 60x44'),
])
def test_an_impossible_mask_is_refused_in_one_line(tmp_path, mask, message):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8), mask='gripper.png')
    if mask is not None:
        cv2.imwrite(str(folder / 'gripper.png'), mask)
    with pytest.raises(LightFieldError, match=message) as caught:
        read_source(folder)
    assert '\n' not in str(caught.value)


def test_a_mask_of_which_larger_pixels_leave_nothing_is_refused(tmp_path):
    """Each larger pixel has a black one."""
    folder = write(tmp_path, np.full((2 * HEIGHT, 2 * WIDTH), 99, np.uint8), mask='gripper.png',
                   width=2 * WIDTH, height=2 * HEIGHT)
    stripes = np.tile(np.arange(2 * WIDTH, dtype=np.uint8) % 2, (2 * HEIGHT, 1))
    cv2.imwrite(str(folder / 'gripper.png'), stripes)
    np.testing.assert_array_equal(read_source(folder).mask, stripes > 0)
    with pytest.raises(LightFieldError, match=r'gripper\.png: the mask leaves nothing of the view '
                       'of 120x88 px, shrunk by 2'):
        read_source(folder, shrink=2)


def test_a_picture_may_have_a_mask_beside_that_of_its_camera(tmp_path):
    folder = write(tmp_path, whole(VALUES, 255, np.uint8), mask='gripper.png')
    cv2.imwrite(str(folder / 'two.png'), whole(VALUES[::-1], 255, np.uint8))
    masks = {name: np.full((HEIGHT, WIDTH), 255, np.uint8) for name in ('gripper', 'hand')}
    masks['gripper'][30:] = masks['hand'][:, 40:] = 0
    for name, mask in masks.items():
        cv2.imwrite(str(folder / f'{name}.png'), mask)
    views = [{'file': f'{name}.png', 'camera': 'wrist', 'camera_to_reference': [
        [1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
        for x, name in enumerate(('one', 'two'))]
    views[1]['mask'] = 'hand.png'
    changed(folder, views=views)
    one, two = read_source(folder).views
    np.testing.assert_array_equal(one.mask, masks['gripper'] > 0)
    np.testing.assert_array_equal(two.mask, (masks['gripper'] > 0) & (masks['hand'] > 0))
    changed(folder, cameras={'wrist': CAMERA})
    one, two = read_source(folder).views
    assert one.mask is None
    np.testing.assert_array_equal(two.mask, masks['hand'] > 0)
    changed(folder, cameras={'wrist': CAMERA | {'mask': 'gripper.png'}})
    cv2.imwrite(str(folder / 'hand.png'), 255 - masks['gripper'])
    with pytest.raises(LightFieldError, match=r"hand\.png: this mask and that of the camera "
                       r"'wrist' together leave nothing of two\.png"):
        read_source(folder)
    changed(folder, views=[{'file': 'one.npz', 'mask': 'hand.png'}])
    with pytest.raises(SettingsError, match=r'one\.npz: a light field \(\.npz\) takes no mask'):
        read_source(folder)
