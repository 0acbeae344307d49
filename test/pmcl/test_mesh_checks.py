"""What is told of a mesh when it is loaded can be followed as it is told."""

import subprocess
import sys

import trimesh

from pmcl_ros.pmcl.mesh_checks import check_scan


def test_the_line_that_is_told_simplifies_a_mesh_of_many_faces(tmp_path, caplog):
    mesh = trimesh.creation.icosphere(7, radius=0.05)
    check_scan(mesh, 'ball')
    _, line = caplog.records[0].getMessage().split('python3 ')
    mesh.export(tmp_path / 'mesh.stl')
    subprocess.run(f'{sys.executable} {line}', shell=True, check=True, cwd=tmp_path)
    simple = trimesh.load(tmp_path / 'simple.stl', force='mesh')
    assert len(simple.faces) <= 20_000 < len(mesh.faces)
    assert abs(simple.volume / mesh.volume - 1) < 1e-3
