"""Bad files of every reader: one line, exit status 1, within 5 s and 1 GB."""

import json
import shutil
import struct
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
import zstandard
from bounded_commands import outcome, refused

from pmcl_ros.lightfield.readers.npz import save_npz
from pmcl_ros.messages.mcap_records import MAGIC, Op, record, text

ROOT = Path(__file__).parents[2]
BAG = ROOT / 'bags' / 'wine_glass'
MERGES = 'a0: &a0 {x: 1}\n' + '\n'.join(
    f'a{n}: &a{n}\n  <<: [{", ".join([f"*a{n - 1}"] * 9)}]' for n in range(1, 12))
ROI = ('--roi', 0, 0, 0.5, 0.2, 0.2, 0.2)
OUTSIDE = ('--roi', 5, 0, 0.5, 0.2, 0.2, 0.2)
BOTTLE = ROOT / 'config' / 'objects' / 'bottle.yaml'


def bag(folder, data=b'', metadata=None):
    folder.mkdir()
    shutil.copy(BAG / 'metadata.yaml', folder)
    if metadata is not None:
        (folder / 'metadata.yaml').write_text(metadata)
    (folder / 'wine_glass.mcap').write_bytes(data)
    return folder


def flipped():
    data = bytearray((BAG / 'wine_glass.mcap').read_bytes())
    data[len(data) // 2] ^= 1
    return bytes(data)


def bomb():
    """2 GB of zeros."""
    packed = zstandard.ZstdCompressor().compress(bytes(2 ** 27)) * 16
    chunk = record(Op.CHUNK, struct.pack('<QQQI', 0, 0, 2 ** 28, 0), text('zstd'),
                   struct.pack('<Q', len(packed)), packed)
    return (MAGIC + record(Op.HEADER, text('ros2'), text('')) + chunk
            + record(Op.FOOTER, bytes(20)) + MAGIC)


@pytest.mark.parametrize(('data', 'metadata', 'told'), [
    (flipped(), None, 'checksum of the chunk|is damaged'),
    (flipped()[:8], None, 'cut short'),
    (bomb(), None, 'unpack to more than 268435456'),
    (b'', MERGES, 'more than 100000 values'),
    (b'', '[' * 100_000, '64 levels|maximum nesting depth'),  # the latter by libyaml itself
], ids=['flipped', 'cut', 'bomb', 'merges', 'nested'])
def test_bags(tmp_path, data, metadata, told):
    made = bag(tmp_path / 'bag', data, metadata)
    line = refused(tmp_path, 'bag', 'extract', made, tmp_path / 'out')
    assert any(each in line for each in told.split('|'))
    assert not list((tmp_path / 'out').iterdir())


@pytest.mark.parametrize(('content', 'told'), [
    (MERGES, 'more than 100000 values'),
    ('mesh: ' + ':'.join(['1'] * 3000), 'a number of 5999 characters'),
    ('\n'.join(f'k{n}: 1' for n in range(300_000)), 'more than 100000 values'),
    ('\n'.join(f'k{n}: 1' for n in range(49_000)), 'and 48996 more'),
    ('mesh: [1,\n b: {', 'is not valid YAML in line'),
], ids=['merges', 'sexagesimal', 'keys', 'fields', 'syntax'])
def test_objects(tmp_path, content, told):
    (tmp_path / 'a.yaml').write_text(content)
    assert told in refused(tmp_path, 'grasps', tmp_path / 'a.yaml')


def test_a_file_of_gigabytes(tmp_path):
    for name in ('a.yaml', 'a.stl', 'a.npz', 'a.RAW'):
        with (tmp_path / name).open('wb') as file:
            file.truncate(9 * 2 ** 30)
    (tmp_path / 'a.TXT').write_text('{}')
    assert 'more than 4 MiB' in refused(tmp_path, 'grasps', tmp_path / 'a.yaml')
    assert 'more than 64 MiB' in refused(tmp_path, 'grasps', tmp_path / 'a.stl')
    assert 'not a zip file' in refused(
        tmp_path, 'bag', 'record', tmp_path / 'a.npz', tmp_path / 'bag')
    assert 'more than 100000000 bytes' in refused(
        tmp_path, 'bag', 'record', tmp_path / 'a.RAW', tmp_path / 'bag')


def test_meshes(tmp_path):
    (tmp_path / 'a.off').write_text('OFF\n0 0 0\n')
    assert 'a.off' in refused(tmp_path, 'grasps', tmp_path / 'a.off')
    with zipfile.ZipFile(tmp_path / 'a.zip', 'w', zipfile.ZIP_DEFLATED) as file:
        file.writestr('a.stl', bytes(2 ** 24))
    assert 'stl, obj, ply, off, glb are read' in refused(tmp_path, 'grasps', tmp_path / 'a.zip')


TRIANGLE = b'0 0 0\n' * 3
PLY = (b'ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n'
       b'property float y\nproperty float z\nelement face 5000000\n'
       b'property list uchar int vertex_indices\nend_header\n')


@pytest.mark.parametrize(('name', 'begin', 'repeated', 'times', 'told'), [
    ('a.off', b'OFF\n3 3500000 0\n' + TRIANGLE, b'3 0 1 2\n', 3_500_000, 'has 3500000 faces'),
    ('b.off', b'OFF\n3 1 0\n' + TRIANGLE + b'20000000 ', b'0 1 ', 10_000_000, ' corners, at most'),
    ('c.off', b'OFF\n3 1 0\n', b'\n', 60_000_000, 'has 60000002 lines'),
    ('a.obj', b'f 1 2 3\n', b'v 0 0 1\n', 7_000_000, 'has 7000000 vertices'),
    ('b.obj', b'f 1 2 3\n', b'vn 0 0 1\n', 7_000_000, 'has 7000000 vertices'),
    ('a.ply', PLY, b'\0', 36 + 13 * 5_000_000, 'has 5000000 faces'),
    ('a.stl', bytes(80) + struct.pack('<I', 1_340_000), bytes(50), 1_340_000,
     'has 1340000 faces, at most 1000000 are read'),
    ('b.stl', b'solid\n', b'vertex 0 0 0\n', 5_000_000, 'has 1666666 faces'),
])
def test_meshes_of_many_faces(tmp_path, name, begin, repeated, times, told):
    (tmp_path / name).write_bytes(begin + times * repeated)
    assert told in refused(tmp_path, 'grasps', tmp_path / name)


def test_arrays(tmp_path):
    np.save(tmp_path / 'a.npy', np.ones(3))
    (tmp_path / 'a.npy').rename(tmp_path / 'a.npz')
    assert 'not a zip file' in refused(
        tmp_path, 'bag', 'record', tmp_path / 'a.npz', tmp_path / 'bag')
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (9, 9, 10000, 100000, 3), }"
    with zipfile.ZipFile(tmp_path / 'b.npz', 'w') as file:
        file.writestr('views.npy', b'\x93NUMPY\1\0' + struct.pack('<H', len(header)) + header)
    assert 'says that it has' in refused(
        tmp_path, 'bag', 'record', tmp_path / 'b.npz', tmp_path / 'bag')


