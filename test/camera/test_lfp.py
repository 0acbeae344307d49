"""Containers: round trips, another reader, and every way to be damaged."""

import hashlib
import json
import lzma
import struct
import tracemalloc
from pathlib import Path

import imageio.v2
import numpy as np
import pytest
from click.testing import CliRunner
from command_line import pmcl
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.camera.files import (
    list_pictures,
    read_metadata,
    read_picture,
    read_raw_frame,
    write_picture,
    write_raw_frame,
)
from pmcl_ros.camera.lfp import (
    Container,
    container_bytes,
    file_set,
    picture_to_lfp,
    reference_of,
)
from pmcl_ros.camera.packing import pack12
from pmcl_ros.cli import main
from pmcl_ros.runtime.errors import CameraError, OutputError

WHITE = Path(__file__).parents[2] / 'config' / 'cameras' / 'demo_white.RAW.xz'
RAW = pack12(np.random.default_rng(0).integers(0, 4096, (6, 8)).astype(np.uint16))
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner,
                                                                max_size=3), max_leaves=8)
OBJECTS = st.dictionaries(st.text(max_size=8), JSON, max_size=3)
# What a camera may say beside the fields that are read.
UNREAD = OBJECTS.filter(lambda fields: 'devices' not in fields)


@pytest.fixture(scope='module')
def text(camera_text):
    """As a camera writes it: the frame's part among everything else."""
    frame = {'metadata': json.loads(camera_text(8, 6)),
             'privateMetadata': {'camera': {'serialNumber': 'A1'}}}
    return json.dumps({'debug': {'hot': [1, 2.5]}, 'master': {
        'version': {'major': 1}, 'picture': {
            'frameArray': [{'frame': frame}, {'more': None}], 'derivationArray': ['sha1-x'],
            'accelerationArray': []}}})


@pytest.fixture
def saved(tmp_path):
    """A function bytes -> a file of them."""
    def save(data, name='IMG.LFP'):
        (tmp_path / name).write_bytes(data)
        return tmp_path / name
    return save


def section(magic, body, length=None, reference=None):
    reference = reference or b'sha1-' + hashlib.sha1(body).hexdigest().encode()
    head = struct.pack('>8sII', b'\x89LF' + magic + b'\r\n\x1a\n', 0,
                       len(body) if length is None else length)
    return head + reference.ljust(80, b'\0') + body + bytes(-len(body) % 16)


HEAD = b'\x89LFP\r\n\x1a\n' + struct.pack('>II', 1, 0)


def test_the_layout_of_a_container(text):
    data = picture_to_lfp(RAW, text)
    assert data.startswith(HEAD + b'\x89LFM\r\n\x1a\n')
    assert data.endswith(section(b'C', RAW))
    assert len(data) % 16 == 0
    assert data.count(b'\x89LFC\r\n\x1a\n') == 3


def test_a_picture_survives(saved, text):
    path = saved(picture_to_lfp(RAW, text))
    raw, found = read_picture(path)
    assert raw == RAW
    assert json.loads(found) == json.loads(text)
    frame = read_raw_frame(path)
    assert pack12(frame.counts) == RAW
    assert frame.metadata.serial == read_metadata(path).serial == 'A1'


@settings(deadline=None, max_examples=60)
@given(UNREAD, OBJECTS, OBJECTS, JSON, OBJECTS, st.integers(1, 4), st.integers(1, 4), st.data())
def test_every_picture_survives(tmp_path_factory, camera_text, metadata, private, frame, other,
                                outside, rows, columns, data):
    folder = tmp_path_factory.getbasetemp()
    picture = {'frameArray': [{'frame': {**frame, 'privateMetadata': {'x': private}, 'metadata': {
        **metadata, **json.loads(camera_text(2 * columns, rows))}}}, other],
               'accelerationArray': []}
    text = json.dumps({**outside, 'master': {'picture': picture, 'other': other}})
    raw = data.draw(st.binary(min_size=3 * columns * rows, max_size=3 * columns * rows))
    for name in ('a.RAW', 'a.LFP', 'b.RAW.xz', 'b.lfr', 'c.raw'):
        write_picture(folder / name, raw, text, force=True)  # each made of the one before
        raw_again, text = read_picture(folder / name)
        assert raw_again == raw
    assert json.loads(text)['master'] == {'picture': picture, 'other': other}
    assert (folder / 'a.RAW').read_bytes() == (folder / 'c.raw').read_bytes() == raw
    assert json.loads((folder / 'a.TXT').read_text()) == json.loads(text)


