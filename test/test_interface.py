"""What users rely on stays: commands, options, topics, types, parameters, fields of files.

test/interface.yaml lists it all (`python test/support/interface.py > test/interface.yaml` adds
what is new). An entry leaves the list only with a line under "Removed" in CHANGES.md; what
a release listed is in the list of that release, which nobody edits.
"""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
LISTED = yaml.safe_load((ROOT / 'test' / 'interface.yaml').read_text())
RELEASED = yaml.safe_load((ROOT / 'test' / 'interface-0.1.0.yaml').read_text())


@pytest.fixture(scope='module')
def current():
    pytest.importorskip('rclpy')
    from interface import interface
    return interface()


def removed():
    """The words between backticks under the headings "Removed" of CHANGES.md."""
    changes = (ROOT / 'CHANGES.md').read_text()
    parts = re.findall(r'^### Removed\n(.*?)(?=^##|\Z)', changes, re.MULTILINE | re.DOTALL)
    return set(re.findall(r'`([^`]+)`', '\n'.join(parts)))


def test_the_list_is_that_of_the_code(current):
    assert current == LISTED


def each(entries):
    """The entries, those of a choice {a|b} one by one: a further choice takes none away."""
    found = set()
    for entry in entries:
        choice = re.fullmatch(r'(.*)\{([^}]*)\}(.*)', entry)
        found |= {entry} if choice is None else {
            choice[1] + one + choice[3] for one in choice[2].split('|')}
    return found


def test_what_was_released_is_there_or_said_to_be_removed():
    assert not each(RELEASED) - each(LISTED) - removed()
