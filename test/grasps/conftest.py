"""Vessels, and the grasps that are made for them."""

import numpy as np
import pytest
import trimesh

from pmcl_ros.grasps.clearance import Clearance, surface_points
from pmcl_ros.grasps.revolution import grasps_of
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel

# (radius, height) of closed outlines, from the axis and back [m]
OUTLINES = {
    'cup': [(0, 0), (0.030, 0), (0.034, 0.10), (0.031, 0.10), (0.027, 0.004), (0, 0.004)],
    'bottle': [(0, -0.09), (0.033, -0.09), (0.034, -0.08), (0.034, 0.03), (0.015, 0.06),
               (0.014, 0.10), (0, 0.10)],
    'goblet': [(0, -0.07), (0.032, -0.07), (0.031, -0.066), (0.005, -0.062), (0.004, -0.02),
               (0.028, 0.01), (0.033, 0.04), (0.029, 0.08), (0.0275, 0.08), (0.0315, 0.04),
               (0.0265, 0.013), (0, 0.0)],
}


def vessel(name, axis=(0, 0, 1), sections=48):
    mesh = trimesh.creation.revolve(OUTLINES[name], sections=sections)
    mesh.apply_transform(trimesh.geometry.align_vectors([0, 0, 1], axis))
    return ObjectModel(name, np.array(mesh.vertices), np.array(mesh.faces, np.int64),
                       np.array(axis, float), bool(mesh.is_volume))


@pytest.fixture(scope='session')
def vessels():
    """The models by name, and one that lies along x."""
    return {name: vessel(name) for name in OUTLINES} | {'lying cup': vessel('cup', (1, 0, 0))}


@pytest.fixture(scope='session')
def made(vessels):
    """The grasps of each, with a Fetch."""
    return {name: grasps_of(model, GripperSettings()) for name, model in vessels.items()}


@pytest.fixture(scope='session')
def rooms(vessels, made):
    """How much room the grasps of the cup have."""
    points = surface_points(vessels['cup'])
    return [Clearance.from_points(each, points, GripperSettings()) for each in made['cup']]


@pytest.fixture(scope='session')
def mesh_of():
    return lambda model: trimesh.Trimesh(model.vertices, model.faces, process=False)
