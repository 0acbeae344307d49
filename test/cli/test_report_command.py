"""`pmcl report`, as users call it."""

import json
import re
import shutil
from pathlib import Path

import pytest
import tiny_capture
from command_line import pmcl
from pmcl_scenes import bracket

from pmcl_ros.lightfield.readers.read import read_light_field
from pmcl_ros.messages.bag_captures import capture_messages, read_bag, record_light_field
from pmcl_ros.messages.bags import record

ROOT = Path(__file__).parents[2]


def text_of(page, name):
    return re.search(f'id="{name}">(.*?)<', page).group(1)


@pytest.fixture(scope='module')
def capture(tmp_path_factory):
    return tiny_capture.write_capture(tmp_path_factory.mktemp('report') / 'cup', seed=1)


def test_a_light_field_and_a_bag_of_its_views_have_the_same_pose(capture, tmp_path):
    record_light_field(read_light_field(capture), tmp_path / 'bag')
    pages = []
    for source, more in ((capture, ()), (tmp_path / 'bag', (
            '--object', capture / 'model.obj', '--truth', capture / 'truth.json'))):
        out = tmp_path / f'{len(pages)}.html'
        pmcl('report', source, *more, '-o', out)
        pages.append(out.read_text(encoding='utf-8'))
        assert 'id="error"' in pages[-1]  # the truth of the same object
    done = pmcl(
        'localize', capture, '--object', capture / 'model.obj', '--roi', '0.005', '-0.005', '0.4',
        '0.05', '0.05', '0.06', '--json')
    found = json.loads(next(line for line in done.output.splitlines() if line[:1] == '{'))
    for k, name in enumerate('xyz'):
        ours = [float(text_of(page, name).removesuffix(' mm')) for page in pages]
        assert ours[0] == pytest.approx(1e3 * found['position'][k], abs=0.051)
        assert ours[1] == pytest.approx(ours[0], abs=0.5)  # views of 16 bits


def test_the_truth_of_what_is_there_is_not_that_of_another_object(capture, tmp_path):
    bracket().export(tmp_path / 'bracket.obj')
    out = tmp_path / 'page.html'
    pmcl('report', capture, '--object', tmp_path / 'bracket.obj', '-o', out)
    page = out.read_text(encoding='utf-8')
    assert 'bracket' in page
    assert 'id="verdict"' in page
    assert 'id="error"' not in page


def test_what_is_not_known_is_asked_for(capture, tmp_path):
    alone = tmp_path / 'alone'
    alone.mkdir()
    shutil.copy(capture / 'views.npz', alone)
    done = pmcl('report', alone, status=2)
    assert 'give --roi' in done.output
    shutil.copy(capture / 'truth.json', alone)
    done = pmcl('report', alone, status=2)
    assert 'give --object' in done.output


def test_a_bag_of_something_else_is_refused_in_one_line(capture, tmp_path):
    text, _ = capture_messages(read_bag(ROOT / 'bags' / 'wine_glass'))
    record(tmp_path / 'text', [text])
    done = pmcl('report', tmp_path / 'text', '--object', capture / 'model.obj', '--truth',
                capture / 'truth.json', status=1)
    assert 'text holds neither /image_raw with /metadata nor' in done.output
