"""Writes generated captures and sequences to disk, with their truth.

Files that are there and that no earlier run wrote raise OutputError, unless `force`.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml
from numpy.typing import NDArray

from pmcl_ros.camera.files import write_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.readers import posed_views
from pmcl_ros.lightfield.readers.npz import write_npz
from pmcl_ros.messages.bag_captures import light_field_messages, pose_message
from pmcl_ros.messages.bags import Recorded, record, remove_bag
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.runtime.outputs import Results, replacing, write_file
from pmcl_ros.simulation.camera_plan import CameraPlan, in_room
from pmcl_ros.simulation.card import with_card
from pmcl_ros.simulation.scenes.render import SyntheticCapture, seen_from
from pmcl_ros.simulation.scenes.scene import Scene, Target
from pmcl_ros.simulation.sequence import Sequence as MovingScene

FIXED_FRAME = 'odom'
_COMMAND = 'scenes'  # of whom a capture is the result: it may be begun and ended by several
_STEP = 2.0 ** -10  # of a view's values: far below their noise, and half the bytes on disk


def write_capture(folder: Path, scene: Scene, capture: SyntheticCapture, seed: int,
                  force: bool = False, digest: str = '') -> None:
    """Write views.npz, model.obj, truth.json, centre.png, depth.npz into a folder.

    model.obj and truth.json are of the first target; those of other targets lie in numbered
    subfolders.
    A target with discrete symmetries, or of which a user says what it is made of, has a model.yaml
    too.
    Views are kept with 11 bits of precision, far below their noise. digest: of what the capture
    was made of, for truth.json.
    """
    light_field = capture.light_field
    with Results(folder, _COMMAND, force) as out:
        write_npz(out.path('views.npz'),
                  replace(light_field, views=light_field.views.astype('f2')))
        write_png(out.path('centre.png'), light_field.picture())
        depth = out.path('depth.npz')
        with replacing(depth) as part, part.open('wb') as file:
            np.savez_compressed(file, depth=capture.depth, labels=capture.labels)
        _write_targets(out, scene, seed, digest)


def write_raw(folder: Path, scene: Scene, frame: RawFrame, seed: int, force: bool = False
              ) -> None:
    """Write IMG.RAW, IMG.TXT, model.obj, truth.json into a folder, as `write_capture` does."""
    with Results(folder, _COMMAND, force) as out:
        out.reserve('IMG.TXT')
        write_raw_frame(out.path('IMG.RAW'), frame, force=True)
        _write_targets(out, scene, seed)


def write_view(folder: Path, scene: Scene, picture: NDArray[np.uint8],
               camera: posed_views.ViewCamera, seed: int, force: bool = False, digest: str = ''
               ) -> None:
    """Write view.png, views.yaml, model.obj, truth.json into a folder, as `write_capture` does.

    picture: (height, width, 3) RGB of the camera.
    """
    with Results(folder, _COMMAND, force) as out:
        write_png(out.path('view.png'), picture)
        _write_views(out, camera, [{'file': 'view.png'}])
        _write_targets(out, scene, seed, digest)


def write_views(folder: Path, scene: Scene, pictures: Sequence[NDArray[np.uint8]],
                camera: posed_views.ViewCamera, plan: CameraPlan, seed: int, force: bool = False,
                digest: str = '') -> None:
    """Write 000.png, ..., views.yaml, model.obj, truth.json into a folder.

    pictures: (height, width, 3) RGB each, from the plan's poses. The reference frame is that of
    the room (`in_room`), the region of interest a box along its axes. The errors of the poses in
    views.yaml and the views that a card hides are drawn from the seed; truth.json has the true
    poses.
    """
    cameras = plan.cameras(scene)
    rng = np.random.default_rng([seed, len(cameras)])
    reported = in_room(scene, plan.reported(cameras, rng))
    hidden = rng.permutation(len(cameras))[:plan.hidden]
    entries: list[dict[str, Any]] = []
    shown: list[NDArray[np.uint8]] = []
    for number, (picture, pose) in enumerate(zip(pictures, reported, strict=True)):
        if number in hidden:
            seen = seen_from(scene, cameras[number]).targets[0]
            corners = seen.vertices @ seen.pose[:3, :3].T + seen.pose[:3, 3]
            picture = with_card(picture, camera.pinhole.project(corners), rng)
        shown.append(picture)
        entry = {'file': f'{number:03d}.png', 'camera_to_reference': pose.ravel().tolist()}
        if plan.stated and (plan.sigma_mm or plan.sigma_deg):
            entry |= {'sigma_mm': plan.sigma_mm, 'sigma_deg': plan.sigma_deg}
            if plan.common:
                entry |= {'group': 'arm', 'common': plan.common}
        entries.append(entry)
    room = in_room(scene, np.eye(4))
    targets = tuple(replace(each, pose=room @ each.pose,
                            roi_center=tuple((room[:3, :3] @ each.roi_center
                                              + room[:3, 3]).tolist()))
                    for each in scene.targets)
    with Results(folder, _COMMAND, force) as out:
        for entry, picture in zip(entries, shown, strict=True):
            write_png(out.path(entry['file']), picture)
        _write_views(out, camera, entries, 'room')
        _write_targets(out, replace(scene, targets=targets), seed, digest, 'object_to_reference',
                       {'cameras_to_reference': in_room(scene, cameras).tolist()})


def _write_views(out: Results, camera: posed_views.ViewCamera, entries: list[dict[str, Any]],
                 reference: str | None = None) -> None:
    values = camera.model_dump(mode='json', exclude_none=True,
                               include=set(posed_views.ViewCamera.model_fields))
    written = {'cameras': {'camera': values},
               'views': [{'camera': 'camera'} | each for each in entries]}
    if reference is not None:
        written['reference'] = reference
    write_file(out.path(posed_views.NAME),
               yaml.safe_dump(written, sort_keys=False, default_flow_style=None))


def _write_targets(out: Results, scene: Scene, seed: int, digest: str = '',
                   key: str = 'object_to_camera', more: dict[str, Any] | None = None) -> None:
    """The last files of a capture. key: of the pose, after its frame. more: of each truth."""
    for number, target in reversed([*enumerate(scene.targets)]):  # truth.json itself is the last
        place = '' if number == 0 else f'{number}/'
        mesh = trimesh.Trimesh(target.vertices, target.faces, process=False)
        model = out.path(f'{place}model.obj')
        with replacing(model) as part, part.open('w') as file:
            mesh.export(file, 'obj', digits=7)
        if described := _described(target):
            write_file(out.path(f'{place}model.yaml'),
                       yaml.safe_dump({'mesh': 'model.obj'} | described))
        film = any(sheet.opacity < 1 for sheet in scene.sheets)
        truth = {'name': scene.name, 'seed': seed, **({'digest': digest} if digest else {}),
                 'film': film, **_truth(target, key), **(more or {})}
        write_file(out.path(f'{place}truth.json'), json.dumps(truth, indent=1) + '\n')
    out.remove_others()  # of another capture that was here


def _described(target: Target) -> dict[str, Any]:
    """What model.yaml says of a mesh, as `ObjectSettings` reads it: what a search makes use of.

    Nothing where the mesh alone says all.
    """
    if len(target.discrete) == 1 and target.appearance is None:
        return {}
    axes = [] if target.axis is None else [{'axis': target.axis.tolist()}]
    values: dict[str, Any] = {
        'scale': 1.0, 'symmetries_continuous': axes,
        'symmetries_discrete': target.discrete[1:].reshape(-1, 16).tolist()}
    if target.appearance is not None:
        values['appearance'] = target.appearance.model_dump(
            include={'material', 'roughness', 'up'}, exclude_none=True)
    return values


def _truth(target: Target, key: str) -> dict[str, Any]:
    """As in the truth.json of a capture."""
    symmetry = None if target.axis is None else {'axis': target.axis.tolist()}
    return {key: target.pose.tolist(), 'empty': target.empty,
            'symmetry_continuous': symmetry,
            'roi': {'center': list(target.roi_center), 'size': list(target.roi_size)}}


def write_sequence(folder: Path, sequence: MovingScene,
                   report: Callable[[int], None] = lambda _: None, force: bool = False) -> None:
    """Write bag/, model.obj, truth.json, parameters.yaml into a folder.

    The bag holds the topics of `subaperture_node`, and camera_pose: the optical frame in
    `FIXED_FRAME`. With the parameters `dlv_node` and `pmcl_node` track the object in the bag; they
    name the mesh by its absolute path. report: called with the number of frames written.
    force: overwrite a bag. Raises BagError when there is a bag already.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if force:
        remove_bag(folder / 'bag')
    record(folder / 'bag', _messages(sequence, report))
    mesh = trimesh.Trimesh(sequence.model.vertices, sequence.model.faces, process=False)
    with replacing(folder / 'model.obj') as part, part.open('w') as file:
        mesh.export(file, 'obj', digits=7)
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
    write_file(folder / 'truth.json', json.dumps(truth, indent=1) + '\n')
    write_file(folder / 'parameters.yaml', yaml.safe_dump(
        {f'/**/{node}': {'ros__parameters': values}
         for node, values in _parameters(folder, sequence).items()}, sort_keys=False))


def _parameters(folder: Path, sequence: MovingScene) -> dict[str, dict[str, object]]:
    of = sequence.settings
    near, far = Region(sequence.roi_center, sequence.roi_size).grown(sequence.model.radius)
    return {
        'dlv_node': {'views': of.views, 'near': near, 'far': far},
        'pmcl_node': {
            'object': str((folder / 'model.obj').resolve()),
            'roi_center': list(sequence.roi_center), 'roi_size': list(sequence.roi_size),
            'tracking': 'constant_velocity', 'track_period': 1 / of.rate,
            'track_camera': 'topic', 'track_frame': FIXED_FRAME}}


def _messages(sequence: MovingScene, report: Callable[[int], None]) -> Iterator[Recorded]:
    for number, frame in enumerate(sequence):
        light_field = frame.light_field
        views = np.round(light_field.views / np.float32(_STEP)) * np.float32(_STEP)
        where = Header(light_field.header.stamp_ns, FIXED_FRAME)
        yield pose_message('/camera_pose', where, frame.camera)
        yield from light_field_messages(replace(light_field, views=views))
        report(number + 1)