def test_metadata_alone_become_those_of_a_picture(saved, camera_text):
    frame = read_raw_frame(saved(picture_to_lfp(RAW, camera_text(8, 6))))
    master = json.loads(frame.metadata.text)['master']
    assert master['picture']['frameArray'][0]['frame'] == {
        'metadata': json.loads(camera_text(8, 6)), 'privateMetadata': {}}
    assert master['picture']['accelerationArray'] == []  # python-lfp-reader takes none without


def test_another_reader_finds_the_same_picture(tmp_path):
    raw, text = lzma.decompress(WHITE.read_bytes()), WHITE.with_name('demo_white.TXT').read_text()
    write_picture(tmp_path / 'IMG.LFP', raw, text)
    theirs = imageio.v2.imread(tmp_path / 'IMG.LFP', format='LYTRO-LFP')  # 1 is 4095
    np.testing.assert_array_equal(read_raw_frame(tmp_path / 'IMG.LFP').counts,
                                  np.rint(theirs * 4095))
    frame = json.loads(text)['master']['picture']['frameArray'][0]['frame']
    assert {name: theirs.meta[name] for name in frame} == frame


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 31))
def test_another_reader_finds_the_metadata_whatever_the_length(tmp_path_factory, camera_text, n):
    path = tmp_path_factory.getbasetemp() / 'n.LFP'
    write_picture(path, RAW, json.dumps({**json.loads(camera_text(8, 6)), 'n': n * 'n'}),
                  force=True)
    with imageio.v2.get_reader(path, format='LYTRO-LFP', meta_only=True) as reader:
        assert reader.get_meta_data()['metadata']['n'] == n * 'n'


@pytest.mark.parametrize('name', ['IMG.RAW', 'IMG.RAW.xz', 'a.b.LFP', 'a.b.raw', 'IMG.LFR',
                                  'img.raw.XZ'])
def test_a_frame_is_written_and_read(tmp_path, saved, text, name):
    frame = read_raw_frame(saved(picture_to_lfp(RAW, text), 'from.lfp'))
    folder = tmp_path / 'to'
    folder.mkdir()
    write_raw_frame(folder / name, frame)
    again = read_raw_frame(folder / name)
    np.testing.assert_array_equal(again.counts, frame.counts)
    assert json.loads(again.metadata.text) == json.loads(text)
    assert list_pictures(folder) == [folder / name]
    assert len(list(folder.iterdir())) == (1 if 'lf' in name.lower() else 2)


def test_what_cannot_be_written_is_refused(tmp_path, saved, text):
    frame = read_raw_frame(saved(picture_to_lfp(RAW, text)))
    with pytest.raises(CameraError, match=r'not a \.RAW'):
        write_raw_frame(tmp_path / 'IMG.png', frame)
    for name in ('IMG.RAW', 'IMG.LFP'):
        with pytest.raises(OutputError, match=r'cannot write .*IMG\.LFP is no folder'):
            write_raw_frame(tmp_path / 'IMG.LFP' / name, frame)
    with pytest.raises(CameraError, match='not JSON'):
        write_picture(tmp_path / 'x.LFP', RAW, '[')
    with pytest.raises(CameraError, match='cannot be empty'):
        write_picture(tmp_path / 'x.LFP', b'', text)
    assert [each.name for each in tmp_path.iterdir()] == ['IMG.LFP']


def test_the_text_beside_is_found_in_any_letter_case(tmp_path, text):
    (tmp_path / 'Img.Raw').write_bytes(RAW)
    (tmp_path / 'iMG.tXt').write_text(text)
    assert read_raw_frame(tmp_path / 'Img.Raw').metadata.serial == 'A1'


def test_a_picture_of_an_illum_is_refused_by_name(saved):
    table = section(b'M', b'{"frames": [{"frame": {}}]}')
    with pytest.raises(CameraError, match=r'IMG.LFR: Lytro Illum \(10 bit\) is not supported'):
        read_raw_frame(saved(HEAD + section(b'C', b'image') + table, 'IMG.LFR'))


def test_every_cut_is_refused(saved, text):
    data = picture_to_lfp(RAW, text)
    end = len(data.rstrip(b'\0')) if RAW[-1] else len(data) - (-len(RAW) % 16)
    for length in [*range(0, end, 7), end - 1]:
        with pytest.raises(CameraError, match=r'/IMG\.LFP'):
            read_raw_frame(saved(data[:length]))
    read_raw_frame(saved(data[:end]))  # the padding is nobody's loss


def test_every_flipped_byte_of_a_body_is_found(saved, text):
    data = picture_to_lfp(RAW, text)
    container = Container.open(saved(data))
    for each in container.sections:
        for place in (each.offset, each.offset + each.length // 2,
                      each.offset + each.length - 1):
            broken = data[:place] + bytes([data[place] ^ 1]) + data[place + 1:]
            with pytest.raises(CameraError, match=f'bytes from byte {each.offset} have sha1-.*'
                                                  'the file is damaged'):
                read_raw_frame(saved(broken))


