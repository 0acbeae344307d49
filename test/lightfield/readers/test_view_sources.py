"""Light fields of other formats: the same made-up scene, written in each, is read alike."""

import math
import shutil
import struct
import zipfile

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from view_scene import Scene

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.colour import Colour
from pmcl_ros.lightfield.light_field import LightField, ViewGrid
from pmcl_ros.lightfield.readers.npz import write_npz
from pmcl_ros.lightfield.readers.pictures import Reduction, shifted
from pmcl_ros.lightfield.readers.read import is_light_field, read_light_field
from pmcl_ros.runtime.errors import LightFieldError, SettingsError

SCENE = Scene()
PINHOLE = Pinhole(96, 80, 150.0, 150.0, 47.5, 39.5)
STEP, FOCUS = 0.03, 1.4  # m
ROW_COLUMN = '{row}_{column}.png'
BORDER = 16  # px: farther from the border than any view is shifted


def save(path, linear, gamma=2.2, bits=16):
    white = 2 ** bits - 1
    values = np.rint(np.clip(linear, 0, 1) ** (1 / gamma) * white)
    assert cv2.imwrite(str(path), values.astype(np.uint8 if bits == 8 else np.uint16)[..., ::-1])


def places(rows, columns):
    """(rows, columns, 2) x and y [m] of cameras around 0."""
    y, x = np.mgrid[:rows, :columns]
    return STEP * np.stack([x - (columns - 1) / 2, y - (rows - 1) / 2], axis=-1)


def hci(folder, rows=5, columns=7, focus=FOCUS, bits=16, **changes):
    """A benchmark scene's folder."""
    folder.mkdir(exist_ok=True)
    values = {'focal_length_mm': 100.0, 'image_resolution_x_px': 96,
              'image_resolution_y_px': 80, 'sensor_size_mm': 64.0, 'fstop': 100.0,
              'num_cams_x': columns, 'num_cams_y': rows, 'baseline_mm': 1000 * STEP,
              'focus_distance_m': 0.0 if focus == math.inf else focus} | changes
    lines = [f'{name} = {value}' for name, value in values.items() if value is not None]
    (folder / 'parameters.cfg').write_text('\n'.join(
        ['[intrinsics]', *lines[:5], '', '[extrinsics]', *lines[5:], 'center_cam_x_m = 1.5', '',
         '[meta]', 'scene = made up', 'authors = 100 % nobody']))
    for number, (x, y) in enumerate(places(rows, columns).reshape(-1, 2)):
        save(folder / f'input_Cam{number:03d}.png', SCENE.picture(PINHOLE, x, y, focus), bits=bits)
    return folder


def grid(folder, name, shape=(5, 7), focus=FOCUS, sign=(1, 1), bits=16, **values):
    """A folder with light_field.yaml; name: with {row}, {column}, {n}, and {x}, {y} in mm.

    sign: -1 where columns go to the left, rows up.
    """
    folder.mkdir(exist_ok=True)
    for n, (row, column) in enumerate(np.ndindex(shape)):
        x, y = places(*shape)[row, column] * sign
        save(folder / name.format(row=row, column=column, n=n, x=1000 * x, y=1000 * y),
             SCENE.picture(PINHOLE, x, y, focus), bits=bits)
    settings = {'fx': 150, 'focus_distance': focus} | values
    (folder / 'light_field.yaml').write_text(yaml.safe_dump(settings))
    return folder


def check(found, rows=5, columns=7):
    """`found` is the scene, rectified, in the order and at the places that its grid says."""
    assert found.grid.shape == (rows, columns)
    assert found.grid.baseline == pytest.approx(STEP)
    assert found.grid.pinhole.fx == pytest.approx(150)
    row, column = found.grid.centre
    np.testing.assert_array_equal(found.grid.positions[row, column], 0)
    x, y = places(rows, columns)[row, column]
    expected = places(rows, columns) - [x, y]
    np.testing.assert_allclose(found.grid.positions * found.grid.baseline, expected, atol=1e-9)
    for place in np.ndindex(rows, columns):
        view = SCENE.picture(found.grid.pinhole, *places(rows, columns)[place])
        inside = np.s_[BORDER:-BORDER, BORDER:-BORDER]
        difference = np.abs(view - found.views[place])[inside].max(axis=-1)
        assert np.median(difference) < 0.002
        assert difference.max() < 0.03


