"""Shared by the commands: one-line errors, kinds of arguments."""

import errno
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

from pmcl_ros.runtime.errors import PmclError, SettingsError, error_line, is_out_of_memory
from pmcl_ros.runtime.imports import imported
from pmcl_ros.runtime.outputs import Results
from pmcl_ros.runtime.resources import calibration_file

if TYPE_CHECKING:
    from rich.progress import Progress

STDERR = Console(stderr=True)


class Needed(click.Path):
    """A file, or a folder too, that must be there; where it is not, the error says how it is made.

    how: to make it, a sentence without its full stop.
    """

    def __init__(self, how: str, folder: bool = False) -> None:
        super().__init__(exists=True, dir_okay=folder, path_type=Path)
        self.how = how

    def convert(self, value: Any, param: click.Parameter | None,
                ctx: click.Context | None) -> Any:
        """The path; BadParameter where there is none."""
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter as error:
            raise click.BadParameter(f'{error.message} {self.how}', ctx, param) from None


FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
OF_CAMERA = ('The white image is a picture of an evenly lit white surface, or the folder of those '
             'of the camera (T1CALIB); pmcl calibrate makes the calibration: docs/howto/camera.md')
OBJECT = Needed('An object is a mesh, or a YAML file that names one: docs/howto/object.md; pmcl '
                'profile measures a vessel that has none')
CAMERA = Needed('A camera is a YAML file with width, height, fx, cx, cy, or the one that '
                'camera_calibration of ROS writes: docs/howto/one_picture.md')
TRUTH = Needed('pmcl scenes render and pmcl simulate make captures with a truth.json: '
               'docs/howto/scenes.md')
_RAW = 'pmcl camera capture takes raw pictures, pmcl bag extract has those of a bag'
RAW, RAW_FOLDER = Needed(_RAW), Needed(_RAW, folder=True)
WHITE = Needed(OF_CAMERA, folder=True)
SOURCE = Needed('Pictures of ordinary cameras have a views.yaml beside them: '
                'docs/howto/one_picture.md; pmcl camera capture takes raw ones', folder=True)
FORCE = click.option('--force', is_flag=True, help='Overwrite files that are there already.')
MODE = click.option(
    '--mode', type=click.Choice(['default', 'faithful']), default='default', show_default=True,
    help="default: search the whole region by the contour. faithful: the paper's particle filter "
    'in its depth likelihood volume; for raw pictures and light fields.')

_PROCESSES = (
    click.option('--jobs', type=click.IntRange(1), default=1, show_default=True,
                 help='Processes; one may use all cores already.'),
    click.option('--backend', type=click.Choice(['loky', 'dask']), default='loky',
                 show_default=True, help='Of joblib: processes of this machine, or a Dask '
                 'cluster.'),
    click.option('--scheduler', metavar='ADDRESS', help='Of the Dask cluster, tcp://HOST:8786. '
                 'Its workers write to the same folder.'))


def process_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of `run_all`: --jobs, --backend, --scheduler (`check_scheduler`)."""
    return with_options(_PROCESSES, command)


def check_scheduler(backend: str, scheduler: str | None) -> None:
    """Raise UsageError for a scheduler that nothing uses."""
    if scheduler and backend != 'dask':
        raise click.UsageError(f'--scheduler {scheduler} is of a Dask cluster: say --backend dask '
                               'too')


def counter() -> 'Progress':
    """A bar that counts what is done, with the time that is left."""
    from rich.progress import MofNCompleteColumn, Progress  # quick commands show none
    *columns, time_left = Progress.get_default_columns()
    return Progress(*columns, MofNCompleteColumn(), time_left, console=STDERR, transient=True)


def results_in(out: Path, force: bool) -> Results:
    """What the command that runs writes into a folder; noted when it ends."""
    context = click.get_current_context()
    return context.with_resource(Results(out, str(context.info_name), force))


def with_options(options: Sequence[Callable[..., Any]], command: Callable[..., Any]
                 ) -> Callable[..., Any]:
    """Add options and arguments to a command, in this order."""
    for option in reversed(options):
        command = option(command)
    return command


def calibration_type(text: str) -> Path:
    """A calibration's file, of its path or the name of its camera; click's kind of an option."""
    try:
        return calibration_file(text)
    except SettingsError as error:
        how = '' if 'pmcl calibrate' in str(error) else f'. {OF_CAMERA}'
        raise click.BadParameter(f'{error}{how}') from None


class Commands(click.Group):
    """Prints errors of the package and the disk as one line; the exit status is 1.

    sections: of the help, each with the module of a command, below pmcl_ros.cli, and one line of
    help. The module is imported when the command is called: most need large libraries.
    """

    def __init__(self, *args: Any, sections: Mapping[str, Mapping[str, tuple[str, str]]],
                 **options: Any) -> None:
        super().__init__(*args, **options)
        self._sections = sections
        self._modules = {name: module for each in sections.values()
                         for name, (module, _) in each.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """All names."""
        return sorted(self._modules)

    def get_command(self, ctx: click.Context, name: str  # noqa: ARG002
                    ) -> click.Command | None:
        """The command of a name, if there is one."""
        if name not in self._modules:
            return None
        module = imported(f'pmcl_ros.cli.{self._modules[name]}')
        command = getattr(module, name.replace('-', '_'))
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context,  # noqa: ARG002
                        formatter: click.HelpFormatter) -> None:
        """The commands by section, without importing any."""
        for section, commands in self._sections.items():
            with formatter.section(section):
                formatter.write_dl([(name, text) for name, (_, text) in commands.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; print errors of the package without a traceback."""
        try:
            return super().invoke(ctx)
        except PmclError as error:
            raise click.ClickException(str(error)) from error
        except OSError as error:  # a folder that cannot be made or written, a full disk
            if error.errno == errno.EPIPE:  # the reader of the output has gone: click ends
                raise
            where = f'{error.filename}: ' if error.filename else ''
            raise click.ClickException(f'{where}{error.strerror or error}') from error
        except Exception as error:
            if not is_out_of_memory(error):
                raise
            raise click.ClickException(error_line(error)) from error
