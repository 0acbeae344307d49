"""One way for the data: a light field or a picture in, evidence and a pose out.

A volume is made only where one is asked for.
"""

import logging
import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from pmcl_scenes import CAMERA, cup, model_of
from scipy.spatial.transform import Rotation

from pmcl_ros.cli import main
from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evaluation.captures import find_captures
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.edges import EdgeVolume, build_edges, edge_volume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.lightfield.posed_view import GAMMA, PosedView, PosedViews
from pmcl_ros.pipeline import (
    Pipeline,
    binned_to_draw,
    build_evidence,
    depths_of,
    evidence_kind,
    make_localizer,
    volume_settings,
    windows_of,
)
from pmcl_ros.pmcl.multi_view.region_volume import region_volume
from pmcl_ros.pmcl.render.raster import LARGEST
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError, SettingsError, VolumeError

CUP = model_of(cup(), [0, 0, 1])
FEW = {'labels': 9, 'edge_labels': 5, 'views': 3}
SETTINGS = PmclSettings(roi_center=(0, 0, 0.4), roi_size=(0.1, 0.1, 0.1), renderer='numba',
                        proposals=4, particles=16, moves=1, faithful_particles=8,
                        faithful_iterations=2)


def light_field():
    views = np.random.default_rng(0).random((3, 3, CAMERA.height, CAMERA.width, 3), np.float32)
    grid = ViewGrid(CAMERA, 0.001, nominal_positions(3, 3), np.ones((3, 3), np.float32))
    return LightField(Header(stamp_ns=5), views, grid)


def picture():
    encoded = light_field().centre_view ** np.float32(1 / GAMMA)
    return PosedView(Header(stamp_ns=5, frame_id='wrist'), encoded, CAMERA)


def run(mode, read=light_field, **options):
    stages = []
    settings = SETTINGS.model_copy(update={'mode': mode})
    with Pipeline.for_object(CUP, settings, FEW) as pipeline:
        found = pipeline.run(read, np.random.default_rng(1),
                             lambda stage, _: stages.append(stage), **options)
    return found, list(dict.fromkeys(stages)), settings


@pytest.mark.parametrize(('mode', 'kind'), [('default', EdgeVolume),
                                            ('faithful', DepthLikelihoodVolume)])
def test_the_evidence_is_what_the_mode_reads(mode, kind):
    found, stages, settings = run(mode)
    assert isinstance(found.evidence, kind)
    assert found.volume is (found.evidence if mode == 'faithful' else None)
    assert stages == list(found.seconds) == ['views', 'evidence', 'pose']
    with make_localizer(CUP, settings) as localizer:
        again = localizer.localize(found.evidence, np.random.default_rng(1))
    np.testing.assert_array_equal(again.pose, found.estimate.pose)
    np.testing.assert_array_equal(again.particles, found.estimate.particles)
    assert found.estimate.header.stamp_ns == 5


def test_a_volume_that_is_asked_for_changes_no_pose():
    plain, _, _ = run('default')
    found, stages, _ = run('default', with_volume=True)
    assert stages == list(found.seconds) == ['views', 'evidence', 'volume', 'pose']
    np.testing.assert_array_equal(found.estimate.pose, plain.estimate.pose)
    np.testing.assert_array_equal(found.volume.likelihood,
                                  build_volume(light_field(), found.settings).likelihood)
    np.testing.assert_array_equal(found.evidence.tensor,
                                  build_edges(light_field(), found.settings).tensor)


def test_edges_of_a_light_field_give_its_contour_map_when_they_are_asked():
    found, _, settings = run('default')
    other = found.evidence.other()
    np.testing.assert_array_equal(other.tensor, build_map(light_field(), found.settings).tensor)
    assert evidence_kind(settings, light_field()) == 'auto'
    both, alone = (build_evidence(light_field(), found.settings, 'default', each)
                   for each in ('auto', 'edges'))
    assert isinstance(both.other(), ContourMap)
    assert alone.other is None


def by_edges_and_by_both(folder, seed):
    """Estimates in a generated light field, which has a capture of its own in `folder`."""
    done = CliRunner().invoke(main, ['scenes', 'render', '--preset', 'standard', '--views', '5',
                                     '--samples', '1', '--count', '1', '--seed', str(seed),
                                     '--out', str(folder)])
    assert done.exit_code == 0, done.output
    capture, = find_captures(folder)
    settings = PmclSettings(roi_center=capture.truth.roi_center, roi_size=capture.truth.roi_size)
    model, light_field = capture.load_model(capture.model), capture.read(None)
    found = []
    for kind in ('edges', 'auto'):
        chosen = settings.model_copy(update={'evidence': kind})
        with Pipeline.for_object(model, chosen) as pipeline:
            run = pipeline.run(lambda: light_field, np.random.default_rng(1))
        error = pose_error(run.estimate.pose, capture.truth.pose, model.symmetry)
        found.append((run.estimate, error.right))
    return found


