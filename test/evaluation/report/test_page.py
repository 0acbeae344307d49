"""The page of a small localisation, read as text and shown by a real browser."""

import math
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from browser import WIDTHS, browser, look
from pmcl_scenes import bracket, model_of
from runs import MODEL, field, run, settings, truth_of

from pmcl_ros.dlv.volume import CameraPose
from pmcl_ros.evaluation.report.evidence_drawings import evidence_classes
from pmcl_ros.evaluation.report.page import page
from pmcl_ros.evaluation.report.posterior import coordinates, tilts
from pmcl_ros.evaluation.report.search_drawings import spread
from pmcl_ros.evaluation.report.slices import outlines
from pmcl_ros.evidence.edges import build_edges
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_view.camera_errors import CameraScale


class Reader(HTMLParser):
    """What a page would load, and the text of every element that has a name."""

    def __init__(self, text):
        super().__init__()
        self.sources, self.texts, self.tags, self._name = [], {}, [], None
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.tags.append(tag)
        self.sources += [values[name] for name in ('src', 'href', 'srcset', 'xlink:href', 'data')
                         if values.get(name)]
        self._name = values.get('id')

    def handle_data(self, data):
        if self._name:
            self.texts.setdefault(self._name, data)


@pytest.fixture(scope='module')
def found():
    return run()


@pytest.fixture(scope='module')
def lost():
    return run(empty=True, source='<script>alert("no cup & no saucer")</script>', truth=False)


def numbers(text):
    return [float(each) for each in re.findall(r'[-+]?\d+\.?\d*', text)]


def check_texts(texts, run):
    """The verdict's numbers against the estimate's."""
    estimate = run.estimate
    assert texts['verdict'] == ('Lost' if estimate.lost else 'Found')
    for k, name in enumerate('xyz'):
        assert numbers(texts[name]) == pytest.approx([1e3 * estimate.pose[k, 3]], abs=0.051)
    assert numbers(texts['axis']) == pytest.approx(estimate.pose[:3, 2], abs=6e-4)
    assert numbers(texts['whole']) == pytest.approx([estimate.evidence], abs=6e-3)
    assert numbers(texts['support']) == pytest.approx([estimate.support], abs=6e-3)
    assert numbers(texts['score']) == pytest.approx([estimate.score], abs=0.51)
    assert numbers(texts['weight']) == pytest.approx([100 * estimate.modes[0].weight], abs=0.51)
    if run.truth is not None:
        error = pose_error(estimate.pose, run.truth.pose, run.model.symmetry)
        assert numbers(texts['error']) == pytest.approx(
            [1e3 * error.translation, math.degrees(error.rotation)], abs=0.051)


def test_a_page_stands_alone_and_says_what_the_estimate_says(found):
    text = page(found)
    reader = Reader(text)
    assert len([each for each in reader.sources if each.startswith('data:image/png')]) > 8
    for each in reader.sources:
        assert each.startswith(('data:', '#'))
    assert not re.search(r'url\((?!#)', text)
    assert '@import' not in text
    assert 'script' not in reader.tags
    assert not found.estimate.lost
    check_texts(reader.texts, found)
    # Links lead to what is there, and each name is that of one element.
    names = re.findall(' id="(.*?)"', text)
    assert len(names) == len(set(names))
    links = {*re.findall(r'url\(#(.*?)\)', text),
             *(each[1:] for each in reader.sources if each.startswith('#'))}
    assert links <= set(names)
    # The drawings' colours are all of the style sheet, which has a dark scheme.
    style, _, body = text.partition('</style>')
    assert not re.search('(stroke|fill): #[0-9a-f]{6}', body)
    assert set(re.findall(r'var\(--([a-z-]+)\)', text)) <= set(re.findall(r'--([a-z-]+):', style))


def test_a_volume_of_posed_views_is_drawn_in_the_frame_of_its_own_camera(found):
    camera = np.array([[0, 0, 1, 0.3], [1, 0, 0, -0.2], [0, 1, 0, 0.1], [0, 0, 0, 1.0]])
    x, y, z = found.settings.roi_size
    chosen = found.settings.model_copy(update={
        'roi_center': tuple(camera[:3, :3] @ found.settings.roi_center + camera[:3, 3]),
        'roi_size': (z, x, y)})
    volume = replace(found.volume, camera=CameraPose('room', camera))
    pose, region = replace(found, volume=volume, settings=chosen,
                           in_reference=found.estimate.in_frame(camera)).before(volume)
    np.testing.assert_allclose(pose, found.estimate.pose, atol=1e-12)
    np.testing.assert_allclose([region.center, region.size],
                               [found.region.center, found.region.size], atol=1e-12)


