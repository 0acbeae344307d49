"""Frames of a moved camera become views at their true positions; bad ones are named."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sweep_scene import DISC, PINHOLE, STAMP, WALL, frame, light, pose_at, raster

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.lightfield.sweep.assemble import assemble
from pmcl_ros.lightfield.sweep.collection import Collection
from pmcl_ros.lightfield.sweep.frame import Lens, SweepFrame
from pmcl_ros.lightfield.sweep.plan import SweepPlan
from pmcl_ros.lightfield.sweep.rectify import largest_window
from pmcl_ros.lightfield.sweep.selection import Layout
from pmcl_ros.lightfield.sweep.settings import SweepSettings
from pmcl_ros.runtime.errors import LightFieldError

STEP = 0.01
SETTINGS = SweepSettings(rows=5, columns=5, baseline=STEP, near=0.4, far=1.0)
BASE = pose_at(0.3, -0.2, 0.1, (20, -35, 50))  # of the scene's frame in the robot's
BARREL = Lens(PINHOLE, (-0.2, 0.05, 0.001, -0.002, 0.0))
FISHEYE = Lens(PINHOLE, (0.02, -0.01, 0.0, 0.0), 'equidistant')


def in_base(frames):
    """The frames with poses in the robot's frame."""
    return [replace(each, pose=BASE @ each.pose) for each in frames]


def frames_at(poses, lens=None, kind=np.uint16):
    return [frame(f'f{number}', pose, lens, number, kind) for number, pose in enumerate(poses)]


@pytest.fixture(scope='module')
def poses():
    """Of 5x5 cameras turned by half a degree and beside their places by a millimetre."""
    return raster(5, 5, STEP, 0.001, 0.5)


@pytest.fixture(scope='module')
def frames(poses):
    return in_base(frames_at(poses, BARREL))


@pytest.fixture(scope='module')
def sweep(frames):
    return assemble(frames, SETTINGS, 'wrist_camera')


def reasons(sweep):
    return {each.name: each.reason for each in sweep.left_out}


@pytest.mark.parametrize('noise', [0, 300], ids=['of one colour', 'noisy'])
def test_plain_frames_are_a_light_field_whose_poses_cannot_be_checked(poses, noise):
    rng = np.random.default_rng(0)
    size = PINHOLE.height, PINHOLE.width, 3
    plain = [SweepFrame(f'f{number}', STAMP, (20000 + noise * rng.normal(size=size)).astype(
        np.uint16), Lens(PINHOLE), pose) for number, pose in enumerate(poses)]
    made = assemble(plain, SETTINGS, '')
    assert len(made.used) == 25
    assert 'too little texture to check poses' in made.describe()
    assert 'nan' not in made.describe()
    with pytest.raises(LightFieldError, match='1 are good') as told:  # too few, whatever they show
        assemble(plain[:1], SETTINGS, '')
    assert 'nan' not in str(told.value)


def test_turned_and_distorted_frames_become_parallel_views_at_their_places(sweep, poses):
    light_field = sweep.light_field
    grid, header = light_field.grid, light_field.header
    assert (header.stamp_ns, header.frame_id) == (STAMP + 12 * 100_000_000, 'wrist_camera')
    assert sweep.used == {divmod(number, 5): f'f{number}' for number in range(25)}
    assert not sweep.left_out
    assert sweep.residual < 0.15
    assert (grid.weights == 1).all()
    assert (grid.pinhole.fx, grid.pinhole.fy) == (PINHOLE.fx, PINHOLE.fy)
    assert grid.pinhole.width * grid.pinhole.height > 0.9 * PINHOLE.width * PINHOLE.height
    for number, pose in enumerate(poses):
        at = divmod(number, 5)
        np.testing.assert_allclose(grid.positions[at], pose[:2, 3] / STEP, atol=1e-9)
        # As a camera without distortion, not turned, in the plane of the reference sees it.
        expected = light(Lens(grid.pinhole), pose_at(*pose[:2, 3]))
        error = abs(light_field.views[at] - expected)
        assert np.median(error) < 0.002
        assert np.percentile(error, 99) < 0.01


