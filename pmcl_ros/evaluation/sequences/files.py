"""Sequences on disk: a bag that plays into the nodes, the mesh, and the truth of every frame."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

from pmcl_ros.bags import Recorded, light_field_messages, pose_message, record
from pmcl_ros.evaluation.sequences.sequence import Sequence
from pmcl_ros.header import Header

FIXED_FRAME = 'odom'
_STEP = 2.0 ** -10  # of a view's values: far below their noise, and half the bytes on disk


def write_sequence(folder: Path, sequence: Sequence,
                   told: Callable[[int], None] = lambda _: None) -> None:
    """Write bag/, model.obj, truth.json into a folder.

    The bag is what `subaperture_node` would publish, and camera_pose: the optical frame in
    `FIXED_FRAME`. told: how many frames are written. Raises BagError when there is a bag already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    record(folder / 'bag', _messages(sequence, told))
    mesh = trimesh.Trimesh(sequence.model.vertices, sequence.model.faces, process=False)
    mesh.export(folder / 'model.obj', digits=7)
    axis = sequence.model.axis
    truth = {
        'seed': sequence.seed, 'kind': sequence.kind,
        'settings': sequence.settings.model_dump(mode='json'),
        'symmetry_continuous': None if axis is None else {'axis': axis.tolist()},
        'roi': {'center': list(sequence.roi_center), 'size': list(sequence.roi_size)},
        'fixed_frame': FIXED_FRAME,
        'frames': [{'stamp_ns': sequence.header(number).stamp_ns,
                    'object_to_camera': sequence.poses[number].tolist(),
                    'camera_to_fixed': sequence.cameras[number].tolist(),
                    'occluded': number in sequence.hidden} for number in range(len(sequence))]}
    (folder / 'truth.json').write_text(json.dumps(truth, indent=1) + '\n')


def _messages(sequence: Sequence, told: Callable[[int], None]) -> Iterator[Recorded]:
    for number, frame in enumerate(sequence):
        light_field = frame.light_field
        views = np.round(light_field.views / np.float32(_STEP)) * np.float32(_STEP)
        where = Header(light_field.header.stamp_ns, FIXED_FRAME)
        yield pose_message('/camera_pose', where, frame.camera)
        yield from light_field_messages(replace(light_field, views=views))
        told(number + 1)