@pytest.mark.parametrize(('seed', 'right_by_edges'), [(650043, False), (676055, True)])
def test_what_edges_lose_in_a_light_field_is_found_by_its_contour_map(tmp_path, seed,
                                                                      right_by_edges):
    (lost, lost_right), (found, found_right) = by_edges_and_by_both(tmp_path, seed)
    assert lost.lost
    assert lost_right == right_by_edges
    assert not found.lost
    assert found_right
    assert (lost.evidence_of, found.evidence_of) == ('', 'contour map')
    assert found.evaluations > lost.evaluations


def test_a_picture_has_the_evidence_of_a_centre_view():
    found, stages, settings = run('default', picture, with_volume=True)
    assert stages == list(found.seconds) == ['views', 'evidence', 'pose']
    assert found.volume is None
    assert (found.source.picture == picture().picture).all()
    assert found.estimate.header == Header(5, 'wrist')
    assert isinstance(found.evidence, ContourMap)
    np.testing.assert_array_equal(found.evidence.tensor,
                                  build_map(picture(), found.settings).tensor)
    edges = build_evidence(picture(), found.settings, 'default', 'edges')
    assert (edges.pinhole, edges.tensor.shape[2]) == (CAMERA, 2)
    np.testing.assert_array_equal(edges.tensor[:, :, 0], edges.tensor[:, :, 1])
    centre = edge_volume(light_field(), edges.depths, views=1)
    np.testing.assert_allclose(edges.tensor, centre.tensor, rtol=1e-3, atol=1e-4)
    assert edges.depths == pytest.approx([found.settings.far, found.settings.near])
    with make_localizer(CUP, settings) as localizer:
        again = localizer.localize(found.evidence, np.random.default_rng(1))
    np.testing.assert_array_equal(again.pose, found.estimate.pose)


def posed_views(places=(0, 0.02, -0.03, 9)):
    views = []
    for seed, x in enumerate(places):
        pose = np.eye(4)
        pose[0, 3] = x
        noise = np.random.default_rng(seed).random((CAMERA.height, CAMERA.width, 3), np.float32)
        views.append(PosedView(Header(5, 'room'), noise, CAMERA, pose))
    return PosedViews(tuple(views))


def test_posed_views_have_a_volume_of_the_region_where_one_is_asked_for():
    with Pipeline.for_object(CUP, SETTINGS, {'stride': 2}, posed=True) as pipeline:
        found = pipeline.run(posed_views, np.random.default_rng(1), with_volume=True)
    assert list(found.seconds) == ['views', 'evidence', 'volume', 'pose']
    settings, volume = found.settings, found.volume
    assert volume.header == Header(5, 'room/view_0')  # the middle one of those that see the region
    assert (settings.near, settings.far) == pytest.approx((0.35 - CUP.radius, 0.45 + CUP.radius))
    assert len(volume.depths) >= 30 * (1 / settings.near - 1 / settings.far) * 1e-3 * CAMERA.fx
    again = build_volume_of_views(posed_views(), settings, 0)
    np.testing.assert_array_equal(volume.likelihood, again.likelihood)
    middle = np.array([0, 0, 0.4])
    assert volume.pinhole.project(middle) == pytest.approx(
        (np.array([volume.pinhole.width, volume.pinhole.height]) - 1) / 2, abs=2)
    alone = posed_views((0, 9))
    seen = build_evidence(alone, found.settings, 'default', 'map')
    assert region_volume(seen, CUP, SETTINGS) is None  # one view alone sees the region


@pytest.mark.parametrize(('changes', 'level'), [(None, logging.INFO),
                                                ({'labels': 9}, logging.WARNING)])
def test_few_labels_are_a_warning_where_the_user_chose_them(caplog, changes, level):
    long = Pinhole(5000, 64, 20000.0, 20000.0, 2499.5, 31.5)
    noise = np.random.default_rng(0).random((64, 5000, 3), np.float32)
    views = PosedViews(tuple(
        replace(each, pinhole=long, picture=noise)
        for each in posed_views((-0.03, 0.03)).views))
    seen = build_evidence(views, DlvSettings(), 'default', 'map')
    with caplog.at_level(logging.INFO):
        region_volume(seen, CUP, SETTINGS, changes)
    told, = (each for each in caplog.records if 'from label to label' in each.message)
    assert told.levelno == level


