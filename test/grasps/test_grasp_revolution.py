"""Generated grasps against the true mesh: by rays and surface samples, not by what made them."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pmcl_scenes import model_of

from pmcl_ros.grasps.clearance import Clearance, surface_points
from pmcl_ros.grasps.revolution import Profile, grasps_of
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.runtime.errors import GraspError

NAMES = ['cup', 'bottle', 'goblet', 'lying cup']
FETCH = GripperSettings()


def kinds(grasps):
    return {each.kind for each in grasps}


def touches(mesh, samples, grasp, opening, back=0.0):
    """Whether the gripper, `back` [m] before the grasp, meets the mesh.

    An edge of one of its boxes pierces a face, or a box holds a part of the surface.
    """
    pose = grasp.pose.copy()
    pose[:3, 3] -= back * grasp.approach
    seen = (samples - pose[:3, 3]) @ pose[:3, :3]
    for low, high in FETCH.boxes(opening):
        if ((seen > low) & (seen < high)).all(axis=1).any():
            return True
        box = trimesh.creation.box(bounds=[low, high]).apply_transform(pose)
        ends = box.vertices[box.face_adjacency_edges]
        along = ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(along, axis=1)
        places, rays, _ = mesh.ray.intersects_location(ends[:, 0], along / length[:, None])
        if len(rays) and (np.linalg.norm(places - ends[rays, 0], axis=1) < length[rays]).any():
            return True
    return False


@pytest.mark.parametrize('name', NAMES)
def test_the_open_gripper_is_clear_of_the_mesh_on_its_way(made, vessels, mesh_of, name):
    mesh = mesh_of(vessels[name])
    samples = trimesh.sample.sample_surface(mesh, 20000, seed=1)[0]
    for grasp in made[name]:
        for back in (0.12, 0.05, 0.02, 0.01, 0.0):
            assert not touches(mesh, samples, grasp, grasp.opening, back), (grasp.name, back)


@pytest.mark.parametrize('name', NAMES)
def test_a_gripper_that_is_too_narrow_would_touch(made, vessels, mesh_of, name):
    # the test above can fail
    mesh = mesh_of(vessels[name])
    samples = trimesh.sample.sample_surface(mesh, 20000, seed=1)[0]
    for grasp in made[name]:
        assert touches(mesh, samples, grasp, 0.9 * grasp.width), grasp.name


def travel(mesh, grasp, sign, back=False):
    """(distances [m], normals) at which the pad of one finger meets the mesh when it closes.

    back: at which its back does when it opens.
    """
    x, z = np.meshgrid(np.linspace(FETCH.palm, FETCH.tip, 46),
                       np.linspace(-1, 1, 9) * FETCH.finger_width / 2)
    y = sign * (grasp.opening / 2 + (FETCH.finger_thickness if back else 0))
    pad = np.stack([x.ravel(), np.full(x.size, y), z.ravel()], axis=1)
    starts = pad @ grasp.pose[:3, :3].T + grasp.pose[:3, 3]
    way = np.tile((sign if back else -sign) * grasp.closing, (len(starts), 1))
    places, rays, faces = mesh.ray.intersects_location(starts, way, multiple_hits=False)
    return np.linalg.norm(places - starts[rays], axis=1), mesh.face_normals[faces]


@pytest.mark.parametrize('name', NAMES)
def test_fingers_that_close_touch_the_mesh_and_hold(made, vessels, mesh_of, name):
    mesh = mesh_of(vessels[name])
    for grasp in made[name]:
        gap, ways = grasp.opening, []
        for sign in (1, -1):
            distances, normals = travel(mesh, grasp, sign)
            ways.append(distances.min())
            gap -= distances.min()
            assert distances.min() > FETCH.margin - 3e-4
            # where it touches, the wall faces the finger within the cone of friction
            first = distances < distances.min() + 5e-4
            touched = normals[first]
            if grasp.kind == 'rim':  # a round wall touches both edges of the finger inside it
                touched = touched - np.outer(touched @ grasp.pose[:3, 2], grasp.pose[:3, 2])
                touched /= np.linalg.norm(touched, axis=1, keepdims=True)
            # a facet is up to half a section (3.75 degrees) off its surface
            steepest = np.cos(np.arctan(FETCH.friction) + np.deg2rad(3.75))
            assert (sign * touched @ grasp.closing).max() > steepest, grasp.name
        assert gap == pytest.approx(grasp.width, abs=7e-4), grasp.name
        assert ways[0] == pytest.approx(ways[1], abs=1e-3), grasp.name  # at the same time


@pytest.mark.parametrize('name', ['cup', 'goblet'])
def test_the_finger_inside_a_vessel_has_as_much_room_behind_as_before_it(made, vessels, mesh_of,
                                                                         name):
    mesh = mesh_of(vessels[name])
    grasp, = (each for each in made[name] if each.name == 'rim_top')
    before, behind = (travel(mesh, grasp, -1, back)[0].min() for back in (False, True))
    assert behind == pytest.approx(before, abs=1e-3)


def test_only_grasps_with_the_margin_on_every_side_are_made(vessels, made, rooms):
    least = sorted(each.least for each in rooms)
    margin = (least[0] + least[-1]) / 2
    wide = FETCH.model_copy(update={'margin': margin})
    fitted = [each.name for each in grasps_of(vessels['cup'], wide)]
    assert fitted == [each.name for each, room in zip(made['cup'], rooms, strict=True)
                      if room.least >= margin]
    assert 0 < len(fitted) < len(rooms)


def test_every_kind_is_made_where_the_vessel_allows_it(made):
    assert kinds(made['cup']) == kinds(made['lying cup']) == {'side', 'top', 'rim'}
    assert kinds(made['goblet']) == {'side', 'top', 'rim'}
    assert 'rim' not in kinds(made['bottle'])  # its mesh is solid
    names = [each.name for each in made['goblet']]
    assert len(set(names)) == len(names)
    assert any(each.width < 0.012 for each in made['goblet'] if each.kind == 'side')  # the stem


def test_the_frame_of_a_vessel_is_of_no_matter(made):
    upright = {each.name: each for each in made['cup']}
    lying = {each.name: each for each in made['lying cup']}
    assert upright.keys() == lying.keys()
    for name, grasp in upright.items():
        assert lying[name].width == pytest.approx(grasp.width, abs=2e-4)
        assert lying[name].approach[0] == pytest.approx(grasp.approach[2], abs=1e-9)


def test_grasps_are_frames_and_stand_as_their_kind_says(made):
    for grasp in made['cup']:
        turn = grasp.pose[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1)
        along = abs(grasp.approach[2])
        assert along == pytest.approx(0 if grasp.kind == 'side' else 1, abs=1e-12)
        if grasp.kind == 'side':
            assert turn[2, 2] == pytest.approx(1)  # z of the gripper along the axis: camera up


def test_what_no_gripper_opens_for_gets_no_grasp(vessels):
    small = FETCH.model_copy(update={'opening': 0.02})
    assert grasps_of(vessels['bottle'], small) == ()
    fitted = grasps_of(vessels['goblet'], small)
    assert fitted  # the stem and the rim
    assert all(each.width + 2 * small.margin <= each.opening <= 0.02 for each in fitted)


def test_rotationally_asymmetric_objects_are_refused(vessels):
    with pytest.raises(GraspError, match=r'no surface of revolution.*by hand'):
        grasps_of(replace(vessels['cup'], axis=None), FETCH)


def test_the_profile_is_the_outline(vessels):
    profile = Profile.from_model(vessels['cup'])
    assert (profile.bottom, profile.top) == pytest.approx((0, 0.1))
    inner, outer = profile.crossings(0.05)
    # between two sections of 48 the mesh is 0.2 % nearer to the axis
    assert outer == pytest.approx(0.032, rel=0.003)
    assert inner == pytest.approx(0.027 + 0.004 * 46 / 96, rel=0.003)
    assert len(profile.crossings(0.002)) == 1  # through the bottom
    assert not len(profile.crossings(0.2))
    turned = profile.upside_down()
    assert (turned.bottom, turned.top) == pytest.approx((-0.1, 0))
    np.testing.assert_allclose(turned.crossings(-0.05), [inner, outer])
    np.testing.assert_allclose(turned.at(0.01, 0.02), profile.at(0.01, -0.02))


def test_the_profile_of_a_ball_is_half_a_circle():
    """Of a mesh whose faces lie across the axis."""
    axis = np.array([1, 2, 2]) / 3
    segments = Profile.from_model(model_of(trimesh.creation.icosphere(4, 0.05), axis)).segments
    assert segments[..., 0].min() == 0
    np.testing.assert_allclose(np.hypot(*segments.reshape(-1, 2).T), 0.05, rtol=0.01)
    assert np.ptp(segments[..., 1]) == pytest.approx(0.1, rel=0.01)


def test_shipped_grasps_are_those_that_would_be_made(request):
    from pmcl_ros.grasps.grasp import GraspFile
    folder = request.config.rootpath / 'config' / 'objects'
    files = sorted(folder.glob('*.grasps.yaml'))
    made = [file for file in files if 'Made by: pmcl grasps' in file.read_text()]
    assert len(made) >= 3  # others are by hand
    for file in files:
        model, gripper, grasps = GraspFile.read(file)
        assert gripper == FETCH
        points = surface_points(model)
        for each in grasps:
            assert Clearance.from_points(each, points, gripper).least >= gripper.margin - 1e-5
        if file in made:
            again = grasps_of(model, gripper)
            assert [each.name for each in again] == [each.name for each in grasps]
            for one, other in zip(again, grasps, strict=True):
                np.testing.assert_allclose(one.pose, other.pose, atol=1e-5)
