"""Entry points: each starts its command or node, or says in one message what is not installed."""

import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError
from io import TextIOWrapper

from pmcl_ros.runtime.errors import MissingRosError
from pmcl_ros.runtime.imports import imported
from pmcl_ros.runtime.requirements import described, install_command, lacking

MODULES = {
    'lytro_driver': 'pmcl_ros.nodes.lytro_driver',
    'subaperture_node': 'pmcl_ros.nodes.subaperture_node',
    'dlv_node': 'pmcl_ros.nodes.dlv_node',
    'pmcl_node': 'pmcl_ros.nodes.pmcl_node',
    'sweep_driver': 'pmcl_ros.nodes.sweep_driver',
    'fixed_cameras': 'pmcl_ros.nodes.fixed_cameras',
    'board_node': 'pmcl_ros.nodes.board_node',
    'grasp_node': 'pmcl_ros.nodes.grasp_node',
    'pmcl_bringup': 'pmcl_ros.nodes.bringup',
    'pmcl_record': 'pmcl_ros.nodes.record',
    'pmcl_replay': 'pmcl_ros.nodes.replay',
    'pmcl_soak': 'pmcl_ros.evaluation.bench.soak',
    'pmcl': 'pmcl_ros.cli',
}


def __getattr__(name: str) -> Callable[[], int | None]:
    """The entry point of that name."""
    if name not in MODULES:
        raise AttributeError(name)
    return lambda: start(name)


def start(name: str) -> int | None:
    """Run the `main` of an entry point; what it returns is the exit status.

    It is 130, as shells have it, where Ctrl-C comes before the libraries are imported.
    """
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == 'strict':
        # Names of files that are not UTF-8 are printed as they are, for other commands to find.
        sys.stdout.reconfigure(errors='surrogateescape')
    try:
        return imported(MODULES[name]).main()
    except KeyboardInterrupt:
        return 130
    except MissingRosError as error:
        sys.stderr.write(f'{error}\n')
        return 1
    except ImportError:
        try:
            missing = lacking()
        except PackageNotFoundError:
            missing = []
        if not missing:
            raise
        sys.stderr.write(f'{name}: not installed, or too old: {described(missing)}\n'
                         f'Install them: {install_command(missing)}\n')
        return 1


if __name__ == '__main__':  # with the name of the entry point before its arguments
    if len(sys.argv) < 2 or sys.argv[1] not in MODULES:
        sys.exit(f'expected one of {", ".join(MODULES)}, and then its arguments; given: '
                 f'{" ".join(sys.argv[1:]) or "nothing"}')
    sys.exit(start(sys.argv.pop(1)))