@pytest.mark.parametrize(('chosen', 'kind'), [('edges', EdgeVolume), ('map', ContourMap)])
@pytest.mark.parametrize('read', [light_field, picture])
def test_the_evidence_may_be_chosen(read, chosen, kind):
    settings = SETTINGS.model_copy(update={'evidence': chosen})
    assert isinstance(build_evidence(read(), DlvSettings(near=0.3, far=0.5, **FEW), 'default',
                                     evidence_kind(settings, read())), kind)


def test_the_papers_filter_needs_a_light_field():
    with pytest.raises(VolumeError, match='the mode faithful needs a light field'):
        run('faithful', picture)


def test_several_objects_are_found_in_one_edge_volume():
    other = replace(model_of(cup().apply_scale(0.6), [0, 0, 1]), name='other')
    with Pipeline.for_objects([CUP, other], SETTINGS, FEW) as pipeline:
        found = pipeline.run(light_field, np.random.default_rng(1))
    depths = depths_of(SETTINGS.roi_center, SETTINGS.roi_size, CUP.radius, posed=False)
    assert (found.settings.near, found.settings.far) == depths  # of the larger object
    assert isinstance(found.evidence, EdgeVolume)
    assert len(found.estimate.estimates) == 2


def test_settings_reach_around_the_region_with_labels_as_close_as_views_need():
    grid = light_field().grid
    plain = volume_settings('default', 0.3, 0.5, grid)
    assert (plain.near, plain.far, plain.labels, plain.edge_labels) == (0.3, 0.5, 75, 24)
    assert (plain.interpolation, plain.truncate, plain.view_weights) == ('neutral', False, 'light')
    paper = volume_settings('faithful', 0.3, 0.5, grid)
    assert (paper.interpolation, paper.truncate, paper.view_weights) == ('phase', True, 'equal')
    wide = ViewGrid(CAMERA, 0.05, grid.positions, grid.weights)
    assert volume_settings('default', 0.3, 0.5, wide).edge_labels > 24
    # A region may come nearer than labels do, and go farther.
    all_there_is = volume_settings('default', 0.002, 2000, None)
    assert (all_there_is.near, all_there_is.far) == (0.01, 1000)
    assert volume_settings('default', 0.3, 0.5, grid, {'window': 7}).window == 7
    assert volume_settings('default', 0.3, 0.5, None, {'crop': (1, 2, 3, 4)}).crop == (1, 2, 3, 4)
    with pytest.raises(SettingsError, match='--set'):
        volume_settings('default', 0.3, 0.5, grid, {'window': 4}, '--set')


def test_a_large_picture_is_searched_as_one_with_larger_pixels():
    small = Pinhole(1250, 900, 900.0, 900.0, 624.5, 449.5)
    values = np.random.default_rng(3).random((900, 1250, 3), np.float32)
    alike = PosedView(Header(stamp_ns=5), values, small)
    large = PosedView(Header(stamp_ns=5), values.repeat(2, axis=0).repeat(2, axis=1),
                      small.resized(2500, 1800))
    expected, (found, _, _) = run('default', lambda: alike)[0], run('default', lambda: large)
    assert found.source.pinhole == found.evidence.pinhole == small
    np.testing.assert_array_equal(found.evidence.tensor, expected.evidence.tensor)
    np.testing.assert_array_equal(found.estimate.pose, expected.estimate.pose)


def test_a_window_that_is_too_large_to_draw_has_larger_pixels():
    full_hd = Pinhole(1920, 1080, 1800.0, 1800.0, 959.5, 539.5)
    aside = np.eye(4)
    aside[0, 3] = 9.0  # it sees nothing of the region
    large, other, small = (
        PosedView(Header(), np.zeros((camera.height, camera.width, 3), np.float32), camera, pose)
        for camera, pose in ((full_hd, np.eye(4)), (full_hd, aside), (CAMERA, np.eye(4))))
    views, settings = PosedViews((large, other, small)), DlvSettings()
    wide = SETTINGS.model_copy(update={'roi_size': (0.4, 0.2, 0.1)})
    found = binned_to_draw(views, settings, wide, CUP.radius)
    assert found.views[0].pinhole == full_hd.resized(960, 540)
    assert found.views[1] is other
    assert found.views[2] is small
    assert max(windows_of(found, wide, CUP.radius)[0].size) <= LARGEST
    assert binned_to_draw(large, settings, wide, CUP.radius).pinhole == found.views[0].pinhole
    # Of a smaller region all pixels are used.
    assert binned_to_draw(views, settings, SETTINGS, CUP.radius).views == views.views
    crop = settings.model_copy(update={'crop': (0, 0, 640, 480)})
    assert binned_to_draw(large, crop, wide, CUP.radius) is large