@pytest.mark.parametrize(('data', 'reason'), [
    (b'', 'does not begin as an LFP'),
    (HEAD, '0 tables of contents'),
    (HEAD + 2 * section(b'M', b'{}'), '2 tables of contents'),
    (HEAD + section(b'M', b'{}', length=0xFFFFFFFF),
     r'section at byte 16 claims 4294967295 bytes, only 16 are left'),
    (HEAD + section(b'M', b'{}', reference=b'sha1-' + 40 * b'0'), 'have sha1-bf2.*damaged'),
    (HEAD + section(b'M', b'{}', reference=b'md5-'), 'expected sha1- and 40 hex digits'),
    (HEAD + section(b'X', b'{}'), 'no section begins at byte 16'),
    (HEAD + section(b'M', b'{}') + b'\x89LFC', 'ends within a section header, at byte 128'),
    (HEAD + 10_001 * section(b'C', b'', length=0)[:16], 'more than 10000 sections'),
    (HEAD + section(b'M', b'[]'), 'table of contents holds list'),
    (HEAD + section(b'M', b'\xff'), 'table of contents is not JSON'),
    (HEAD + section(b'M', 100_000 * b'['), 'table of contents is not JSON'),
    (HEAD + section(b'M', b' ' * 4_000_001), 'has 4000001 bytes, at most 4000000'),
    (HEAD + section(b'M', b'{}'), r'no picture.frameArray\[0\].frame'),
    (HEAD + section(b'M', b'{"picture": {"frameArray": [7]}}'), 'no picture.frameArray'),
    (HEAD + section(b'M', b'{"picture": {"frameArray": [{"frame": {"imageRef": 7}}]}}'),
     r'imageRef: .*got 7.*metadataRef: Field required'),
    (HEAD + section(b'M', b'{"picture": {"frameArray": [{"frame": {"imageRef": "sha1-a", '
                          b'"metadataRef": "sha1-b"}}]}}'), "no component 'sha1-b'"),
    (HEAD + section(b'M', b'{"picture": {"frameArray": [' + 700 * b'[' + 700 * b']' + b']}}'),
     'no picture.frameArray'),
])
def test_what_is_no_container_is_refused_with_little_memory(saved, data, reason):
    path = saved(data)
    tracemalloc.start()
    with pytest.raises(CameraError, match=rf'/IMG\.LFP: .*{reason}'):
        read_raw_frame(path)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


@pytest.mark.parametrize('depth', [100, 900, 960, 990, 1100, 3000, 100_000])
def test_nested_json_is_kept_or_refused(tmp_path, text, depth):
    deep = text.replace('"debug"', f'"deep": {depth * "["}{depth * "]"}, "debug"')
    try:
        write_picture(tmp_path / 'IMG.LFP', RAW, deep)
        found = read_picture(tmp_path / 'IMG.LFP')[1]
    except CameraError as error:
        found = str(error)
    if depth > 500 and not found.startswith('{'):
        assert 'nested too deeply' in found or 'not JSON' in found
    else:
        assert found.count('[') == deep.count('[')


def test_a_body_that_begins_and_ends_with_zeros_survives(saved):
    components = [bytes(5), b'\0ab\0', bytes(range(16)), bytes(16)]
    container = Container.open(saved(container_bytes({}, components)))
    assert [container.component(each.reference, 100) for each in container.sections
            if not each.is_table] == components


@pytest.fixture
def file_container(saved):
    """A function names -> a container of files, each with its own name as its body."""
    def make(*names, empty=()):
        bodies = {name: name.encode() for name in names} | dict.fromkeys(empty, b'')
        table = {'files': [{'name': name, 'dataRef': f'sha1-{hashlib.sha1(body).hexdigest()}'}
                           for name, body in bodies.items()]}
        return saved(container_bytes(table, [*filter(None, bodies.values())]), 'data.C.0')
    return make


def test_files_of_a_camera(file_container):
    path = file_container('C:\\T1CALIB\\MOD_0001.RAW', 'C:\\T1CALIB\\MOD_0001.TXT', 'C:/a/x.bin')
    container = Container.open(path)
    assert list(file_set(container)) == ['MOD_0001.RAW', 'MOD_0001.TXT', 'x.bin']
    found = file_set(container, 'mod_*')
    assert list(found) == ['MOD_0001.RAW', 'MOD_0001.TXT']
    assert container.component(found['MOD_0001.RAW'], 100) == b'C:\\T1CALIB\\MOD_0001.RAW'


