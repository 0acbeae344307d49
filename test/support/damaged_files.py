"""Small files of every format that is read, and how each is read."""

import json
import lzma
import shutil
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
import yaml

from pmcl_ros.camera.files import read_raw_frame
from pmcl_ros.camera.lfp import picture_to_lfp
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.mosaic_image import read_mosaic_image
from pmcl_ros.camera.packing import pack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.evaluation.bop_captures import BopChoice, bop_captures
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.grasps.grasp import GraspFile
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.npz import write_npz
from pmcl_ros.lightfield.readers.pictures import read_picture
from pmcl_ros.lightfield.readers.read import read_light_field, read_source
from pmcl_ros.messages.bag_captures import (
    capture_messages,
    light_field_messages,
    pose_message,
    posed_views_messages,
    read_bag,
)
from pmcl_ros.messages.bags import Recorded, record
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.cdr import cdr_from
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.mcap_records import HEAD, MAGIC
from pmcl_ros.messages.types import CompressedImage
from pmcl_ros.pmcl.object_model import ObjectModel

ROOT = Path(__file__).parents[2]
RNG = np.random.default_rng(5)
COLOURS = RNG.integers(0, 256, (9, 12, 3)).astype(np.uint8)
PINHOLE = Pinhole(12, 9, 20.0, 21.0, 5.5, 4.0)
HEADER = Header(1_700_000_000_000_000_000, 'camera')


@dataclass(frozen=True)
class Format:
    """data: of a whole file. write: makes the file of damaged data, and returns its path.

    read: reads it. exact: what is read at all is what was written.
    """

    data: bytes
    write: Callable[[bytes], Path]
    read: Callable[[Path], Any]
    exact: bool = False


def formats(folder, camera_text):
    """By name, all in a folder that is theirs."""
    made = {**bag_formats(folder / 'bags', camera_text(12, 8)),
            **picture_formats(folder / 'pictures'), **mesh_formats(folder / 'meshes'),
            **view_formats(folder / 'views'), **other_formats(folder / 'others', camera_text)}
    for each in made.values():
        each.read(each.write(each.data))
    return made


