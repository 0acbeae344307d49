"""Path and options of a command -> RawFrame, LightField, PosedView or PosedViews; bags too."""

import logging
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.lightfield.posed_view import PosedViews, PoseErrors
from pmcl_ros.lightfield.readers.metric import Metric
from pmcl_ros.lightfield.readers.pictures import Reduction
from pmcl_ros.lightfield.readers.read import Source, read_source
from pmcl_ros.messages.bag_captures import read_bag
from pmcl_ros.messages.bag_views import BagViews

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Reading:
    """How a source is read.

    every, shrink, metric, masks: as of `read_source`. bag: how images with poses of a bag become
    views. errors: of the poses of posed views, in place of those that the source states.
    """

    every: int = 1
    shrink: int = 1
    metric: Metric | None = None
    bag: BagViews | None = None
    errors: PoseErrors | None = None
    masks: Path | None = None

    @property
    def reduction(self) -> Reduction:
        """What is left out of pictures."""
        return Reduction(self.every, self.shrink)

    def read(self, path: Path) -> Source:
        """Read what is no bag. Raises as `read_source`."""
        found = read_source(path, self.every, self.shrink, self.metric, self.masks)
        return self.stated(found, path) if isinstance(found, PosedViews) else found

    def read_bag(self, path: Path) -> RawFrame | Source:
        """Read a capture of a bag. Raises BagError."""
        found = read_bag(path, self.bag)
        return self.stated(found, path) if isinstance(found, PosedViews) else found

    def stated(self, read: PosedViews, path: Path) -> PosedViews:
        """Views with the errors; a warning tells which other ones they had."""
        if self.errors is None:
            return read
        found = self.errors.of(read)
        (stated, turned), (given, by) = (np.max([each.sigma for each in views.views], axis=0)
                                         for views in (read, found))
        if (stated or turned) and (stated, turned) != (given, by):
            _LOG.warning('%s: its camera poses count as %.3g mm and %.3g degrees off, in place of '
                         '%.3g mm and %.3g degrees', path, 1e3 * given, np.rad2deg(by),
                         1e3 * stated, np.rad2deg(turned))
        return found