def picture(side):
    head = struct.pack('>IIBBBBB', side, side, 8, 2, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + b''.join(
        struct.pack('>I', len(content)) + name + content
        + struct.pack('>I', zlib.crc32(name + content))
        for name, content in ((b'IHDR', head), (b'IDAT', zlib.compress(b'')), (b'IEND', b'')))


def test_pictures(tmp_path):
    for side in (20000, 60000):
        (tmp_path / 'a.png').write_bytes(picture(side))
        assert f'{side}x{side} px' in refused(
            tmp_path, 'decode', tmp_path / 'a.png', '--out', tmp_path / 'out')
    (tmp_path / 'views').mkdir()
    for name in ('v_0_0.png', 'v_0_1.png'):
        (tmp_path / 'views' / name).write_bytes(picture(60000))
    (tmp_path / 'views' / 'light_field.yaml').write_text(
        'files: v_{row}_{column}.png\nfx: 100\nbaseline: 0.01')
    assert '60000x60000 px' in refused(
        tmp_path, 'bag', 'record', tmp_path / 'views', tmp_path / 'bag')
    (tmp_path / 'views' / 'v_0_1700000000.png').write_bytes(b'')
    assert 'v_0_1700000000.png belong there' in refused(
        tmp_path, 'bag', 'record', tmp_path / 'views', tmp_path / 'bag')
    (tmp_path / 'views' / f'{"a" * 100}.png').write_bytes(b'')
    (tmp_path / 'views' / 'light_field.yaml').write_text(
        "files: '********x{row}{column}'\nfx: 100\nbaseline: 0.01")
    assert 'no picture called' in refused(
        tmp_path, 'bag', 'record', tmp_path / 'views', tmp_path / 'bag')


def views(folder, width, height, count=1, distortion=()):
    """A views.yaml, of pictures of one colour."""
    folder.mkdir()
    cv2.imwrite(str(folder / '0.png'), np.full((height, width, 3), 90, np.uint8))
    for number in range(1, count):
        (folder / f'{number}.png').hardlink_to(folder / '0.png')
    pose = [[1.0, 0, 0, 0.1 * number, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
            for number in range(count)]
    (folder / 'views.yaml').write_text(yaml.safe_dump({
        'cameras': {'one': {'width': width, 'height': height, 'fx': 4000.0, 'cx': width / 2,
                            'cy': height / 2, 'distortion': list(distortion)}},
        'views': [{'file': f'{number}.png', 'camera': 'one'}
                  | ({'camera_to_reference': pose[number]} if count > 1 else {})
                  for number in range(count)]}))
    return folder


@pytest.mark.parametrize(('given', 'told'), [
    ((8190, 8190), '67.1 million pixels, at most 33.6 are read, and need 768 MiB, at most 768'),
    ((4090, 4090), 'is outside the image (4090x4090)'),
    ((4090, 4090, 1, (0.1, 0, 0, 0)), 'is outside the image (4090x4090)'),
    ((4090, 4090, 2), 'none of the 2 views sees the region of interest'),
    ((4032, 3024, 6), 'shrink them (--shrink 2), or take fewer'),
], ids=str)
def test_pictures_that_evidence_is_made_of(tmp_path, given, told):
    assert told in refused(tmp_path, 'localize', views(tmp_path / 'views', *given), '--object',
                           BOTTLE, *OUTSIDE)


@pytest.mark.parametrize(('kind', 'height', 'width', 'roi', 'told'), [
    ('f4', 2800, 2800, ROI, '6 arrays of 807 MiB, at most 1000 of 769 are read'),
    ('f2', 2800, 2800, ROI, '3x3 views of 2800x2800 px need 807 MiB, more than 768'),
    ('f4', 2100, 2100, ROI, '24 edge_labels of 2100x2100 px need 3.5 GiB'),
    ('f2', 1900, 1900, OUTSIDE, 'is outside the image (1900x1900)'),
    ('f8', 1300, 1400, OUTSIDE, 'is outside the image (1400x1300)'),
])
def test_light_fields_that_evidence_is_made_of(tmp_path, kind, height, width, roi, told):
    save_npz(tmp_path / 'a.npz', views=np.full((3, 3, height, width, 3), 0.2, kind), fx=1000.0,
             fy=1000.0, cx=width / 2, cy=height / 2, baseline=1e-3)
    assert told in refused(tmp_path, 'localize', tmp_path / 'a.npz', '--object', BOTTLE, *roi)


def test_memory_that_does_not_suffice(tmp_path):
    found = outcome(tmp_path, 'localize', views(tmp_path / 'views', 4000, 3000), '--object',
                    BOTTLE, *ROI, '--set', 'renderer=numba', spare=200)
    line, = found.text.strip().splitlines()
    assert found.status == 1
    assert line.startswith('Error: there is not enough memory')
    assert 'make pixels larger (--shrink 2, ' in line


def test_metadata(tmp_path, camera_text):
    values = json.loads(camera_text(4, 2))
    (tmp_path / 'a.RAW').write_bytes(bytes(12))
    for change, told in (('\ud800\x1b[31m', 'serialNumber'), (3, 'serialNumber')):
        whole = {'master': {'picture': {'frameArray': [{'frame': {
            'metadata': values, 'privateMetadata': {'camera': {'serialNumber': change}}}}]}}}
        (tmp_path / 'a.TXT').write_text(json.dumps(whole))
        assert told in refused(
            tmp_path, 'bag', 'record', tmp_path / 'a.RAW', tmp_path / 'bag')
    values['image']['rawDetails']['mosaic']['tile'] = 'x' * 300_000
    (tmp_path / 'a.TXT').write_text(json.dumps(values))
    assert len(refused(tmp_path, 'bag', 'record', tmp_path / 'a.RAW', tmp_path / 'bag')) < 2500


def test_calibrations_and_truths(tmp_path):
    (tmp_path / 'a.yaml').write_text(MERGES)
    shutil.copy(ROOT / 'models' / 'shaker.obj', tmp_path)
    assert 'more than 100000 values' in refused(
        tmp_path, 'localize', BAG, '--calibration', tmp_path / 'a.yaml', '--object',
        tmp_path / 'shaker.obj', *ROI)
    (tmp_path / 'a.json').write_text('[' * 100_000)
    assert 'a.json is not valid JSON' in refused(
        tmp_path, 'calibration-from-truth', tmp_path / 'a.json', tmp_path / 'a.json', '--out',
        tmp_path / 'out.yaml')
