"""`make learned` makes every file of config/learned, by the commands that are told to."""

import re
import shlex
import subprocess
from pathlib import Path

import click
import pytest

from pmcl_ros.cli import main

ROOT = Path(__file__).parents[1]
PAGES = 'contour_map', 'posed_views'  # of results: whole commands of scenes that are learned from
ELSEWHERE = {'out', 'folder', 'pictures', 'jobs', 'force'}  # each has its own


def make(out, *more):
    done = subprocess.run(['make', '-f', 'tools/learned.mk', 'PMCL=pmcl', f'OUT={out}', *more],
                          cwd=ROOT, check=True, capture_output=True, text=True)
    return done.stdout.replace('\\\n', ' ')


def parsed(text):
    """Name and values of a command, without those of folders; click ends where one is wrong."""
    command, words = main, shlex.split(text.partition(' |')[0], comments=True)
    context = click.Context(main)
    name, *words = words
    while isinstance(command, click.Group):
        more, command, words = command.resolve_command(context, words)
        name = f'{name} {more}'
    values = command.make_context(name, list(words)).params
    return name, frozenset((key, value.name if isinstance(value, Path) else value)
                           for key, value in values.items() if key not in ELSEWHERE)


def commands_of(text):
    return [parsed(each) for each in re.findall(r'^pmcl .*$', text, re.MULTILINE)]


def told():
    """The commands in the first lines of config/learned, and of the results."""
    for path in (ROOT / 'config/learned').glob('*.yaml'):
        comment = ''.join(re.findall(r'^# *(.*\n)', path.read_text(), re.MULTILINE))
        yield from re.sub(r'\n(?!pmcl)', ' ', comment).strip().splitlines()
    for page in PAGES:
        text = (ROOT / f'docs/results/{page}.md').read_text()
        yield from re.findall(r'^    (pmcl .* -o out/(?:pictures|map|learn_\w+)\b.*)$', text,
                              re.MULTILINE)


def test_the_recipe_has_the_commands_that_are_told(tmp_path, monkeypatch):
    make(tmp_path, tmp_path / 'camera.yaml')
    recipe = commands_of(make(tmp_path, '-n'))
    monkeypatch.chdir(tmp_path)  # where the camera is
    assert len(recipe) == len(set(recipe))
    assert set(recipe) == {parsed(each) for each in told()}


def test_a_trial_has_as_many_commands(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)  # it begins with the shipped network
    make(tmp_path, tmp_path / 'camera.yaml')
    whole, trial = (commands_of(make(tmp_path, '-n', f'PART={part}')) for part in (1, 1000))
    assert [name for name, _ in trial] == [name for name, _ in whole]
    for (_, less), (_, more) in zip(trial, whole, strict=True):
        assert dict(less).get('count', 0) <= dict(more).get('count', 0)


def test_every_shipped_file_is_a_target(tmp_path):
    shipped = {each.name for each in (ROOT / 'config/learned').iterdir()}
    last = make(tmp_path, '-n').partition('sha256sum ')[2].partition(';')[0]
    assert {Path(each).name for each in last.split()} == shipped


@pytest.mark.parametrize('name', ['contour_map_evidence.yaml', 'views.yaml'])
def test_a_target_asks_for_what_it_reads(tmp_path, name):
    """Searches by the map read its network and the numbers of edges and creases."""
    made = make(tmp_path, '-n', tmp_path / name)
    for each in ('contour.yaml', 'creases.yaml', 'pictures', name):
        assert f' {tmp_path / each} ' in made