@pytest.mark.parametrize(('read', 'told'), [
    (light_field, 'is outside the image'), (picture, 'is outside the image'),
    (lambda: PosedViews((picture(), picture())), 'none of the 2 views sees the region')],
    ids=['light field', 'picture', 'posed views'])
def test_a_region_that_is_out_of_view_is_told_before_evidence_is_made(read, told):
    stages = []
    settings = SETTINGS.model_copy(update={'roi_center': (5.0, 0, 0.4)})
    with Pipeline.for_object(CUP, settings, FEW,
                             posed=isinstance(read(), PosedViews)) as pipeline, pytest.raises(
                                 LocalizationError, match=told):
        pipeline.run(read, np.random.default_rng(1), lambda stage, _: stages.append(stage))
    assert stages == ['views']


def test_poses_that_seem_mistaken_are_refused_before_evidence_is_made():
    def read():
        turns = Rotation.from_euler('y', np.linspace(0, 45, 4)[:, None], degrees=True)
        opengl = (pose_of(turn, SETTINGS.roi_center - turn.apply(SETTINGS.roi_center))
                  @ np.diag([1.0, -1, -1, 1]) for turn in turns)
        return PosedViews((picture(), *(replace(picture(), camera_to_reference=each)
                                        for each in opengl)))

    stages = []
    with Pipeline.for_object(CUP, SETTINGS, FEW, posed=True) as pipeline, pytest.raises(
            LocalizationError, match=r'^1 of 5 views see .* \(OpenGL, Blender\)'):
        pipeline.run(read, np.random.default_rng(1), lambda stage, _: stages.append(stage))
    assert stages == ['views']


def test_poses_in_millimetres_are_refused_though_all_views_see_the_region():
    """Of cameras that look at the origin."""
    settings = SETTINGS.model_copy(update={'roi_center': (0.0, 0.0, 0.0)})
    cameras = [pose_of(turn, turn.apply([0, 0, -400])) for turn in Rotation.from_euler(
        'y', [[0], [20], [40]], degrees=True)]
    views = PosedViews(tuple(replace(picture(), camera_to_reference=each) for each in cameras))
    with pytest.raises(LocalizationError, match=r'0\.\d+ px .* are the poses in millimetres'):
        windows_of(views, settings, CUP.radius)
    right = tuple(replace(each, camera_to_reference=pose_of(
        Rotation.from_matrix(each.camera_to_reference[:3, :3]),
        each.camera_to_reference[:3, 3] / 1000)) for each in views.views)
    assert set(windows_of(PosedViews(right), settings, CUP.radius)) == {0, 1, 2}


@pytest.mark.parametrize('kind', ['edges', 'map', 'auto'])
def test_a_covered_lens_is_told(caplog, kind):
    given = light_field()
    settings = DlvSettings(near=0.3, far=0.5, labels=9, edge_labels=5, views=3)
    columns = np.arange(CAMERA.width, dtype=np.float32)[:, None] / CAMERA.width
    for views, dark in ((np.zeros_like(given.views), True),
                        (np.broadcast_to(columns, given.views.shape).copy(), False)):
        caplog.clear()
        build_evidence(LightField(given.header, views, given.grid), settings, 'default', kind)
        assert ('a picture is of one colour: is the lens covered' in caplog.text) == dark


@pytest.mark.parametrize(('light', 'fault'), [
    (1.0, None), (100.0, 'are white: expose it less'),
    (1e-3, r'are below \d % of white: expose it more')])
def test_an_unusable_picture_is_told_where_the_object_is_lost(caplog, light, fault):
    given = picture()
    encoded = (light * given.linear()).clip(0, 1) ** np.float32(1 / GAMMA)
    found, _, _ = run('default', lambda: replace(given, picture=encoded))
    assert found.estimate.lost
    lines = [each for each in caplog.messages if 'that can show the object' in each]
    assert len(lines) == (fault is not None)
    assert all(re.fullmatch(f'lost, and \\d+ % of the pixels of the picture that can show the '
                            f'object {fault}', each) for each in lines)
