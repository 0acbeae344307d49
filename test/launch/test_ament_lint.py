"""What ROS's own linter says of package.xml; on a full ROS 2 Jazzy with a network."""

from pathlib import Path

import pytest

xmllint = pytest.importorskip(
    'ament_xmllint.main', reason='ament_xmllint is part of a full ROS 2, not on PyPI: '
    'apt-get install ros-jazzy-ament-xmllint')


def test_package_xml_has_the_form_that_its_schema_asks_for():
    assert xmllint.main(argv=[str(Path(__file__).parents[2] / 'package.xml')]) == 0
