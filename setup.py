from itertools import groupby
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'pmcl_ros'
ROOT = Path(__file__).parent


def data_files():
    """Every file of the folders that a user needs at run time, and what ament looks for."""
    files = sorted(path.relative_to(ROOT) for folder in ('config', 'examples', 'launch', 'models')
                   for path in (ROOT / folder).rglob('*')
                   if path.is_file() and '__pycache__' not in path.parts)
    shared = [(f'share/{NAME}/{folder}', [str(path) for path in paths])
              for folder, paths in groupby(files, lambda path: path.parent)]
    return [('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
            (f'share/{NAME}', ['package.xml']), *shared]


def requirements(name):
    """The packages that a requirements file lists."""
    lines = (ROOT / name).read_text().splitlines()
    return [line for line in lines if line and not line.startswith('#')]


setup(
    name=NAME,
    version='0.1.0',
    description='Plenoptic Monte Carlo Object Localization with a light-field camera',
    license='Apache-2.0',
    maintainer='pmcl_ros maintainers',
    maintainer_email='maintainers@pmcl-ros.org',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={f'{NAME}.evaluation.report': ['*.html', 'page.css'],
                  f'{NAME}.evaluation.feasibility': ['feasibility.html'],
                  f'{NAME}.evaluation.manipulation': ['manipulation.html']},
    data_files=data_files(),
    python_requires='>=3.10',
    # The ROS wheels are an extra: they must not be pulled into a machine that has /opt/ros.
    install_requires=requirements('requirements.txt'),
    extras_require={'ros': requirements('requirements-ros.txt'),
                    'learn': requirements('requirements-learn.txt'),
                    'simulate': requirements('requirements-simulate.txt'),
                    'manipulate': requirements('requirements-manipulate.txt')},
    zip_safe=True,
    entry_points={'console_scripts': [f'{name} = {NAME}.runtime.start:{name}' for name in (
        'lytro_driver', 'subaperture_node', 'dlv_node', 'pmcl_node', 'sweep_driver', 'grasp_node',
        'fixed_cameras', 'board_node', 'pmcl_bringup', 'pmcl_record', 'pmcl_replay', 'pmcl_soak',
        'pmcl')]},
)
