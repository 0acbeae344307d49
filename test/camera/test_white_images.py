"""The white image for a picture, chosen from folders as cameras leave them."""

import json
import lzma

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import pack12
from pmcl_ros.camera.white_images import WhiteImages, choose_white
from pmcl_ros.runtime.errors import CameraError

SIDE = 16
ONE_CAMERA = {  # name: zoom, focus, exposure [s], brightness of the range
    'MOD_0001': (100, 500, 0.004, 0.3), 'MOD_0002': (100, 500, 0.010, 0.7),
    'MOD_0003': (480, 500, 0.004, 0.3), 'MOD_0004': (480, 500, 0.010, 0.7),
    'MOD_0005': (480, 800, 0.004, 0.3), 'MOD_0006': (480, 800, 0.010, 0.7),
    'MOD_0007': (860, 707, 0.004, 0.3), 'MOD_0008': (860, 707, 0.010, 0.7),
}


@pytest.fixture
def text(camera_text):
    """A function -> the JSON of a picture: serial, zoom, focus, exposure, marks."""
    def text(serial='A1', zoom=None, focus=None, exposure=None, **tags):
        frame = json.loads(camera_text(SIDE, SIDE))
        frame['devices'] = {
            'lens': {name: value for name, value in (('zoomStep', zoom), ('focusStep', focus))
                     if value is not None},
            'shutter': {} if exposure is None else {'frameExposureDuration': exposure}}
        picture = {'frameArray': [{'frame': {
            'metadata': frame, 'privateMetadata': {'camera': {'serialNumber': serial}}}}]}
        if tags:
            picture['parameters'] = {'vendorContent': {'com.lytro.tags': tags}}
        return json.dumps({'master': {'picture': picture}})
    return text


@pytest.fixture
def picture(text):
    return lambda *args, **more: CameraMetadata.parse(text(*args, **more))


@pytest.fixture
def folder(tmp_path, text):
    """A function that writes a picture and its text; the folder is `.path`."""
    def write(name, brightness=0.7, serial='A1', zoom=600, focus=700, exposure=0.01, end='.RAW',
              **tags):
        path = tmp_path / f'{name}{end}'
        path.parent.mkdir(parents=True, exist_ok=True)
        counts = np.full((SIDE, SIDE), round(168 + brightness * (4095 - 168)), np.uint16)
        data = pack12(counts)
        path.write_bytes(lzma.compress(data) if end.lower().endswith('xz') else data)
        ending = '.txt' if end.islower() else '.TXT'
        (tmp_path / f'{name}{ending}').write_text(text(serial, zoom, focus, exposure, **tags))
        return path
    write.path = tmp_path
    return write


@pytest.fixture
def one_camera(folder):
    for name, (zoom, focus, exposure, brightness) in ONE_CAMERA.items():
        folder(name, brightness, 'A1', zoom, focus, exposure)
    return folder


@pytest.mark.parametrize(('zoom', 'focus', 'name'), [
    (100, 500, 'MOD_0002'), (480, 600, 'MOD_0004'), (480, 700, 'MOD_0006'),
    (982, 600, 'MOD_0008'),  # as a real F01's picture: its folder has none nearer
    (500, 5000, 'MOD_0006'), (680, 500, 'MOD_0008'), (660, 707, 'MOD_0006')])
def test_nearest_zoom_then_focus_then_the_longer_exposure(one_camera, picture, zoom, focus, name):
    choice = choose_white(one_camera.path, picture('A1', zoom, focus))
    assert choice.path.stem == name
    zoom_of, focus_of, exposure, _ = ONE_CAMERA[name]
    assert (f'zoom step {zoom_of} (picture: {zoom}), focus step {focus_of} (picture: {focus}), '
            f'{exposure:g} s') in choice.why
    assert choice.frame.metadata.zoom == zoom_of


@given(zoom=st.floats(0, 1100), focus=st.floats(0, 2000))
def test_no_other_is_nearer(tmp_path_factory, camera_text, zoom, focus):
    """By plain comparison of every white image with the chosen one."""
    def metadata(zoom, focus, exposure=None):
        frame = json.loads(camera_text(SIDE, SIDE))
        frame['devices'] = {'lens': {'zoomStep': zoom, 'focusStep': focus},
                            'shutter': {'frameExposureDuration': exposure}}
        return json.dumps(frame)

    path = tmp_path_factory.getbasetemp() / 'plain'
    if not path.exists():
        path.mkdir()
        for name, (z, f, exposure, brightness) in ONE_CAMERA.items():
            counts = np.full((SIDE, SIDE), 168 + int(3900 * brightness), np.uint16)
            (path / f'{name}.RAW').write_bytes(pack12(counts))
            (path / f'{name}.TXT').write_text(metadata(z, f, exposure))
    chosen = choose_white(path, CameraMetadata.parse(metadata(zoom, focus))).frame.metadata
    for z, f, exposure, _ in ONE_CAMERA.values():
        rank = abs(z - zoom), abs(f - focus), -exposure
        assert (abs(chosen.zoom - zoom), abs(chosen.focus - focus), -chosen.exposure) <= rank


def test_only_the_chosen_pixels_are_read(one_camera, picture):
    for path in one_camera.path.glob('*.RAW'):
        if path.stem != 'MOD_0004':
            path.write_bytes(b'not read')
    assert choose_white(one_camera.path, picture('A1', 480, 510)).path.stem == 'MOD_0004'