@pytest.mark.parametrize(('rows', 'columns'), [(3, 3), (5, 7), (4, 6), (1, 5), (5, 1), (2, 3)])
@pytest.mark.parametrize('focus', [FOCUS, math.inf])
def test_benchmark_folders(tmp_path, rows, columns, focus):
    found = read_light_field(hci(tmp_path, rows, columns, focus))
    check(found, rows, columns)
    # By the benchmark's own formula (its toolkit, depth to disparity): f b (1/z - 1/focus) / s.
    disparity = STEP * 100 * 96 * (1 / SCENE.disc - 1 / focus) / 64
    pinhole = found.grid.pinhole
    assert pinhole.fx * STEP / SCENE.disc - pinhole.fx * STEP / focus == pytest.approx(disparity)


@pytest.mark.parametrize(('name', 'values'), [
    ('view{n}.png', {'files': 'view*.png', 'rows': 5, 'columns': 7}),
    ('{n:04d}.tif', {'rows': 5, 'columns': 7}),
    ('v_{row:02d}_{column}.png', {'files': 'v_{row}_{column}.png'}),
    ('{column}-{row}a.png', {'files': '{column}-{row}*.png', 'rows': 5}),
])
def test_folders_of_pictures(tmp_path, name, values):
    check(read_light_field(grid(tmp_path, name, baseline=STEP, **values)))
    check(read_light_field(tmp_path / 'light_field.yaml'))