def test_a_fisheye_and_eight_bits_do_too(poses):
    chosen = [poses[number] for number in (2, 10, 12, 14, 22)]
    sweep = assemble(in_base(frames_at(chosen, FISHEYE, np.uint8)), SETTINGS, 'camera')
    assert len(sweep.used) == 5
    for at, name in sweep.used.items():
        pose = chosen[int(name[1:])]
        expected = light(Lens(sweep.light_field.grid.pinhole), pose_at(*pose[:2, 3]))
        assert np.percentile(abs(sweep.light_field.views[at] - expected), 99) < 0.015


def test_depths_are_those_of_the_scene(sweep):
    depth = build_volume(sweep.light_field, DlvSettings(near=0.4, far=1.0)).depth_map()
    pinhole = sweep.light_field.grid.pinhole
    y, x = round(pinhole.cy), round(pinhole.cx)
    assert np.nanmedian(depth[y - 10:y + 10, x - 10:x + 10]) == pytest.approx(DISC, rel=0.005)
    assert np.nanmedian(depth[:15]) == pytest.approx(WALL, rel=0.01)


def test_an_undistorted_reference_is_taken_as_it_is(poses):
    frames = in_base(frames_at([poses[12], pose_at(STEP)]))
    sweep = assemble(frames, SETTINGS.model_copy(update={'rows': 1, 'columns': 2}), 'camera')
    light_field = sweep.light_field
    reference = next(each for each in frames if each.name == sweep.reference)
    table = (np.arange(65536) / 65535) ** 2.2
    left = round(PINHOLE.cx - light_field.grid.pinhole.cx)
    top = round(PINHOLE.cy - light_field.grid.pinhole.cy)
    height, width = light_field.views.shape[2:4]
    expected = table[reference.image][top:top + height, left:left + width]
    np.testing.assert_allclose(light_field.centre_view, expected, atol=1e-6)


