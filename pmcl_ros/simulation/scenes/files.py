"""Synthetic captures on disk, as `pmcl localize` and `pmcl evaluate` read captures."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yaml

from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.lightfield.readers.npz import write_npz
from pmcl_ros.simulation.scenes.render import SyntheticCapture
from pmcl_ros.simulation.scenes.scene import Scene, Target


def write_capture(folder: Path, scene: Scene, capture: SyntheticCapture, seed: int) -> None:
    """Write views.npz, model.obj, truth.json, centre.png, depth.npz into a folder.

    model.obj and truth.json are of the first target; the other ones' are in numbered subfolders.
    A target with discrete symmetries has a model.yaml too.
    Views are kept with 11 bits of precision, far below their noise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    light_field = capture.light_field
    write_npz(folder / 'views.npz', replace(light_field, views=light_field.views.astype('f2')))
    write_png(folder / 'centre.png', light_field.picture())
    np.savez_compressed(folder / 'depth.npz', depth=capture.depth, labels=capture.labels)
    for number, target in enumerate(capture.targets):
        place = folder if number == 0 else folder / str(number)
        place.mkdir(exist_ok=True)
        mesh = trimesh.Trimesh(target.vertices, target.faces, process=False)
        mesh.export(place / 'model.obj', digits=7)
        if len(target.discrete) > 1:
            (place / 'model.yaml').write_text(yaml.safe_dump(_object(target)))
        film = any(sheet.opacity < 1 for sheet in scene.sheets)
        truth = {'name': scene.name, 'seed': seed, 'film': film} | _truth(target)
        (place / 'truth.json').write_text(json.dumps(truth, indent=1) + '\n')


def _object(target: Target) -> dict[str, Any]:
    """As `ObjectSettings` reads it."""
    return {'mesh': 'model.obj', 'symmetries_continuous': [],
            'symmetries_discrete': target.discrete[1:].reshape(-1, 16).tolist()}


def _truth(target: Target) -> dict[str, Any]:
    """As in the truth.json of a capture."""
    symmetry = None if target.axis is None else {'axis': target.axis.tolist()}
    return {'object_to_camera': target.pose.tolist(), 'empty': target.empty,
            'symmetry_continuous': symmetry,
            'roi': {'center': list(target.roi_center), 'size': list(target.roi_size)}}
