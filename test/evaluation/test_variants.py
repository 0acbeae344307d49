"""The rows of the tables: how they are named, and what volume each makes."""

import shutil

import numpy as np
import pytest
from pmcl_scenes import cup
from tiny_capture import light_field, pose, write_capture

from pmcl_ros.evaluation.captures import Capture, find_captures, select
from pmcl_ros.evaluation.variants import Variant, sweep
from pmcl_ros.evidence.edges import build_edges
from pmcl_ros.lightfield.posed_view import PosedViews, centre_view
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import SettingsError


@pytest.fixture
def capture(tmp_path):
    return Capture.load(write_capture(tmp_path / 'glass'))


def settings(name, capture, source):
    variant = Variant.parse(name)
    return variant, variant.volume(capture, ObjectModel.load(capture.model), source)


def test_values_go_where_they_belong(capture):
    field = light_field(pose(0), cup())
    variant, volume = settings('particles=7,views=5,truncate=true,edge_labels=9', capture,
                               field)
    search = variant.search(capture)
    assert (search.mode, search.particles, search.roi_size) == ('default', 7, (0.05, 0.05, 0.06))
    assert (volume.views, volume.truncate, volume.edge_labels) == (5, True, 9)
    assert volume.near < 0.4 - 0.03 < 0.4 + 0.03 < volume.far
    variant, volume = settings('row=faithful,faithful_particles=9', capture, field)
    assert (variant.search(capture).mode, variant.search(capture).faithful_particles
            ) == ('faithful', 9)
    assert volume.interpolation == 'phase'


def test_a_sweep_is_a_row_for_each_value():
    rows = sweep('particles=8,16')
    assert [each.name for each in rows] == ['particles=8', 'particles=16']
    assert {each.group for each in rows} == {'particles'}


@pytest.mark.parametrize('text', ['row=map,evidence=map', 'row=edges,evidence=edges',
                                  'row=map-centre,evidence=auto', 'row=default,evidence=edges'])
def test_a_row_may_say_its_evidence(text):
    assert Variant.parse(text).chosen.items() >= {'evidence': text.partition('evidence=')[2]
                                                  .replace('auto', 'map')}.items()


@pytest.mark.parametrize(('text', 'reason'), [
    ('moves=0', 'moves'), ('near=0.2', 'near is no parameter'), ('seed=1', 'seed is no parameter'),
    ('sparkles=3', 'sparkles is no parameter'), ('row=best', "no row 'best'"),
    ('row=map,evidence=edges', 'row=map has evidence map, not edges: leave one of them out'),
    ('evidence=map,row=centre', 'row=centre has evidence edges, not map'),
    ('moves', 'KEY=VALUE'), ('', 'KEY=VALUE'), ('moves=', 'KEY=VALUE'), ('a: {', 'KEY=VALUE')])
def test_what_cannot_be_set_is_told(text, reason):
    with pytest.raises(SettingsError, match=reason):
        Variant.parse(text)


def test_the_centre_view_alone_knows_no_depth(capture):
    """All labels are alike; and no other view has a part in it, whatever it shows."""
    field = light_field(pose(0), cup())
    variant = Variant.parse('row=centre,labels=5,edge_labels=4')
    model = ObjectModel.load(capture.model)
    chosen = variant.volume(capture, model, field)
    edges = variant.build(field, chosen, capture, model)
    assert edges.tensor.max() > 0.5
    for label in range(1, 4):
        np.testing.assert_array_equal(edges.tensor[:, :, label], edges.tensor[:, :, 0])
    other = field.views.copy()
    other[[0, 0, 2], [0, 1, 2]] = 0.5
    again = variant.build(light_field_of(field, other), chosen, capture, model)
    np.testing.assert_array_equal(again.tensor, edges.tensor)
    whole = build_edges(field, chosen)
    assert whole.tensor.shape == edges.tensor.shape
    assert (whole.tensor[:, :, 0] != whole.tensor[:, :, 3]).any()
    assert (whole.depths == edges.depths).all()


def light_field_of(field, views):
    return type(field)(field.header, views, field.grid)


def test_a_crop_is_the_centre_views_too(capture):
    field = light_field(pose(0), cup())
    variant = Variant.parse('row=centre,labels=5,edge_labels=4,crop=[10,20,40,30],stride=2')
    model = ObjectModel.load(capture.model)
    chosen = variant.volume(capture, model, field)
    edges, whole = variant.build(field, chosen, capture, model), build_edges(field, chosen)
    assert edges.tensor.shape == whole.tensor.shape
    assert edges.pinhole == whole.pinhole
    assert len({variant, variant}) == 1


def test_captures_are_found_by_name(tmp_path):
    for name in ('b', 'a'):
        write_capture(tmp_path / name)
    (tmp_path / 'white').mkdir()
    assert [each.name for each in find_captures(tmp_path)] == ['a', 'b']
    assert [each.name for each in select(find_captures(tmp_path), ['b'], tmp_path)] == ['b']
    assert len({each.object for each in find_captures(tmp_path)}) == 1
    second = tmp_path / 'a/1'
    second.mkdir()
    for name in ('model.obj', 'truth.json'):
        shutil.copy(tmp_path / 'b' / name, second)
    targets = find_captures(tmp_path)
    assert [each.name for each in targets] == ['a', 'a/1', 'b']
    assert [each.source.name for each in targets] == ['a', 'a', 'b']
    assert (targets[1].light_field().views == targets[0].light_field().views).all()
    with pytest.raises(SettingsError, match='no capture c; there are a, a/1, b'):
        select(find_captures(tmp_path), ['c'], tmp_path)
    with pytest.raises(SettingsError, match='no subfolder'):
        find_captures(tmp_path / 'white')


def test_what_a_capture_lacks_is_named(tmp_path, caplog):
    for name in ('a', 'b'):
        write_capture(tmp_path / name)
    (tmp_path / 'b/model.obj').rename(tmp_path / 'b/model.stl')
    assert [each.name for each in find_captures(tmp_path)] == ['a']
    assert caplog.messages == [f'{tmp_path}: left out, as no model.obj is beside truth.json: b']
    (tmp_path / 'a/model.obj').unlink()
    (tmp_path / 'b/model.yaml').write_text('mesh: model.stl')
    with pytest.raises(SettingsError, match=r'; no model\.obj is beside truth\.json in a, b$'):
        find_captures(tmp_path)
    for name in ('a', 'b'):
        (tmp_path / name / 'truth.json').unlink()
    with pytest.raises(SettingsError, match=r'; no truth\.json is beside the model in b$'):
        find_captures(tmp_path)


def test_a_row_of_the_map_without_sides_changes_each_view(capture):
    variant, whole = Variant.named('map-no-sides'), Variant.named('map')
    model = ObjectModel.load(capture.model)
    field = light_field(pose(0), cup())
    view = centre_view(field)
    views = PosedViews((view, view))
    settings = variant.volume(capture, model, view)
    of_one, of_views = (variant.build(each, settings, capture, model) for each in (view, views))
    assert (of_one.tensor != whole.build(view, settings, capture, model).tensor).any()
    for each in of_views.views:
        np.testing.assert_array_equal(each.evidence.tensor, of_one.tensor)