@pytest.mark.parametrize('flips', [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize('rows', [4, 5])
def test_columns_to_the_left_and_rows_upwards(tmp_path, flips, rows):
    sign = [-1 if flip else 1 for flip in flips]
    # An even number of views has its centre view half a step beside the axis of the pictures.
    beside = 150 * STEP / 2 / FOCUS * (rows % 2 == 0)
    check(read_light_field(grid(
        tmp_path, ROW_COLUMN, (rows, 7), files=ROW_COLUMN, sign=sign, baseline=STEP,
        flip_x=flips[0], flip_y=flips[1], cx=47.5, cy=39.5 + beside)), rows)


def test_positions_given_one_by_one(tmp_path):
    positions = np.add(places(5, 7), [3.0, -1.0]).reshape(-1, 2).tolist()
    check(read_light_field(grid(tmp_path, ROW_COLUMN, files=ROW_COLUMN, positions=positions)))


@pytest.mark.parametrize('end', ['.png', '_.png'])
@pytest.mark.parametrize('scale', [{'unit': 0.001}, {'baseline': STEP}])
def test_stanford_grids(tmp_path, end, scale):
    """Names tell y, then x, in an unknown unit; here columns go to the left, as in some."""
    folder = grid(tmp_path, 'out_{row:02d}_{column:02d}_{y:.6f}_{x:.6f}' + end, sign=(-1, 1),
                  files='stanford', **scale)
    check(read_light_field(folder))
    (folder / 'light_field.yaml').unlink()
    with pytest.raises(LightFieldError, match=r'called as the Stanford.*files: stanford'):
        read_light_field(folder)


def test_depths_come_out_right(tmp_path):
    """Mistaken signs or order would not match: the wall would not be behind the disc."""
    found = read_light_field(hci(tmp_path, 5, 5, bits=8))
    volume = build_volume(found, DlvSettings(near=0.8, far=3.2, labels=40, views=5))
    truth = SCENE.depth(found.grid.pinhole)
    inside = np.s_[BORDER:-BORDER, BORDER:-BORDER]
    error = np.abs(1 / volume.depth_map() - 1 / truth)[inside]
    assert np.nanmean(error < 0.05) > 0.85


@pytest.mark.parametrize('gamma', [1.0, 2.2])
@pytest.mark.parametrize('bits', [8, 12, 16])
def test_files_become_linear_light(tmp_path, gamma, bits):
    linear = np.linspace(0, 1, 96 * 80 * 3).reshape(80, 96, 3)
    for number in range(2):
        save(tmp_path / f'{number}.png', linear, gamma, bits)
    (tmp_path / 'light_field.yaml').write_text(
        f'{{fx: 100, rows: 1, columns: 2, baseline: 0.01, gamma: {gamma}, '
        f'bits: {12 if bits == 12 else 16}}}')
    found = read_light_field(tmp_path)
    assert found.views.dtype == np.float32
    np.testing.assert_allclose(found.views[0, 0], linear, atol=gamma * 0.6 / (2 ** bits - 1))
    encoded = np.rint(255 * linear ** (1 / gamma))
    if bits == 8:  # as in the files, but for rounding
        np.testing.assert_allclose(found.picture(), encoded, atol=1)


def test_floating_point_pictures_are_taken_as_they_are(tmp_path):
    linear = np.random.default_rng(0).random((8, 9, 3), np.float32)
    for number in range(2):
        assert cv2.imwrite(str(tmp_path / f'{number}.tif'), linear,
                           [cv2.IMWRITE_TIFF_COMPRESSION, 1])  # else old OpenCV loses digits
    (tmp_path / 'light_field.yaml').write_text(
        '{fx: 100, rows: 2, columns: 1, baseline: 0.01, gamma: 1}')
    found = read_light_field(tmp_path)
    np.testing.assert_array_equal(found.views[0, 0], linear[..., ::-1])
    np.testing.assert_allclose(found.grid.positions[:, 0], [[0, -1], [0, 0]])


def test_a_black_view_has_no_weight(tmp_path):
    hci(tmp_path, 3, 3, math.inf)
    save(tmp_path / 'input_Cam000.png', np.zeros((80, 96, 3)))
    weights = read_light_field(tmp_path).grid.weights
    assert weights[0, 0] == 0
    assert weights.sum() == 8


# less of it

@given(count=st.integers(1, 40), every=st.integers(1, 12))
def test_the_centre_view_stays_the_centre(count, every):
    kept = Reduction(every).kept(count)
    assert kept[len(kept) // 2] == count // 2
    assert set(np.diff(kept)) <= {every}
    assert kept[0] < every
    assert kept[-1] >= count - every


@pytest.mark.parametrize('every', [2, 3])
def test_every_kth_view(tmp_path, every):
    whole = read_light_field(hci(tmp_path, 7, 9))
    part = read_light_field(tmp_path, every=every)
    rows, columns = Reduction(every).kept(7), Reduction(every).kept(9)
    np.testing.assert_array_equal(part.views, whole.views[np.ix_(rows, columns)])
    assert part.grid.baseline == pytest.approx(every * STEP)
    np.testing.assert_allclose(part.grid.positions * part.grid.baseline,
                               (whole.grid.positions * whole.grid.baseline)[np.ix_(rows, columns)],
                               atol=1e-12)


@pytest.mark.parametrize('shrink', [2, 3])
def test_shrunk_pictures_have_their_own_camera(tmp_path, shrink):
    """Coarser pixels see the mean of what finer ones do, at the same directions."""
    found = read_light_field(hci(tmp_path, 3, 3), shrink=shrink)
    pinhole = found.grid.pinhole
    assert (pinhole.width, pinhole.height) == (96 // shrink, 80 // shrink)
    top, left = 30, 60
    inside = (np.array([left, top]) + (shrink - 1) / 2 - [47.5, 39.5]) / 150
    place = np.array([left, top]) / shrink
    np.testing.assert_allclose((place - [pinhole.cx, pinhole.cy]) / [pinhole.fx, pinhole.fy],
                               inside, atol=1e-12)
    whole = read_light_field(tmp_path)
    block = np.s_[top:top + shrink, left:left + shrink]
    expected = whole.centre_view[block].mean(axis=(0, 1))
    np.testing.assert_allclose(found.centre_view[top // shrink, left // shrink], expected,
                               atol=1e-4)


def test_too_much_is_refused_with_advice_before_it_is_read(tmp_path):
    save(tmp_path / '0.png', np.zeros((1024, 1024, 3)), bits=8)
    for number in range(1, 17 * 17):
        (tmp_path / f'{number}.png').hardlink_to(tmp_path / '0.png')
    (tmp_path / 'light_field.yaml').write_text('{fx: 100, rows: 17, columns: 17, baseline: 1}')
    with pytest.raises(LightFieldError, match=r'17x17 views of 1024x1024 px need 3468 MiB, more '
                       r'than 768: .*--every 3.*--shrink 3'):
        read_light_field(tmp_path)
    Reduction(3).check_memory(6, 6, 1024, 1024)  # as advised
    Reduction(1, 4).check_memory(17, 17, 1024, 1024)


def test_views_cannot_be_shrunk_to_nothing(tmp_path):
    np.savez(tmp_path / 'a.npz', **GOOD)
    for source in (tmp_path / 'a.npz', hci(tmp_path / 'scene', 3, 3)):
        with pytest.raises(LightFieldError, match='cannot be shrunk by 100'):
            read_light_field(source, shrink=100)


# NPZ

@pytest.fixture
def light_field():
    random = np.random.default_rng(3)
    pinhole = Pinhole(9, 7, 10.1, 10.2, 4.3, 3.1)
    positions = random.normal(size=(4, 5, 2))
    positions[2, 2] = 0
    grid = ViewGrid(pinhole, 1 / 3, positions, random.random((4, 5), np.float32))
    colour = Colour((1.1, 1.0, 1 / 3), ((3.1, -1.9, -0.2), (-0.4, 1.7, -0.3), (0.1, -1.2, 2.1)))
    return LightField(Header(5), 2 * random.random((4, 5, 7, 9, 3), np.float32), grid, 0.41666,
                      colour)


def test_npz_round_trip_is_exact(tmp_path, light_field):
    write_npz(tmp_path / 'views.npz', light_field)
    for path in (tmp_path, tmp_path / 'views.npz'):
        found = read_light_field(path)
        np.testing.assert_array_equal(found.views, light_field.views)
        np.testing.assert_array_equal(found.grid.positions, light_field.grid.positions)
        np.testing.assert_array_equal(found.grid.weights, light_field.grid.weights)
        assert found.grid.pinhole == light_field.grid.pinhole
        assert found.grid.baseline == light_field.grid.baseline
        assert (found.header.stamp_ns, found.gamma) == (path.stat().st_mtime_ns, 0.41666)
        assert found.colour == light_field.colour


def test_npz_without_weights_and_positions(tmp_path):
    views = np.ones((3, 5, 4, 6, 3))
    np.savez(tmp_path / 'a.npz', views=views, fx=5, fy=5, cx=3, cy=2, baseline=0.1)
    found = read_light_field(tmp_path / 'a.npz')
    assert found.views.dtype == np.float32
    np.testing.assert_array_equal(found.grid.weights, 1)
    np.testing.assert_array_equal(found.grid.positions[0, 0], [-2, -1])
    part = read_light_field(tmp_path / 'a.npz', every=2, shrink=2)
    assert part.views.shape == (1, 3, 2, 3, 3)
    assert (part.grid.baseline, part.grid.pinhole.fx) == (0.2, 2.5)
    np.testing.assert_array_equal(part.grid.positions[0], [[-1, 0], [0, 0], [1, 0]])


GOOD = {'views': np.ones((3, 3, 4, 6, 3), np.float32), 'fx': 5, 'fy': 5, 'cx': 3, 'cy': 2,
        'baseline': 0.1}


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'fx': None, 'views': None}, 'has no views, fx'),
    ({'views': np.ones((3, 3, 4, 6, 3), np.uint16)}, 'views are uint16'),
    ({'views': np.ones((3, 4, 6, 3))}, r'of shape \(3, 4, 6, 3\)'),
    ({'views': np.full((3, 3, 4, 6, 3), np.nan)}, 'NaN or infinity'),
    ({'fx': -5}, 'impossible camera'),
    ({'fx': 'long'}, 'fx is <U4'),
    ({'baseline': 0}, 'baseline 0.0 m'),
    ({'weights': np.ones((2, 3))}, r'weights float64 \(2, 3\)'),
    ({'gamma': 0}, 'gamma 0.0 must'),
    ({'gains': np.ones(2), 'matrix': np.eye(3)}, r'gains \[1.0, 1.0\] and matrix'),
    ({'views': np.array([None])}, 'views.npy holds object of shape'),
    ({'fx': 5 + 1j}, 'fx is complex128'),
    ({'weights': np.ones((3, 3), complex)}, 'weights complex128'),
])
def test_an_npz_that_is_none_is_refused(tmp_path, changes, reason):
    values = {name: value for name, value in (GOOD | changes).items() if value is not None}
    np.savez(tmp_path / 'a.npz', **values)
    with pytest.raises(LightFieldError, match=reason) as caught:
        read_light_field(tmp_path / 'a.npz')
    assert 'a.npz' in str(caught.value)


@pytest.mark.parametrize('header', [
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776,), }",
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    b"{'descr': '<f8', 'fortran_order': False, 'shape': (1, }", b'{"""',
    b"{'descr': '|V0', 'fortran_order': False, 'shape': (2,), }", b'(' * 5000])