def at(folder, name, data, read, source=None, **options):
    """A file of a folder. source: what is read; the file itself."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name

    def write(damaged):
        path.write_bytes(damaged)
        return source or path
    return Format(data, write, read, **options)


def bag_formats(folder, text):
    counts = RNG.integers(0, 4096, (8, 12)).astype(np.uint16)
    raw = capture_messages(RawFrame(HEADER, counts, CameraMetadata.parse(text)))
    grid = ViewGrid(PINHOLE, 0.01, nominal_positions(2, 2), np.ones((2, 2), np.float32))
    field = light_field_messages(LightField(
        HEADER, RNG.random((2, 2, 9, 12, 3)).astype(np.float32), grid))
    pose = np.eye(4)
    pose[0, 3] = 0.3
    posed = posed_views_messages(PosedViews(tuple(
        PosedView(HEADER, (COLOURS / 255).astype(np.float32), PINHOLE, each)
        for each in (np.eye(4), pose))))
    made = {}
    for name, messages in (('raw', raw), ('views', field), ('posed', posed), ('robot', robot())):
        bag = folder / name
        record(bag, messages)
        file = bag / f'{name}.mcap'
        whole = file.read_bytes()
        made[f'mcap of {name}'] = at(bag, file.name, whole, values_of, bag, exact=True)
        # Beside: with right checksums of wrong messages, the largest of them.
        number = max(range(len(messages)), key=lambda n: len(messages[n].cdr))
        made[f'message of {name}'] = in_bag(folder / f'message {name}', messages, number)
    record(folder / 'plain', raw, compress=False)
    whole = bytearray((folder / 'plain' / 'plain.mcap').read_bytes())
    start = 2 * HEAD.size + len(MAGIC) + HEAD.unpack_from(whole, len(MAGIC))[1]  # of the chunk
    whole[start + 24:start + 28] = bytes(4)
    made['mcap without checksum'] = at(folder / 'plain', 'plain.mcap', bytes(whole), values_of,
                                       folder / 'plain')
    record(folder / 'metadata', raw)
    made['metadata.yaml'] = at(
        folder / 'metadata', 'metadata.yaml', (folder / 'metadata/metadata.yaml').read_bytes(),
        values_of, folder / 'metadata', exact=True)
    made['db3'] = sqlite(folder / 'sqlite', raw)
    return made


def robot():
    """Images, plain and compressed, from two places; each with its camera_info and pose."""
    messages = []
    for second in range(8):
        header = Header(HEADER.stamp_ns + second * 10 ** 9 // 4, 'camera')
        pose = np.eye(4)
        pose[0, 3] = 0.2 * (second // 4)
        image = CompressedImage(header=header_to_message(header), format='png', data=np.frombuffer(
            cv2.imencode('.png', COLOURS)[1].tobytes(), np.uint8))
        info = pinhole_to_message(header, PINHOLE)
        messages += [
            Recorded('/wrist/image/compressed', 'sensor_msgs/msg/CompressedImage',
                     header.stamp_ns, cdr_from(image)),
            Recorded('/wrist/camera_info', 'sensor_msgs/msg/CameraInfo', header.stamp_ns,
                     cdr_from(info)),
            pose_message('/camera_pose', Header(header.stamp_ns, 'base'), pose)]
    return messages


def in_bag(folder, messages, number):
    """The message of a number, in a bag with the others."""
    folder.mkdir(parents=True)
    made = iter(range(10 ** 9))

    def write(damaged):
        bag = folder / str(next(made))
        record(bag, [each._replace(cdr=damaged) if place == number else each
                     for place, each in enumerate(messages)])
        return bag
    return Format(messages[number].cdr, write, values_of)


def sqlite(folder, messages):
    folder.mkdir(parents=True)
    file = sqlite3.connect(folder / 'a.db3')
    file.execute('CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
                 'serialization_format TEXT, offered_qos_profiles TEXT)')
    file.execute('CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp '
                 'INTEGER, data BLOB)')
    for number, each in enumerate(messages):
        file.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?)',
                     (number, each.topic, each.type, 'cdr', ''))
        file.execute('INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)',
                     (number, each.time_ns, each.cdr))
    file.commit()
    file.close()
    (folder / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
        'version': 4, 'storage_identifier': 'sqlite3', 'relative_file_paths': ['a.db3']}}))
    return at(folder, 'a.db3', (folder / 'a.db3').read_bytes(), values_of, folder)


def values_of(bag):
    """What is in a bag, to be compared."""
    found = read_bag(bag)
    if isinstance(found, RawFrame):
        return found.counts.tolist(), found.metadata.text
    if isinstance(found, LightField):
        return found.views.tolist(), found.grid.positions.tolist()
    return [(each.picture.tolist(), each.camera_to_reference.tolist()) for each in found.views]


def picture_formats(folder):
    made = {}
    for kind in ('png', 'jpg', 'tif', 'bmp', 'webp', 'ppm'):
        data = cv2.imencode(f'.{kind}', COLOURS)[1].tobytes()
        made[kind] = at(folder, f'a.{kind}', data, lambda path: read_picture(path).tolist(),
                        exact=kind == 'png')
    made['png with right checksums'] = Format(
        struct.pack('>IIBBBBB', 12, 9, 8, 2, 0, 0, 0)
        + zlib.compress(b''.join(b'\0' + row.tobytes() for row in COLOURS)),
        lambda data: png(folder / 'made.png', data), read_picture)
    made['mosaic'] = at(folder, 'mosaic.png', cv2.imencode('.png', COLOURS[..., 0])[1].tobytes(),
                        lambda path: read_mosaic_image(path).counts.tolist(), exact=True)
    return made


def png(path, data):
    path.write_bytes(b'\x89PNG\r\n\x1a\n' + b''.join(
        struct.pack('>I', len(part)) + name + part + struct.pack('>I', zlib.crc32(name + part))
        for name, part in ((b'IHDR', data[:13]), (b'IDAT', data[13:]), (b'IEND', b''))))
    return path


def mesh_formats(folder):
    ball = trimesh.creation.box((0.03, 0.05, 0.11))
    made = {}
    for kind in ('stl', 'obj', 'ply', 'off', 'glb'):
        data = ball.export(file_type=kind)
        data = data.encode() if isinstance(data, str) else data
        made[kind] = at(folder, f'a.{kind}', data, ObjectModel.load)
    made['stl in text'] = at(folder, 'b.stl', ball.export(file_type='stl_ascii').encode(),
                             ObjectModel.load)
    made['ply in text'] = at(
        folder, 'b.ply', trimesh.exchange.ply.export_ply(ball, encoding='ascii'),
        ObjectModel.load)
    (folder / 'c.stl').write_bytes(ball.export(file_type='stl'))
    made['object'] = at(folder, 'object.yaml', b'mesh: c.stl\nscale: 1.0\n'
                        b'symmetries_continuous: []\nsymmetries_discrete: [[-1.0, 0.0, 0.0, 0.0, '
                        b'0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]]\n',
                        ObjectModel.load)
    grasps = (ROOT / 'config/objects/wine_glass.grasps.yaml').read_bytes().replace(
        b'../../models/wine_glass.obj', b'c.stl')
    made['grasps'] = at(folder, 'grasps.yaml', grasps, GraspFile.read)
    return made


def view_formats(folder):
    for name in ('grid', 'posed', 'sweep', 'colmap/images', 'bop/rgb', 'hci', 'set/000001/rgb'):
        (folder / name).mkdir(parents=True)
        for number in range(3):
            for file in (f'v_0_{number}.png', f'{number:06d}.png', f'input_Cam{number:03d}.png'):
                cv2.imwrite(str(folder / name / file), np.tile(COLOURS, (4, 4, 1)))
    pose = [[1.0, 0, 0, 0.1 * number, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] for number in range(3)]
    camera = {'width': 48, 'height': 36, 'fx': 20.0, 'fy': 21.0, 'cx': 5.5, 'cy': 4.0}
    pose[1] = {'position': [0.1, 0, 0], 'orientation': {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 1.0}}
    grid = {'files': 'v_{row}_{column}.png', 'rows': 1, 'columns': 3, 'fx': 20.0,
            'baseline': 0.01, 'focus_distance': 1.5, 'gamma': 2.2}
    posed = {'cameras': {'one': {**camera, 'distortion': [0.1, 0.01, 0.0, 0.0]}}, 'views': [
        {'file': f'v_0_{number}.png', 'camera': 'one', 'camera_to_reference': each,
         'sigma_mm': 1.0, 'stamp': 12.5} for number, each in enumerate(pose)]}
    tools = {'fl_x': 20.0, 'cx': 6.0, 'cy': 4.5, 'w': 48, 'h': 36, 'k1': 0.1, 'frames': [
        {'file_path': f'./v_0_{number}.png', 'transform_matrix': [
            [1, 0, 0, 0.1 * number], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
        for number in range(3)]}
    sweep = {'rows': 1, 'columns': 3, 'baseline': 0.01, 'near': 0.4, 'far': 1.0, 'camera': {
        key: value for key, value in camera.items() if key not in ('width', 'height')},
        'frames': [{'file': f'v_0_{number}.png', 'position': [0.01 * number, 0, 0],
                    'orientation': [0.0, 0, 0, 1]} for number in range(3)]}
    scene = {str(number): {'cam_K': [20.0, 0, 5.5, 0, 21, 4, 0, 0, 1],
                           'cam_R_w2c': [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
                           'cam_t_w2c': [100.0 * number, 0, 0]} for number in range(3)}
    truth = {str(number): [{'obj_id': 2, 'cam_R_m2c': [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
                            'cam_t_m2c': [0.0, 0, 500]}] for number in range(3)}
    visible = {str(number): [{'visib_fract': 0.5}] for number in range(3)}
    targets = [{'scene_id': 1, 'im_id': number, 'obj_id': 2} for number in range(3)]
    test_scene = folder / 'set' / '000001'
    (folder / 'set' / 'models').mkdir()
    (folder / 'set' / 'models' / 'obj_000002.ply').touch()  # read by whoever searches
    (test_scene / 'scene_camera.json').write_text(json.dumps(scene))
    (test_scene / 'scene_gt.json').write_text(json.dumps(truth))
    hci = {'intrinsics': {'focal_length_mm': 100.0, 'image_resolution_x_px': 48,
                          'image_resolution_y_px': 36, 'sensor_size_mm': 64.0},
           'extrinsics': {'num_cams_x': 3, 'num_cams_y': 1, 'baseline_mm': 5.0,
                          'focus_distance_m': 2.0}}
    cameras = b'# cameras\n7 OPENCV 48 36 20 21 6.0 4.5 0.1 0.01 0 0\n'
    images = '\n'.join(f'{number} 1 0 0 0 {0.1 * number} 0 0 7 v_0_{number}.png\n1.0 2.0 -1'
                       for number in range(3)).encode()
    place, binary = folder / 'colmap', folder / 'colmap_binary'
    (place / 'cameras.txt').write_bytes(cameras)
    (place / 'images.txt').write_bytes(images)
    shutil.copytree(place / 'images', binary / 'images')
    cameras_bin = struct.pack('<QiiQQ8d', 1, 7, 4, 48, 36, 20, 21, 6, 4.5, 0.1, 0.01, 0, 0)
    images_bin = struct.pack('<Q', 3) + b''.join(struct.pack(
        '<i7di9sxQddq', number, 1, 0, 0, 0, 0.1 * number, 0, 0, 7, f'v_0_{number}.png'.encode(),
        1, 1.0, 2.0, -1) for number in range(3))
    (binary / 'cameras.bin').write_bytes(cameras_bin)
    (binary / 'images.bin').write_bytes(images_bin)
    npz = folder / 'views.npz'
    made_field = LightField(HEADER, RNG.random((1, 3, 9, 12, 3)).astype(np.float32), ViewGrid(
        PINHOLE, 0.01, nominal_positions(1, 3), np.ones((1, 3), np.float32)))
    write_npz(npz, made_field)

    def captures(path):
        return bop_captures([path], BopChoice())

    def aimed_at(path):
        return bop_captures([test_scene], BopChoice(targets=path))

    def colmap(path):
        return read_source(path, metric=Metric(1.0))
    return {
        'light_field.yaml': at(folder / 'grid', 'light_field.yaml', dump(grid), read_light_field),
        'views.yaml': at(folder / 'posed', 'views.yaml', dump(posed), read_source),
        'transforms.json': at(folder / 'posed', 'transforms.json', json.dumps(tools).encode(),
                              read_source),
        'sweep.yaml': at(folder / 'sweep', 'sweep.yaml', dump(sweep), read_light_field),
        'bop': at(folder / 'bop', 'scene_camera.json', json.dumps(scene).encode(), read_source,
                  folder / 'bop'),
        'scene_gt.json': at(test_scene, 'scene_gt.json', json.dumps(truth).encode(), captures,
                            test_scene),
        'scene_gt_info.json': at(test_scene, 'scene_gt_info.json', json.dumps(visible).encode(),
                                 captures, test_scene),
        'targets': at(folder, 'targets.json', json.dumps(targets).encode(), aimed_at),
        'hci': at(folder / 'hci', 'parameters.cfg', '\n'.join(
            line for name, part in hci.items() for line in (f'[{name}]', *(
                f'{key} = {value}' for key, value in part.items()))).encode(), read_light_field,
            folder / 'hci'),
        'cameras.txt': at(place, 'cameras.txt', cameras, colmap, place),
        'images.txt': at(place, 'images.txt', images, colmap, place),
        'cameras.bin': at(binary, 'cameras.bin', cameras_bin, colmap, binary),
        'images.bin': at(binary, 'images.bin', images_bin, colmap, binary),
        'npz': at(folder, 'views.npz', npz.read_bytes(),
                  lambda path: read_light_field(path).views.tolist(), exact=True),
        'npz with right checksums': npz_of_header(folder / 'made.npz', npz)}


def npz_of_header(path, npz):
    """Its views with a damaged header."""
    with zipfile.ZipFile(npz) as file:
        parts = {each: file.read(each) for each in file.namelist()}

    def write(damaged):
        with zipfile.ZipFile(path, 'w') as file:
            for name, data in parts.items():
                file.writestr(name, damaged + data[128:] if name == 'views.npy' else data)
        return path
    return Format(parts['views.npy'][:128], write, read_light_field)


def other_formats(folder, camera_text):
    folder.mkdir()
    metadata = json.loads(camera_text(8, 6))
    text = json.dumps({'master': {'picture': {'frameArray': [{'frame': {
        'metadata': metadata, 'privateMetadata': {'camera': {'serialNumber': 'A1'}}}}]}}})
    raw = pack12(RNG.integers(0, 4096, (6, 8)).astype(np.uint16))
    for name in ('text', 'raw', 'xz'):
        (folder / f'{name}.TXT').write_text(text)
    (folder / 'text.RAW').write_bytes(raw)
    truth = {'object_to_camera': np.eye(4).tolist(), 'roi': {
        'center': [0, 0, 0.5], 'size': [0.1, 0.1, 0.1]}, 'name': 'x'}

    def counts(path):
        return read_raw_frame(path).counts.tolist()
    return {
        'txt': at(folder, 'text.TXT', text.encode(), counts, folder / 'text.RAW'),
        'raw': at(folder, 'raw.RAW', raw, counts),
        'xz': at(folder, 'xz.RAW.xz', lzma.compress(raw), counts, exact=True),
        'lfp': at(folder, 'a.LFP', picture_to_lfp(raw, text), counts, exact=True),
        'calibration': at(folder, 'camera.yaml', (ROOT / 'config/cameras/demo.yaml').read_bytes(),
                          Calibration.load),
        'truth': at(folder, 'truth.json', json.dumps(truth).encode(), Truth.load)}


def dump(values):
    return yaml.safe_dump(values).encode()


