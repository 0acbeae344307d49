"""Edge volumes in which several objects are seen, some in front of others."""

from dataclasses import replace

import numpy as np
import trimesh
from pmcl_scenes import COARSE, cup, edges_seen, model_of, pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings

DEPTHS = depth_labels(0.3, 0.7, 20)
ZOOM = 4
SETTINGS = PmclSettings(roi_center=(0, 0, 0.42), roi_size=(0.14, 0.14, 0.16), renderer='numba',
                        proposals=24, particles=96, moves=2)


def bottle():
    """A vessel about the z axis with a narrow neck, 0.1 m high."""
    profile = [(0, -0.05), (0.02, -0.05), (0.022, 0.0), (0.008, 0.02), (0.009, 0.05), (0, 0.05)]
    return trimesh.creation.revolve(profile, sections=24)


CUP = model_of(cup(), [0, 0, 1], 'cup')
BOTTLE = model_of(bottle(), [0, 0, 1], 'bottle')


def standing(x, y, z, lean=0.0):
    """A pose with the axis up in the image, leaning to the camera [rad]."""
    return pose_of(Rotation.from_euler('x', np.pi / 2 - lean), [x, y, z])


def surface(model, pose, pinhole=COARSE):
    """Its depth in the image, `ZOOM` samples per pixel."""
    shift = (ZOOM - 1) / 2
    camera = Pinhole(pinhole.width * ZOOM, pinhole.height * ZOOM, pinhole.fx * ZOOM,
                     pinhole.fy * ZOOM, pinhole.cx * ZOOM + shift, pinhole.cy * ZOOM + shift)
    scene = Scene(model, camera, Window(0, 0, (camera.width, camera.height)), 0.2, 0.8)
    return NumbaRenderer().depths(scene, pose[None])[0]


def seen_together(things, through=False):
    """A volume in which (model, pose) are seen; through: what is behind is seen as well."""
    depths = [surface(*each) for each in things]
    radius = min(model.radius for model, _ in things)
    if not through:
        nearest = np.min([np.where(each > 0, each, np.inf) for each in depths], axis=0)
        depths = [np.where(np.isfinite(nearest), nearest, 0)]
    tensor = np.array([0.05, 0.05, 0], np.float32)  # no picture is without any edges
    for each in depths:
        edges = edges_seen(each, COARSE, DEPTHS, 0.2 * radius, strength=2.0)
        tensor = tensor + edges.tensor
    return replace(edges, tensor=tensor.astype(np.float32))