def test_a_lost_object_is_told_and_names_are_only_names(lost):
    text = page(lost)
    assert lost.estimate.lost
    reader = Reader(text)
    check_texts(reader.texts, lost)
    assert 'script' not in reader.tags
    assert 'error' not in reader.texts
    assert '&lt;script&gt;alert(' in text


def test_views_that_were_not_used_are_named(found):
    assert 'views not used' not in page(found)
    hidden = replace(found, estimate=replace(found.estimate, hidden=(1, 3)))
    assert '1, 3' in page(hidden)[page(hidden).index('views not used'):]


def test_distances_of_the_cameras_are_told_where_it_is_found(found):
    off = CameraScale(-0.021, 0.004)
    text = page(replace(found, estimate=replace(found.estimate, camera_scale=off)))
    assert '-2.1 ± 0.4 %' in text[text.index('camera scale error'):]
    lost = replace(found, estimate=replace(found.estimate, camera_scale=off, lost=True))
    assert 'camera scale error' not in page(found) + page(lost)


def test_numbers_of_other_evidence_are_told(found):
    assert 'numbers of the' not in page(found)
    by_map = page(replace(found, estimate=replace(found.estimate, evidence_of='contour map')))
    begin = by_map.index('numbers of the')
    assert 'contour map' in by_map[begin:begin + 150]


def test_every_mode_of_the_search_and_kind_of_object_has_a_page():
    faithful = run(mode='faithful', faithful_particles=8, faithful_iterations=3)
    assert {each.stage for each in faithful.history} == {'filter'}
    assert 'looks at no contour' in page(faithful)
    odd = run(model=model_of(bracket()))
    reader = Reader(page(odd))
    assert numbers(reader.texts['orientation']) == pytest.approx(odd.estimate.quaternion, abs=1e-4)


def test_the_pose_is_the_same_with_a_history_and_without(found):
    with Localizer(MODEL, settings()) as localizer:
        edges = build_edges(field(), found.volume_settings)
        plain = localizer.localize(edges, np.random.default_rng(0))
    np.testing.assert_array_equal(plain.pose, found.estimate.pose)
    np.testing.assert_array_equal(plain.particles, found.estimate.particles)


def test_a_history_tells_the_stages_in_their_order(found):
    stages = [each.stage for each in found.history]
    order = ['proposals', 'coarse', 'fine', 'ambiguous', 'scattered', 'modes', 'approximate',
             'posterior']
    assert list(dict.fromkeys(stages)) == [each for each in order if each in stages]
    assert {'proposals', 'coarse', 'modes', 'posterior'} <= set(stages)
    times = [each.time for each in found.history]
    assert times == sorted(times)
    assert set(found.seconds) == {'views', 'evidence', 'volume', 'estimate', *stages}
    for each in found.history:
        assert each.poses.shape == (len(each.scores), 4, 4)
    last = found.history[-1]
    assert len(last.poses) == settings().particles
    # Around the estimate, and closer together than the proposals are.
    off = np.linalg.norm(last.poses[:, :3, 3] - found.estimate.pose[:3, 3], axis=1)
    assert np.median(off) < 0.01
    assert spread(last.poses).across < spread(found.history[0].poses).across


def test_spread_tells_the_line_of_sight_from_across():
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (4000, 1, 1))
    ray = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    poses[:, :3, 3] = ray * (0.5 + 0.02 * rng.standard_normal((4000, 1)))
    poses[:, :3, 3] += np.cross(ray, rng.standard_normal((4000, 3))) * 0.003
    assert spread(poses) == pytest.approx((0.003, 0.02), rel=0.06)


def test_the_outline_at_the_truth_lies_on_the_pictures_silhouette(found):
    picture = found.source.picture().astype(float).mean(axis=-1)
    (line,) = outlines(found.source.pinhole, MODEL, truth_of().pose)
    # The cup is brighter than the wall: two pixels outwards it is dark, two inwards bright.
    middle = line.mean(axis=0)
    levels = []
    for off in (2, -2):
        towards = line - middle
        x, y = np.rint(line + off * towards / np.linalg.norm(towards, axis=1, keepdims=True)).T
        levels.append(picture[y.astype(int), x.astype(int)])
    assert levels[0].max() + 20 < levels[1].min()