def test_an_array_whose_header_lies(tmp_path, header):
    np.savez(tmp_path / 'a.npz', **GOOD)
    with zipfile.ZipFile(tmp_path / 'a.npz', 'a') as file:
        file.writestr('weights.npy', b'\x93NUMPY\1\0' + struct.pack('<H', len(header)) + header
                      + bytes(72))
    with pytest.raises(LightFieldError, match=r'a\.npz'):
        read_light_field(tmp_path / 'a.npz')


def test_arrays_that_unpack_to_more_than_is_read(tmp_path):
    with zipfile.ZipFile(tmp_path / 'a.npz', 'w', zipfile.ZIP_DEFLATED) as file:
        for number in range(5):
            file.writestr(f'{number}.npy', b'')
            file.getinfo(f'{number}.npy').file_size = 2 ** 26 * 3 + 1  # as its directory says
    with pytest.raises(LightFieldError, match='5 arrays of 960 MiB, at most 1000 of 769'):
        read_light_field(tmp_path / 'a.npz')


def test_a_flipped_bit_is_noticed(tmp_path):
    np.savez(tmp_path / 'a.npz', **GOOD)
    data = bytearray((tmp_path / 'a.npz').read_bytes())
    data[data.index(b'views.npy') + 300] ^= 1
    (tmp_path / 'a.npz').write_bytes(bytes(data))
    with pytest.raises(LightFieldError, match=r'a\.npz: Bad CRC-32'):
        read_light_field(tmp_path / 'a.npz')