def test_each_reason_names_its_frame(poses, frames):
    given = list(frames)
    blurred = cv2.GaussianBlur(given[3].image, (1, 9), 0, sigmaY=3)
    given[3] = replace(given[3], image=blurred)
    given[7] = replace(given[7], image=given[7].image // 2)
    given[8] = replace(given[8], speed=0.5)
    given[11] = replace(given[11], angular_speed=1.0)
    given[16] = replace(given[16], pose=given[16].pose @ pose_at(turn=(0.8, -0.8, 0)))
    off_plane = pose_at(*poses[18][:2, 3], 0.01)
    given[18] = in_base([frame('f18', off_plane, BARREL)])[0]
    given[21] = in_base([frame('f21', pose_at(*poses[21][:2, 3], 0, (0, 20, 0)), BARREL)])[0]
    given.append(in_base([frame('far', pose_at(0.08), BARREL)])[0])
    given.append(in_base([frame('twice', poses[6] @ pose_at(0.0021), BARREL)])[0])
    sweep = assemble(given, SETTINGS, 'camera')
    told_of = reasons(sweep)
    for name, words in {
            'f3': '% of the usual sharpness', 'f7': 'lock exposure', 'f8': '0.500 m/s',
            'f11': '1.000 rad/s', 'f16': 'its pose does not fit what it shows',
            'f18': 'mm off the plane of the views', 'f21': 'turned away: it shows',
            'far': 'outside the 5x5 grid'}.items():
        assert words in told_of.pop(name), name
    (spare, reason), = told_of.items()
    assert spare in ('f6', 'twice')
    assert 'is better or nearer in row 1, column 1' in reason
    empty = {divmod(number, 5) for number in (3, 7, 8, 11, 16, 18, 21)}
    assert {tuple(each) for each in np.argwhere(sweep.light_field.grid.weights == 0)} == empty
    assert not sweep.light_field.views[0, 3].any()
    line = sweep.describe()
    assert line.startswith('18 of 5x5 views')
    assert 'f21: turned away' in line
    assert '1 of places with a better one' in line


def test_a_little_off_the_plane_is_right_where_it_matters():
    poses = [pose_at(), pose_at(STEP, 0, 0.003), pose_at(-STEP, 0, -0.003)]
    settings = SETTINGS.model_copy(update={'rows': 1, 'columns': 3})
    sweep = assemble(in_base(frames_at(poses)), settings, 'camera')
    grid = sweep.light_field.grid
    pinhole = grid.pinhole
    # A corner at the focus distance is where a camera in the plane sees it, within what remap
    # rounds; at near and far it is off by no more than is told.
    for column, z in ((2, 0.003), (0, -0.003)):
        x = grid.positions[0, column, 0] * STEP
        for depth, most in ((settings.focus, 1e-9), (0.4, 0.35), (1.0, 0.35)):
            point = np.array([0.15, 0.1, depth])
            seen = pinhole.project(point - [x, 0, z])
            scaled = (seen - [pinhole.cx, pinhole.cy]) * (settings.focus - z) / settings.focus
            wanted = pinhole.project(point - [x, 0, 0]) - [pinhole.cx, pinhole.cy]
            assert np.linalg.norm(scaled - wanted) <= most
    left, right = (light(Lens(pinhole), pose_at(x, 0)) for x in (-STEP, STEP))
    for column, expected in ((0, left), (2, right)):
        off = cv2.phaseCorrelate(sweep.light_field.views[0, column].mean(axis=2).astype(float),
                                 expected.mean(axis=2))[0]
        assert np.linalg.norm(off) < 0.1


def test_poses_that_fit_nothing_are_refused(frames):
    rng = np.random.default_rng(0)
    turned = [replace(each, pose=each.pose @ pose_at(turn=rng.normal(0, 2, 3)))
              for each in frames]
    with pytest.raises(LightFieldError, match=r'are the poses those of the optical frame'):
        assemble(turned, SETTINGS, 'camera')


def test_too_few_frames_are_named(frames):
    moved = [replace(each, speed=1.0) for each in frames[:3]]
    with pytest.raises(LightFieldError, match=r'of 3 frames 0 are good.*f0: moved by 5.0 px in'):
        assemble(moved, SETTINGS, 'camera')
    with pytest.raises(LightFieldError, match='none came'):
        assemble([], SETTINGS, 'camera')
    with pytest.raises(LightFieldError, match='do plan and poses belong together'):
        assemble(frames, SETTINGS, 'camera', np.eye(4))


def test_of_frames_of_one_place_the_sharpest_is_kept(poses):
    collection = Collection(SETTINGS)
    sharp = in_base(frames_at([poses[0], poses[1]]))
    soft = replace(sharp[0], name='soft', image=cv2.GaussianBlur(sharp[0].image, (0, 0), 2))
    fast = replace(sharp[0], name='fast', speed=0.5)
    assert collection.add(soft)
    assert not collection.add(fast)
    assert all(collection.add(each) for each in sharp)
    assert not collection.add(soft)
    assert [each.name for each in collection.frames] == ['f0', 'f1']
    assert [(each.name, each.spare) for each in collection.left_out] == [
        ('fast', False), ('soft', True), ('soft', True)]
    assert (collection.filled, collection.cells) == (2, 25)
    for _ in range(5000):  # a camera at rest, of a sweep that nobody ends
        collection.add(fast)
    assert collection.left_out_count == 5003
    assert len(collection.left_out) == 1000


@hypothesis_settings(deadline=None, max_examples=40)
@given(st.integers(1, 6), st.integers(2, 6), st.integers(0, 2 ** 32 - 1))
def test_planned_poses_fill_every_cell_however_they_lie_in_the_room(rows, columns, seed):
    rng = np.random.default_rng(seed)
    base = pose_at(*rng.normal(0, 1, 3), Rotation.random(None, rng).as_rotvec(degrees=True))
    settings = SweepSettings(rows=rows, columns=columns, baseline=0.02)
    collection = Collection(settings)
    small = Lens(PINHOLE.resized(8, 6))
    plan = SweepPlan.from_grid(rows, columns, 0.02, base, 'base_link')
    for each in rng.permutation(len(plan.poses)):
        assert collection.filled < rows * columns
        picture = rng.integers(0, 255, (6, 8, 3)).astype(np.uint8)
        assert collection.add(SweepFrame(str(each), 0, picture, small, plan.poses[each].pose))
    assert collection.filled == rows * columns
    np.testing.assert_allclose(plan.middle, base, atol=1e-5)


@hypothesis_settings(deadline=None)
@given(st.integers(0, 2 ** 32 - 1))
def test_the_window_is_all_seen(seed):
    rng = np.random.default_rng(seed)
    seen = np.zeros((30, 40), bool)
    corners = np.array([[0, 0], [39, 0], [39, 29], [0, 29]]) + rng.integers(-4, 5, (4, 2))
    seen = cv2.fillConvexPoly(np.zeros((30, 40), np.uint8), corners.astype(np.int32), 1) > 0
    rows, columns = largest_window(seen)
    assert seen[rows, columns].all()
    assert seen[rows, columns].size >= 0.5 * seen.sum()


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'model': 'thin_prism'}, "'thin_prism' is not known"),
    ({'distortion': (0.1, 0.2)}, 'has 2 coefficients'),
    ({'distortion': (0.1,) * 8}, 'has 8 coefficients; .*; so many are of rational_polynomial$'),
    ({'distortion': (0.1, 0.2, np.nan, 0)}, r'0.2, nan, 0\] is not finite: calibrate'),
])
def test_lenses_that_are_none_are_refused(changes, reason):
    with pytest.raises(LightFieldError, match=reason):
        Lens(PINHOLE, **changes)