def test_a_file_of_a_camera_may_be_empty(file_container, tmp_path):
    done = pmcl('lfp', 'unpack', file_container('a.bin', empty=['LOG']), tmp_path / 'out')
    assert done.stdout.split() == [str(tmp_path / 'out' / name) for name in ('a.bin', 'LOG')]
    assert (tmp_path / 'out' / 'LOG').read_bytes() == b''


@pytest.mark.parametrize('name', ['..', 'a/..', 'C:\\', '', 'a\0', '.hidden', 'x\ny'])
def test_names_that_could_lead_elsewhere_are_refused(file_container, name):
    with pytest.raises(CameraError, match='is no name of a file'):
        file_set(Container.open(file_container(name or 'a/')))


def test_two_files_of_one_name_are_refused(file_container):
    with pytest.raises(CameraError, match='two different files MOD'):
        file_set(Container.open(file_container('a/MOD', 'b/MOD')))


def test_the_commands(tmp_path, text, file_container):
    (tmp_path / 'IMG.RAW').write_bytes(RAW)
    (tmp_path / 'IMG.TXT').write_text(text)
    lfp, out = str(tmp_path / 'new.LFP'), tmp_path / 'out'

    def run(*arguments):
        done = CliRunner().invoke(main, ['lfp', *map(str, arguments)])
        return done.output if done.exit_code == 0 else f'{done.exit_code}: {done.output}'
    assert 'camera A1, 8x6 pixels' in run('pack', tmp_path / 'IMG.RAW', lfp)
    assert run('unpack', lfp, out) == f'{out}/new.RAW\n{out}/new.TXT\n'
    assert (out / 'new.RAW').read_bytes() == RAW
    assert json.loads((out / 'new.TXT').read_text()) == json.loads(text)
    listed = run('info', lfp).splitlines()
    assert [line.split('  ')[-1] for line in listed[2:]] == [
        'table of contents', 'metadata', 'privateMetadata', 'image']
    calibration = file_container('C:\\T1CALIB\\MOD_0001.RAW', 'C:\\x')
    assert 'MOD_0001.RAW' in run('info', calibration)
    assert run('unpack', calibration, out, '--only', 'MOD_*') == f'{out}/MOD_0001.RAW\n'
    assert not (out / 'x').exists()
    (out / 'new.TXT').write_text('mine')
    (tmp_path / 'other.RAW').write_bytes(RAW[::-1])
    (tmp_path / 'other.TXT').write_text(text)
    for path, arguments in ((out / 'new.TXT', ('unpack', lfp, out)),
                            (out / 'MOD_0001.RAW', ('unpack', calibration, out)),
                            (lfp, ('pack', tmp_path / 'other.RAW', lfp))):
        before = Path(path).read_bytes()
        assert f'Error: {path} is there already' in run(*arguments)
        assert Path(path).read_bytes() == before
        assert str(path) in run(*arguments, '--force')
    assert json.loads((out / 'new.TXT').read_text())
    assert run('unpack', calibration, tmp_path / 'none', '--only', 'y').startswith('1: Error: ')
    assert not (tmp_path / 'none').exists()
    assert run('pack', tmp_path / 'IMG.RAW', tmp_path / 'a.zip').startswith('1: Error: ')
    stack = tmp_path / 'a-stk.lfp'
    stack.write_bytes(HEAD + section(b'M', b'{"picture": {"imageRef": "x"}}'))
    assert 'holds no raw picture' in run('info', stack)


def test_a_processed_picture_is_told_from_one_that_was_cut_short(tmp_path, text):
    picture = json.loads(text)['master']['picture']
    picture['frameArray'][0]['frame'] = dict.fromkeys(
        ('imageRef', 'metadataRef', 'privateMetadataRef'), f'sha1-{40 * "0"}')
    cut = tmp_path / 'cut.lfp'
    cut.write_bytes(container_bytes({'picture': picture}, [b'jpeg']))
    with pytest.raises(CameraError, match='was cut short'):
        read_raw_frame(cut)
    jpeg = {'imageRef': reference_of(b'jpeg'), 'lambda': 1.0}
    picture['accelerationArray'] = [{'type': 'com.lytro.acceleration.refocusStack',
                                     'vendorContent': {'imageArray': [jpeg]}}]
    stack = tmp_path / 'a-stk.lfp'
    stack.write_bytes(container_bytes({'picture': picture}, [b'jpeg']))
    done = CliRunner().invoke(main, ['lfp', 'unpack', str(stack), str(tmp_path / 'out')])
    assert done.exit_code == 1
    assert 'a-stk.lfp: a processed picture' in done.output
    assert not (tmp_path / 'out').exists()
    info = CliRunner().invoke(main, ['lfp', 'info', str(stack)])
    assert info.exit_code == 0
    assert reference_of(b'jpeg') in info.output