def test_an_array_that_is_called_npz(tmp_path):
    np.save(tmp_path / 'a.npy', np.ones(3))
    (tmp_path / 'a.npy').rename(tmp_path / 'a.npz')
    with pytest.raises(LightFieldError, match=r'cannot read .*a\.npz: File is not a zip file'):
        read_light_field(tmp_path / 'a.npz')


@pytest.mark.parametrize('content', [b'', b'PK', b'text'])
def test_a_file_that_is_no_npz(tmp_path, content):
    (tmp_path / 'a.npz').write_bytes(content)
    with pytest.raises(LightFieldError, match=r'cannot read .*a\.npz'):
        read_light_field(tmp_path / 'a.npz')


# mistakes

@pytest.fixture(scope='module')
def benchmark(tmp_path_factory):
    return hci(tmp_path_factory.mktemp('benchmark'), 3, 3, bits=8)


@pytest.fixture
def broken(benchmark, tmp_path):
    """A copy of a benchmark folder, to be broken."""
    return shutil.copytree(benchmark, tmp_path / 'copy')


@pytest.mark.parametrize(('old', 'new', 'reason'), [
    ('[extrinsics]', '[extra]', "no section 'extrinsics'"),
    ('num_cams_x = 3', '', 'num_cams_x: Field required'),
    ('num_cams_x = 3', 'num_cams_x = 0', 'num_cams_x.*greater than'),
    ('num_cams_x = 3', 'num_cams_x = 4', r'there is no .*input_Cam009\.png'),
    ('focal_length_mm = 100.0', 'focal_length_mm = long', 'focal_length_mm.*valid number'),
    ('focus_distance_m = 1.4', 'focus_distance_m = nan', 'focus_distance_m'),
    ('focus_distance_m = 1.4', 'focus_distance_m = 0.01', 'shifted by up to 450 px.*focus'),
    ('image_resolution_x_px = 96', 'image_resolution_x_px = 97', '96x80 px, .* says 97x80'),
    ('[intrinsics]', 'intrinsics', 'no configuration file'),
])
def test_a_broken_benchmark_file_is_told(broken, old, new, reason):
    path = broken / 'parameters.cfg'
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(LightFieldError, match=reason) as caught:
        read_light_field(broken)
    assert str(broken) in str(caught.value) or 'shifted' in reason


