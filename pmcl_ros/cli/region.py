"""Options that say where an object is looked for, and how turned."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from typing import Any

import click
import numpy as np

from pmcl_ros.cli.base import STDERR
from pmcl_ros.lightfield.readers.read import Source
from pmcl_ros.pipeline import cameras_of
from pmcl_ros.pmcl.prior.region import with_region
from pmcl_ros.pmcl.settings import WIDEST, PmclSettings

_OPTIONS = (
    click.option('--roi', type=float, nargs=6, metavar='CX CY CZ SX SY SZ',
                 help="Box that holds the object's origin: centre and size, in the camera's "
                 'optical frame, or in the reference frame of posed views [m].'),
    click.option('--depths', type=float, nargs=2, metavar='NEAR FAR', help='In place of --roi: '
                 'all that is in view between two depths; with several views, in all of them '
                 '[m].'),
    click.option('--table', type=float, nargs=6, metavar='X Y Z NX NY NZ', help='In place of '
                 '--roi: what stands on a table in view. Give a point of the table and its '
                 'upward normal, in the frame of --roi [m]. --depths limits it.'),
    click.option('--tilt', type=click.FloatRange(0, 180), nargs=2, metavar='LEAST MOST',
                 help="Possible angles between --up and the object's up: 0 30 for an object that "
                 'stands, 70 110 for one that lies [deg].'),
    click.option('--up', type=float, nargs=3, metavar='X Y Z', help='Direction from which --tilt '
                 'is measured, in the frame of --roi. Default: the normal of --table.'))


@dataclass(frozen=True)
class GivenRegion:
    """The options of a command that say where the object is looked for."""

    roi: tuple[float, ...] | None = None
    depths: tuple[float, ...] | None = None
    table: tuple[float, ...] | None = None
    tilt: tuple[float, ...] | None = None
    up: tuple[float, ...] | None = None

    @property
    def is_placed(self) -> bool:
        """Whether they say where, not only how it is turned."""
        return any(each is not None for each in (self.roi, self.depths, self.table))

    def settings(self) -> dict[str, Any]:
        """Values of `PmclSettings`; UsageError where none or too much is given."""
        if not self.is_placed:
            raise click.UsageError(
                "the region of interest is unknown: give --roi CX CY CZ SX SY SZ, the box that "
                "holds the object's origin, or --depths 0.3 0.9, all that is in view between two "
                'depths, or --table X Y Z NX NY NZ, what stands on a table')
        if self.roi is not None:
            if self.depths is not None or self.table is not None:
                raise click.UsageError('--roi is a box, --depths and --table say it otherwise: '
                                       'give one')
            if max(self.roi[3:]) > WIDEST:
                raise click.UsageError(f'--roi is {max(self.roi[3:]):g} m wide: it is in metres, '
                                       '0.2 for 200 mm')
            if not min(self.roi[3:]) > 0:
                raise click.UsageError(f'--roi is centre and size, not two corners: its size '
                                       f'{self.roi[3:]} must be positive')
            return {'roi_center': self.roi[:3], 'roi_size': self.roi[3:]} | self.orientation
        given = {'roi_depths': self.depths, 'roi_table': self.table}
        return ({name: value for name, value in given.items() if value is not None}
                | self.orientation)

    @property
    def orientation(self) -> dict[str, Any]:
        """Those that say how the object is turned; UsageError where a part of that is missing."""
        if self.tilt is None:
            if self.up is not None:
                raise click.UsageError('--up is what --tilt is to: give --tilt 0 30 for what '
                                       'stands, 70 110 for what lies')
            return {}
        if self.up is None and self.table is None:
            raise click.UsageError('--tilt is an angle to --up X Y Z, or to the normal of '
                                   '--table: give one of them')
        return {'roi_tilt': tuple(np.deg2rad(self.tilt).tolist())} | (
            {} if self.up is None else {'roi_up': self.up})


def region_options(command: Callable[..., None]) -> Callable[..., None]:
    """The options of a command that looks for an object; it gets `region`, a GivenRegion."""
    @wraps(command)
    def with_options(**values: Any) -> None:
        given = {each.name: values.pop(each.name) for each in fields(GivenRegion)}
        command(region=GivenRegion(**given), **values)
    made: Callable[..., None] = with_options
    for option in _OPTIONS:
        made = option(made)
    return made


def settled(settings: PmclSettings, read: Callable[[], Source], radius: float
            ) -> tuple[PmclSettings, Callable[[], Source]]:
    """Settings with a box, and what reads the source: it is read now if the box follows from it.

    The box is printed, for --roi. radius: of the object [m].
    """
    if not settings.region_in_view:
        return settings, read
    source = read()
    settings = with_region(settings, cameras_of(source), radius)
    STDERR.print('region of interest: --roi', *(f'{each:.4g}' for each in (
        *settings.roi_center, *settings.roi_size)), soft_wrap=True, highlight=False)
    return settings, lambda: source