def test_the_contours_evidence_adds_up_to_the_estimates(found):
    points = found.contour
    assert points.lengths @ points.evidence == pytest.approx(found.estimate.score, rel=0.02)
    kinds = evidence_classes(points)
    for kind, evidence in zip(kinds, points.evidence, strict=True):
        assert kind.endswith('for') == (evidence >= 0)
        assert kind.startswith('rather') == (-1 <= evidence < 1)


def test_coordinates_are_the_covariances_and_the_truths(found):
    values = coordinates(found)
    assert len(values.names) == 5
    np.testing.assert_allclose(values.sigma[:3],
                               1e3 * np.sqrt(np.diag(found.estimate.covariance)[:3]))
    np.testing.assert_allclose(
        values.truth[:3], 1e3 * (found.truth.pose - found.estimate.pose)[:3, 3], atol=1e-9)
    turned = np.linalg.norm(values.truth[3:])
    error = pose_error(found.estimate.pose, found.truth.pose, MODEL.symmetry)
    assert turned == pytest.approx(np.rad2deg(error.rotation), abs=1e-6)
    # Leaning in the image keeps the axis' depth, leaning to the camera lessens it most.
    pose = found.estimate.pose
    spindle = pose[:3, :3] @ MODEL.axis
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    inside, towards = np.cross(tilts(pose, MODEL.axis), spindle)
    assert abs(inside @ ray) < 1e-9
    assert towards @ ray == pytest.approx(-np.sqrt(1 - (spindle @ ray) ** 2))


@pytest.mark.parametrize('dark', [False, True])
def test_a_browser_shows_it_all_on_a_phone_and_on_a_desk(found, tmp_path, dark):
    file = tmp_path / 'page.html'
    text = page(found)
    file.write_text(text, encoding='utf-8')
    seen = look(file, tmp_path, dark)
    assert not seen.console
    assert [each['viewport'] for each in seen.measured] == list(WIDTHS)
    for each in seen.measured:
        assert each['width'] <= each['viewport']
        assert len(each['pictures']) == text.count('<img ')
        assert len(each['drawn']) == text.count('<image ')
        assert min(each['pictures'] + each['drawn']) > 0
        assert not each['loaded']
        assert each['dark'] == dark
        assert (sum(numbers(each['background'])) < 3 * 128) == dark
        check_texts(each['texts'], found)


def test_what_the_browser_would_complain_of_is_noticed(tmp_path):
    browser()
    file = tmp_path / 'page.html'
    file.write_text('<!DOCTYPE html><p style="width: 1300px">wide</p>'
                    '<img src="http://example.org/picture.png"><img src="data:image/png,none">'
                    '<script>console.error("not well")</script>')
    seen = look(file, tmp_path)
    assert any('not well' in line for line in seen.console)
    for each in seen.measured:
        assert each['width'] > each['viewport']
        assert each['pictures'] == [0, 0]
        assert each['loaded'] == ['http://example.org/picture.png']


def took(text):
    """(stage, ms) of each row of the table of the search."""
    table = text[text.index('<section id="search">'):].split('</table>')[0]
    rows = [re.findall(r'<td[^>]*>(.*?)</td>', row) for row in table.split('<tr>')[2:]]
    return [(row[0], float(row[-1])) for row in rows]


def test_a_second_search_has_the_time_that_it_took(found):
    """Stages that come twice have one time in `seconds`, and each a row."""
    ended, later = found.history[-1].time, {}
    again = tuple(replace(each, time=ended + 1 + each.time - found.history[0].time)
                  for each in found.history)
    for each, before in zip(again, (found.history[-1], *again), strict=False):
        later[each.stage] = later.get(each.stage, 0) + each.time - before.time
    seconds = {stage: value + later.get(stage, 0) for stage, value in found.seconds.items()}
    once = took(page(found))
    twice = took(page(replace(found, history=found.history + again, seconds=seconds)))
    count = len(once)
    assert [stage for stage, _ in twice] == 2 * [stage for stage, _ in once]
    for (_, alone), (_, first) in zip(once, twice[:count], strict=True):
        assert first == pytest.approx(alone, abs=1)
    assert twice[count][1] == pytest.approx(1000, abs=1)
    for (_, alone), (_, second) in zip(once[1:], twice[count + 1:], strict=True):
        assert second == pytest.approx(alone, abs=1)


def test_a_search_without_a_history_has_no_table(found):
    assert 'The search kept no history.' in page(replace(found, history=()))
