"""The documents: the site builds strictly, links hold, and every command is described."""

import itertools
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
import yaml

from pmcl_ros.lightfield.posed_view import check_pose

ROOT = Path(__file__).parents[1]
LINK = re.compile(r'\]\(([^)\s]+)\)')
HEADING = re.compile(r'^#+ (.*)$', re.M)


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """The built site; strict: a link, an anchor or a Python object that does not exist fails."""
    folder = tmp_path_factory.mktemp('site')
    built = subprocess.run([sys.executable, '-m', 'mkdocs', 'build', '--strict', '--quiet',
                            '--site-dir', folder], cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


@pytest.mark.parametrize('page', sorted((ROOT / 'docs').rglob('*.md')), ids=lambda each: each.name)
def test_poses_can_be_copied(page):
    """Matrices of the documents are ones that the program takes."""
    for text in re.findall(r'\[(?:-?[\d.]+, ){15}-?[\d.]+\]', page.read_text()):
        check_pose(np.array(yaml.safe_load(text), float).reshape(4, 4), page.name)


class Loaded(HTMLParser):
    """Collects the addresses that a browser loads by itself."""

    def __init__(self):
        super().__init__()
        self.addresses = []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.addresses += [values['src']] if 'src' in values else []
        if tag == 'link' and values.get('rel') == 'stylesheet':
            self.addresses.append(values['href'])


def test_the_site_loads_nothing_from_the_network(site):
    pages = list(site.rglob('*.html'))
    assert len(pages) > 30
    for page in pages:
        loaded = Loaded()
        loaded.feed(page.read_text())
        assert loaded.addresses
        assert not [each for each in loaded.addresses if re.match(r'(https?:)?//', each)], page


def test_the_site_shows_the_python_api(site):
    page = (site / 'reference/api/index.html').read_text()
    assert 'id="pmcl_ros.pmcl.localizer.Localizer.localize"' in page


def anchors(path):
    """Of the headings of a Markdown file, as GitHub and mkdocs name them."""
    headings = HEADING.findall(path.read_text())
    return {re.sub(r'[\s]+', '-', re.sub(r'[^\w\s-]', '', each).strip().lower())
            for each in headings}


@pytest.mark.parametrize('name', ['README.md', 'CHANGES.md'])
def test_links_outside_the_site_hold(name):
    for link in LINK.findall((ROOT / name).read_text()):
        path, _, anchor = link.partition('#')
        assert (ROOT / path).is_file() or (ROOT / path).is_dir(), link
        assert not anchor or anchor in anchors(ROOT / path), link


def test_pages_that_the_code_names_exist():
    folders = ('pmcl_ros', 'test', 'tools', 'config', 'launch', 'examples')
    files = [path for folder in folders for path in (ROOT / folder).rglob('*')
             if path.suffix in ('.py', '.yaml', '.sh', '.rviz', '.xml')]
    named = {(path, page) for path in files
             for page in re.findall(r'\bdocs/[\w./-]+\.(?:md|png)', path.read_text())}
    assert len(named) > 10
    assert not {each for each in named if not (ROOT / each[1]).is_file()}


def test_modules_and_rooms_that_the_documents_name_exist():
    pages = [ROOT / 'README.md', *(ROOT / 'docs').rglob('*.md')]
    named = {(page, name) for page in pages if page.parent.name != 'results'
             for name in re.findall(r'`((?:\w+/)*(?:\w+\.py|\w+/))`', page.read_text())}
    assert len(named) > 20
    assert not {(page.name, name) for page, name in named if not any(
        (folder / name).exists() for folder in (ROOT, ROOT / 'pmcl_ros',
                                                *(ROOT / 'pmcl_ros').iterdir()))}


def test_every_command_is_described():
    text = (ROOT / 'docs/reference/commands.md').read_text()
    entries = [str(each) for each in yaml.safe_load((ROOT / 'test/interface.yaml').read_text())]
    names = {entry.removeprefix('command ').removeprefix('executable ') for entry in entries
             if re.fullmatch(r'command pmcl( [a-z][a-z-]*)+|executable \w+|make [a-z-]+', entry)}
    leaves = {name for name in names if not any(each.startswith(f'{name} ') for each in names)}
    assert len(leaves) > 40
    assert not [name for name in leaves if not re.search(f'`{name}[` ]', text)]


def calls(text):
    """The words of each command in code of a Markdown text: `in a line`, or indented by four."""
    inline = re.findall(r'`([^`]+)`', text)
    blocks = re.findall(r'^    (?:.*\\\n)*.*$', text, re.M)
    for code in [*inline, *blocks]:
        words = code.split('   #')[0].replace('\\\n', ' ').split()
        words = [each.removeprefix('.venv/bin/') for each in words]
        if words and re.fullmatch(r'pmcl|make|pmcl_(bringup|record|replay|soak)', words[0]):
            yield words


PAGES = [ROOT / 'README.md', *(each for each in (ROOT / 'docs').rglob('*.md')
                               if each.parent.name != 'results')]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_commands_and_options_exist(page):
    listed = {str(each).removeprefix('command ').removeprefix('executable ') for each in
              yaml.safe_load((ROOT / 'test/interface.yaml').read_text())}
    for program, *words in calls(page.read_text()):
        own = words[:words.index('--ros-args')] if '--ros-args' in words else words
        names = list(itertools.takewhile(re.compile('[a-z][a-z-]*$').match, own))
        if program == 'make':
            assert {f'make {name}' for name in names[:1]} <= listed, own
            continue
        commands = [program, *(f'{program} {each}' for each in itertools.accumulate(
            names, '{} {}'.format))]
        command = max((each for each in commands if each in listed), key=len)
        assert command != 'pmcl' or not names, own
        for option in own:
            if re.match('--[a-z]|-[a-z]$', option) and option not in ('--help', '-o'):
                assert {f'{command} {option}', f'{program} {option}'} & listed, own


def test_the_readme_is_short():
    assert len((ROOT / 'README.md').read_text().splitlines()) <= 150