@pytest.mark.parametrize(('distortion', 'model', 'folds'), [
    ((), 'plumb_bob', False), ((-0.3, 0.1, 1e-3, -1e-3, -0.02), 'plumb_bob', False),
    ((0.4, 0.2, 0, 0), 'plumb_bob', False), ((-0.01, 0.003, 0, 0), 'equidistant', False),
    ((-5.0, 0.02, 0, 0), 'plumb_bob', True), ((0.0, 0, 2.0, 2.0), 'plumb_bob', True)])
def test_a_distortion_that_no_lens_has_is_known(distortion, model, folds):
    wide = replace(PINHOLE, fx=0.6 * PINHOLE.width, fy=0.6 * PINHOLE.width)
    assert Lens(wide, distortion, model).folds is folds


@pytest.mark.parametrize(('distortion', 'model'), [
    ((), 'plumb_bob'), ((-0.35, 0.12, 1e-3, -1e-3, 0), 'plumb_bob'),
    ((0.2, 0.1, 0, 0), 'plumb_bob'), ((-0.02, 3e-3, -2e-3, 4e-4), 'equidistant')])
def test_the_share_of_the_image_that_is_left_without_distortion_is_known(distortion, model):
    lens = Lens(replace(PINHOLE, fx=0.6 * PINHOLE.width, fy=0.6 * PINHOLE.width), distortion,
                model)
    x, y = np.rint(lens.places(np.eye(3), lens.pinhole.resized(1280, 960))).astype(int)
    seen = np.zeros((PINHOLE.height, PINHOLE.width), bool)
    inside = (x >= 0) & (x < PINHOLE.width) & (y >= 0) & (y < PINHOLE.height)
    seen[y[inside], x[inside]] = True
    assert lens.kept == pytest.approx(seen.mean(), abs=0.04)  # squares at the border count whole


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'pose': 2 * np.eye(4)}, 'no rigid transform'),
    ({'image': np.zeros((5, 6, 3), np.uint8)}, r'f0 has 6x5 px, its camera \(camera_info\) 160x'),
    ({'image': np.zeros((120, 160), np.uint8)}, r'shape \(120, 160\)'),
])
def test_frames_that_are_none_are_refused(frames, changes, reason):
    with pytest.raises(LightFieldError, match=reason):
        replace(frames[0], **changes)


@hypothesis_settings(deadline=None)
@given(st.integers(1, 5), st.integers(2, 5), st.integers(0, 2 ** 32 - 1))
def test_without_a_plan_the_grid_lies_where_most_cells_have_a_frame(rows, columns, seed):
    rng = np.random.default_rng(seed)
    base = pose_at(*rng.normal(0, 1, 3), Rotation.random(None, rng).as_rotvec(degrees=True))
    poses = raster(rows, columns, 0.02, 0.001, 0.5, seed, base)
    wrong = rng.uniform(1, 2), *rng.normal(0, 2, 2)
    poses.append(base @ pose_at(*wrong, rng.normal(0, 30, 3)))
    settings = SweepSettings(rows=rows, columns=columns, baseline=0.02)
    order = rng.permutation(len(poses))
    layout = Layout.from_poses([poses[number] for number in order], settings)
    if len(poses) > 3:  # of two and a wrong one none is typical
        cells = dict(zip(order.tolist(), layout.cells.tolist(), strict=True))
        assert [cells[number] for number in range(rows * columns)] == [
            [row, column] for row, column in np.ndindex(rows, columns)]