def test_broken_pictures_are_told(broken):
    view = broken / 'input_Cam004.png'
    save(broken / 'input_Cam007.png', np.ones((80, 95, 3)), bits=8)
    with pytest.raises(LightFieldError, match=r'input_Cam007\.png has 95x80 pixels.* 96x80'):
        read_light_field(broken)
    view.write_bytes(view.read_bytes()[:20])
    with pytest.raises(LightFieldError, match=r'input_Cam004\.png: the picture is cut short'):
        read_light_field(broken)
    view.unlink()
    with pytest.raises(LightFieldError, match=r'there is no .*input_Cam004\.png'):
        read_light_field(broken)


BASE = {'fx': 150, 'files': ROW_COLUMN, 'baseline': 0.03}


@pytest.mark.parametrize(('changes', 'reason'), [
    ({'fx': None}, 'fx: Field required'),
    ({'fx': 0.1}, 'fx.*greater than 1'),
    ({'colour': 1}, 'colour: there is no such key'),
    ({'unit': 1}, 'not baseline and unit'),
    ({'baseline': None}, 'not none'),
    ({'baseline': None, 'unit': 1}, r'have no \{x\} and \{y\}'),
    ({'files': '*.png'}, 'rows and columns are needed'),
    ({'files': '*.png', 'rows': 4, 'columns': 3}, '9 pictures.* need 12'),
    ({'files': '{row}_{colum}.png'}, r'\{colum\} is not known'),
    ({'files': '{row}_{row}.png'}, 'there twice'),
    ({'files': 'a{row}_{column}.png'}, 'no picture called'),
    ({'rows': 4}, '3 rows of 3 views, .* says 4'),
    ({'baseline': None, 'positions': [[0, 0]]}, '1 positions for 3 rows of 3'),
    ({'baseline': None, 'positions': [[0, 0]] * 9}, 'are no grid'),
    ({'focus_distance': -1}, 'focus_distance.*greater than 0'),
    ({'focus_distance': 0.01}, 'shifted by up to 450 px'),
])
def test_a_light_field_yaml_with_mistakes(tmp_path, changes, reason):
    folder = grid(tmp_path, ROW_COLUMN, (3, 3), bits=8)
    values = {name: value for name, value in (BASE | changes).items() if value is not None}
    (folder / 'light_field.yaml').write_text(yaml.safe_dump(values))
    with pytest.raises((LightFieldError, SettingsError), match=reason):
        read_light_field(folder)