def test_a_saturated_and_a_dark_one_are_passed_over_and_named(folder, picture):
    folder('MOD_0001', 0.5, exposure=0.004)
    folder('MOD_0002', 1.0, exposure=0.010)
    folder('MOD_0003', 0.01, exposure=0.02)
    choice = choose_white(folder.path, picture('A1', 600, 700))
    assert choice.path.stem == 'MOD_0001'
    assert 'skipped MOD_0003.RAW: too dark, at 1 %' in choice.why
    assert 'skipped MOD_0002.RAW: saturated, at 100 %' in choice.why


def test_a_broken_one_is_passed_over(folder, picture):
    folder('MOD_0001', exposure=0.004)
    folder('MOD_0002').write_bytes(b'cut short')
    choice = choose_white(folder.path, picture('A1', 600, 700))
    assert choice.path.stem == 'MOD_0001'
    assert '9 bytes, expected 384' in choice.why


def test_when_none_can_be_used_all_are_named(folder, picture):
    folder('MOD_0001', 1.0)
    folder('MOD_0002', 0.0)
    with pytest.raises(CameraError, match=r'no usable white image(?s:.)*MOD_0001.*saturated'
                                          '.*MOD_0002.*too dark'):
        choose_white(folder.path, picture('A1', 600, 700))


@pytest.mark.parametrize(('name', 'end'), [
    ('a/mod_7', '.raw'), ('b/c/MOD_7', '.RAW.xz'), ('mod_7', '.Raw.XZ')])
def test_any_case_compressed_and_in_subfolders(folder, picture, name, end):
    path = folder(name, end=end)
    assert choose_white(folder.path, picture('A1', 600, 700)).path == path


def test_pictures_beside_the_white_image_are_none(folder, picture):
    folder('IMG_0001')
    folder('IMG_0002', modulationFrame=False)
    folder('MOD_0003', modulationFrame=False)
    folder('MOD_0004', darkFrame=True)
    white = folder('IMG_0005', modulationFrame=True, darkFrame=False)
    assert choose_white(folder.path, picture('A1', 600, 700)).path == white
    white.unlink()
    with pytest.raises(CameraError, match=r'none of its 4 pictures is called MOD_\* or marked'):
        WhiteImages(folder.path)


def test_the_same_camera_of_two(folder, picture):
    folder('one/MOD_0001', serial='A1', zoom=600)
    second = folder('two/MOD_0001', serial='A2', zoom=500)
    assert choose_white(folder.path, picture('A2', 600, 700)).path == second
    assert WhiteImages(folder.path).serials == ['A1', 'A2']
    with pytest.raises(CameraError, match=r'from camera A3, the white images.*are of A1, A2'):
        choose_white(folder.path, picture('A3', 600, 700))
    with pytest.raises(CameraError, match=r'no serial number.*A1, A2'):
        choose_white(folder.path, picture('', 600, 700))


@pytest.mark.parametrize('as_file', [True, False])
@pytest.mark.parametrize(('serial', 'zoom', 'reason'), [
    ('A2', 600, 'from camera A2, .* of A1'),
    ('A1', 982, 'zoom step 982, the nearest .* at zoom step 600: more than 240 steps'),
    ('A1', 100, 'zoom step 100, the nearest .* at zoom step 600')])
def test_another_camera_or_zoom_is_refused_and_both_are_named(folder, picture, as_file, serial,
                                                              zoom, reason):
    path = folder('MOD_0001', zoom=600)
    with pytest.raises(CameraError, match=reason):
        choose_white(path if as_file else folder.path, picture(serial, zoom, 700))


@pytest.mark.parametrize('name', ['MOD_0001', 'white'])
def test_a_file_that_is_given_is_taken_whatever_its_name(folder, picture, name):
    path = folder(name)
    choice = choose_white(path, picture('A1', 590, 705))
    assert choice.path == path
    assert 'the only one' in choice.why


def test_what_the_texts_do_not_tell(folder, picture):
    path = folder('MOD_0001', zoom=None, focus=None, exposure=None, serial='')
    for known in (picture('A1', 600, 700), picture('')):
        choice = choose_white(folder.path, known)
        assert choice.path == path
        assert 'zoom step unknown' in choice.why
    folder('MOD_0002', zoom=100)
    folder('MOD_0003', zoom=600)
    with pytest.raises(CameraError, match=r'have no zoom step, .* of zoom steps 100, 600'):
        choose_white(folder.path, picture('A1'))


def test_where_zooms_are_told_one_without_is_not_taken(folder, picture):
    folder('MOD_0001', zoom=None)
    told = folder('MOD_0002', zoom=500, exposure=0.004)
    assert choose_white(folder.path, picture('A1', 600, 700)).path == told


def test_one_object_serves_many_pictures(one_camera, picture):
    images = WhiteImages(one_camera.path)
    first = images.choose(picture('A1', 100, 500))
    assert images.choose(picture('A1', 110, 520)).frame is first.frame
    assert images.choose(picture('A1', 470, 520)).path.stem == 'MOD_0004'


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(CameraError, match='there is no'):
        WhiteImages(tmp_path / 'nothing')
    with pytest.raises(CameraError, match=r'no \.RAW'):
        WhiteImages(tmp_path)


def test_the_shipped_white_image_is_marked(picture):
    from pathlib import Path
    cameras = Path(__file__).parents[2] / 'config' / 'cameras'
    choice = choose_white(cameras, picture('A000000001', 600, 700))
    assert choice.path.name == 'demo_white.RAW.xz'
