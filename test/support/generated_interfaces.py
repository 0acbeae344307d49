"""Makes Python modules of ROS message and action definitions, as a build on a full ROS does.

The generators come with the wheels of rclpy; gcc and catkin_pkg are needed beside them. No package
with an action is on PyPI, nor is tf2_msgs.
"""

import subprocess
import sys
import sysconfig
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from shutil import which

import numpy as np
import pytest

PREFIX = Path(sys.prefix)
# The packages whose types the definitions may use.
USES = ('builtin_interfaces', 'std_msgs', 'geometry_msgs', 'shape_msgs', 'service_msgs',
        'unique_identifier_msgs', 'action_msgs')
_LIBRARIES = ('rosidl_generator_c', 'rosidl_generator_py', 'rosidl_typesupport_c',
              'rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c')


@contextmanager
def importable(folder, package, definitions):
    """Inside, this process can import `package`: the installed one, or else one made as below."""
    if find_spec(package) is not None:
        yield
        return
    generate(folder, package, definitions)
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        for name in [each for each in sys.modules if each.partition('.')[0] == package]:
            del sys.modules[name]


def generate(folder, package, definitions):
    """Make the package `folder`/`package`; who imports it needs `folder` on sys.path.

    definitions: texts by file name, as `action/Go.action`. The test is skipped where they cannot
    be compiled.
    """
    if not (which('gcc') and find_spec('catkin_pkg') and find_spec('rosidl_adapter')):
        pytest.skip('generating messages needs gcc, catkin_pkg and the generators of the wheels')
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('AMENT_PREFIX_PATH', str(PREFIX))
        _write_sources(folder / 'made', package, definitions)
    _compile(folder / 'made', folder / package, package)


def _write_sources(made, package, definitions):
    """C and Python, a folder for each generator: some of their files have equal names."""
    from rosidl_adapter.action import convert_action_to_idl
    from rosidl_adapter.msg import convert_msg_to_idl
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_generator_type_description.cli import HashTypeDescription
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    kinds = {'.msg': convert_msg_to_idl, '.action': convert_action_to_idl}
    share = made / 'share' / package
    idl = []
    for name, text in definitions.items():
        path = made / 'source' / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        kinds[path.suffix](made / 'source', package, Path(name), share / path.parent.name)
        idl.append(f'{share}:{Path(name).with_suffix(".idl")}')
    used = [str(PREFIX / 'share' / each) for each in USES]
    hashes = HashTypeDescription('hash').generate_type_hashes(package, idl, used, share)
    GenerateC('c').generate(package, idl, used, made / 'c' / package, hashes)
    both = ['rosidl_typesupport_fastrtps_c', 'rosidl_typesupport_introspection_c']
    for folder, generator in (
            ('fast', GenerateFastRTPSCTypesupport('fast')),
            ('introspection', GenerateIntrospectionCTypesupport('introspection')),
            ('support', GenerateCTypesupport('support', typesupport_implementations=both)),
            ('python', GeneratePython('python',
                                      typesupport_implementations=['rosidl_typesupport_c']))):
        generator.generate(package, idl, used, made / folder / package)


def _compile(made, out, package):
    """Three libraries, which find each other by their folder, and the Python modules."""
    (made / 'python' / package).rename(out)
    (out / '__init__.py').touch()
    include = PREFIX / 'include'
    paths = [made / each for each in ('c', 'fast', 'introspection', 'support')]
    flags = [f'-I{each}' for each in (
        *paths, sysconfig.get_path('include'), np.get_include(), include, *include.iterdir())]
    libraries = [str(path) for use in USES for kind in _LIBRARIES
                 if (path := PREFIX / 'lib' / f'lib{use}__{kind}.so').exists()]
    fast, introspection = (f'lib{package}__rosidl_typesupport_{kind}_c.so'
                           for kind in ('fastrtps', 'introspection'))
    for name, sources, needed in (
            (fast, [made / 'c', made / 'fast'], []),
            (introspection, [made / 'introspection'], [fast]),
            (f'{package}_s__rosidl_typesupport_c.so', [made / 'support', out],
             [fast, introspection])):
        files, parts = (sorted(str(path) for each in sources for path in each.rglob(f'*{end}'))
                        for end in ('.c', '.cpp'))
        if parts:  # one file: the C++ headers take longest
            files.append(str(made / f'{name}.cpp'))
            Path(files[-1]).write_text(''.join(f'#include "{each}"\n' for each in parts))
        subprocess.run(
            ['gcc', '-O0', '-w', '-fPIC', '-shared', *flags, *files, '-o', str(out / name),
             f'-Wl,-soname,{name},-rpath,$ORIGIN,--no-as-needed', f'-L{out}',
             *(f'-l:{each}' for each in needed), *libraries, '-lstdc++'], check=True)
