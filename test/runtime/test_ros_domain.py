"""Programs that run side by side have a ROS domain each."""

import os
import subprocess
import sys

import pytest

from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.ros_domain import own_domain

HOLD = """
import os
from pmcl_ros.runtime.ros_domain import own_domain
own_domain()
print(os.environ['ROS_DOMAIN_ID'], flush=True)
input()
"""


def test_each_of_several_programs_has_its_own(monkeypatch):
    monkeypatch.delenv('ROS_DOMAIN_ID')
    programs = [subprocess.Popen([sys.executable, '-c', HOLD], stdin=subprocess.PIPE,
                                 stdout=subprocess.PIPE, text=True) for _ in range(3)]
    domains = [int(each.stdout.readline()) for each in programs]
    for each in programs:
        each.communicate('\n')
    assert len(set(domains)) == 3
    assert all(1 <= each <= 101 for each in domains)


def test_what_the_user_chose_stays(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '7')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    own_domain()
    assert os.environ['ROS_DOMAIN_ID'] == '7'
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SUBNET'


def test_it_is_free_again_when_its_owner_has_ended_and_where_all_are_taken_that_is_said():
    program = """
import os
from pmcl_ros.runtime.ros_domain import own_domain
def take():
    os.environ.pop('ROS_DOMAIN_ID', None)
    own_domain()
    return int(os.environ['ROS_DOMAIN_ID'])
child = os.fork()
if not child:
    os._exit(take())
_, status = os.waitpid(child, 0)
assert [os.waitstatus_to_exitcode(status), *(take() for _ in range(101))] == [1, *range(1, 102)]
take()
"""
    alone = ['unshare', '-Urn']  # else other programs would find none meanwhile
    if subprocess.run([*alone, 'true'], capture_output=True, check=False).returncode:
        pytest.skip('no network namespace of its own is allowed here')
    done = subprocess.run([*alone, sys.executable, '-c', program], capture_output=True, text=True,
                          check=False)
    assert done.stderr.splitlines()[-1] == (
        f'{PmclError.__module__}.PmclError: ROS domains 1 to 101 are all taken by programs like '
        'this one: end some, or set ROS_DOMAIN_ID')