def test_a_view_that_is_named_by_a_time_stamp(tmp_path):
    folder = grid(tmp_path, 'v_{row}_{column}.png', (2, 2), bits=8,
                  **BASE | {'files': 'v_{row}_{column}.png'})
    shutil.copy(folder / 'v_0_0.png', folder / 'v_0_1700000000.png')
    with pytest.raises(LightFieldError, match=r'more than 999: does v_0_1700000000.png belong'):
        read_light_field(folder)


@pytest.mark.parametrize('files', ['********x{row}{column}', '*a*a*{row}*a*x', '*' * 5000])
def test_a_pattern_that_could_be_tried_without_end(tmp_path, files):
    folder = grid(tmp_path, ROW_COLUMN, (2, 2), bits=8, **BASE | {'files': files})
    shutil.copy(folder / '0_0.png', folder / f'{"a1" * 50}.png')
    with pytest.raises(LightFieldError, match=r'no picture called|more than 4 of \*|rows and col'):
        read_light_field(folder)


def test_a_view_that_is_missing_or_there_twice(tmp_path):
    folder = grid(tmp_path, ROW_COLUMN, (3, 3), bits=8, **BASE)
    shutil.copy(folder / '1_1.png', folder / '01_1.png')
    with pytest.raises(LightFieldError, match='two pictures of row 1, column 1'):
        read_light_field(folder)
    for name in ('1_1.png', '01_1.png'):
        (folder / name).unlink()
    with pytest.raises(LightFieldError, match='no picture of row 1, column 1; 1 are missing'):
        read_light_field(folder)


def test_what_is_no_light_field(tmp_path):
    with pytest.raises(LightFieldError, match='there is no'):
        read_light_field(tmp_path / 'x.npz')
    with pytest.raises(LightFieldError, match=r'no light_field\.yaml, parameters\.cfg or views'):
        read_light_field(tmp_path)
    (tmp_path / 'IMG.RAW').touch()
    assert not is_light_field(tmp_path / 'IMG.RAW')
    assert is_light_field(tmp_path)
    assert is_light_field(tmp_path / 'a.NPZ')
    with pytest.raises(LightFieldError, match='is no light field'):
        read_light_field(tmp_path / 'IMG.RAW')


def test_a_yaml_file_of_another_kind_is_told_what_it_was_read_as(tmp_path):
    camera = tmp_path / 'camera.yaml'
    camera.write_text('{width: 640, height: 480, fx: 600, cx: 320, cy: 240}')
    with pytest.raises(SettingsError, match=(
            r'camera\.yaml: width: there is no such key; .*; it is read as a light_field\.yaml, '
            r'as it has no views, as a views\.yaml, and no frames, as a sweep\.yaml$')):
        read_light_field(camera)


# the shift

@given(x=st.floats(-9, 9), y=st.floats(-9, 9))
def test_a_band_limited_picture_is_shifted_exactly(x, y):
    v, u = np.mgrid[:40, :50].astype(float)

    def wave(u, v):
        return np.stack([0.5 + 0.4 * np.sin(0.5 * u + 0.3 * v + k) for k in range(3)], axis=-1)

    found = shifted(wave(u, v).astype(np.float32), x, y)
    inside = np.s_[12:-12, 12:-12]
    np.testing.assert_allclose(found[inside], wave(u + x, v + y)[inside], atol=0.004)


@pytest.mark.parametrize(('x', 'y'), [(3, -2), (0, 5), (-60, 0)])
def test_whole_pixels_are_moved_untouched_and_the_border_goes_on(x, y):
    picture = np.random.default_rng(1).random((40, 50, 3), np.float32)
    rows = np.clip(np.arange(40) + y, 0, 39)
    columns = np.clip(np.arange(50) + x, 0, 49)
    np.testing.assert_allclose(shifted(picture, x, y), picture[rows][:, columns], atol=1e-6)
