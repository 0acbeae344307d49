"""Simplified meshes: how far they are from the full ones, in space and in the image."""

from time import process_time

import numpy as np
import pytest
import trimesh
from pmcl_scenes import bracket, cup, model_of, random_poses
from scipy.ndimage import distance_transform_edt

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.contour_evidence import scene
from pmcl_ros.pmcl.localizer import FINEST_DETAIL
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.pmcl.render.level_of_detail import simplified
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.simulation.sequence import Sequence

CAMERA = Pinhole(328, 328, 945, 945, 163.5, 163.5)


def subdivided(mesh, times):
    for _ in range(times):
        mesh = mesh.subdivide()
    return mesh


def dented_ball(times=5):
    """20,000 faces, with each time more four times as many, nowhere flat."""
    mesh = trimesh.creation.icosphere(times, 0.04)
    mesh.vertices *= 1 + 0.06 * np.sin(60 * mesh.vertices[:, [1]])
    return mesh


MESHES = {'ball': dented_ball(), 'bracket': subdivided(bracket(), 4), 'cup': subdivided(cup(), 3)}


@pytest.mark.parametrize('name', MESHES)
def test_silhouettes_move_by_less_than_a_third_of_a_pixel(name):
    model = model_of(MESHES[name])
    near = 0.35
    small = simplified(model, 0.25 * (near - 0.06) / 945)
    assert len(small.faces) < 0.5 * len(model.faces)
    assert small.closed == model.closed
    # Five times as fine as the image, so that a third of a pixel is several of these.
    zoom = 5
    camera = Pinhole(1400, 1400, zoom * 945, zoom * 945, 700, 700)
    poses = random_poses(3, 1, depth=(near, near + 0.01), aside=0)
    seen = [NumbaRenderer().depths(Scene(each, camera, Window(0, 0, (1400, 1400)), 0.1, 1),
                                   poses) > 0 for each in (model, small)]
    for full, few in zip(*seen, strict=True):
        assert 0.05 < full.mean() < 1
        for one, other in ((full, few), (few, full)):
            # How far what one alone covers is from what the other does.
            assert distance_transform_edt(~other)[one].max() / zoom < 0.3 + 1 / zoom


@pytest.mark.parametrize('seed', [1, 12])
def test_what_is_followed_is_drawn_neither_smaller_nor_larger(seed):
    """At 0.6 m an outline that is too small by 1e-4 of itself puts the object 0.06 mm nearer."""
    sequence = Sequence(seed)
    camera = sequence.sensor.grid.pinhole
    region = Region(sequence.roi_center, sequence.roi_size)
    small = scene(sequence.model, region, camera, region.window(camera, sequence.model.radius),
                  FINEST_DETAIL).model
    assert len(small.faces) < 0.5 * len(sequence.model.faces)
    fine = camera.resized(4 * camera.width, 4 * camera.height)
    window = Window(0, 0, (fine.width, fine.height))
    poses = sequence.poses[::10].copy()
    poses[:, :2, 3] = 0
    areas = [(NumbaRenderer().depths(Scene(each, fine, window, 0.3, 1), poses) > 0).sum((1, 2))
             for each in (sequence.model, small)]
    assert np.mean(np.sqrt(areas[1] / areas[0])) == pytest.approx(1, abs=1.5e-4)


def test_few_faces_are_left_as_they_are():
    model = model_of(bracket())
    assert simplified(model, 1e-3) is model


def test_a_tolerance_that_allows_nothing_leaves_the_model():
    model = model_of(dented_ball())
    assert simplified(model, 1e-9) is model


def test_it_is_done_once():
    model = model_of(MESHES['bracket'])
    assert simplified(model, 2e-4) is simplified(model, 2e-4)


def test_a_finer_mesh_goes_on_from_what_was_tried_for_a_coarser_one():
    once, again = model_of(dented_ball(6)), model_of(dented_ball(6))
    simplified(again, 5e-5)
    times, found = [], []
    for model in (once, again):
        start = process_time()
        found.append(simplified(model, 4.5e-5))
        times.append(process_time() - start)
    np.testing.assert_array_equal(found[0].vertices, found[1].vertices)
    assert times[1] < 0.75 * times[0]
