"""CombinedEvidence: a contour map, by which an object is found, and edges, which place it."""

from dataclasses import dataclass

from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole


@dataclass(frozen=True)
class CombinedEvidence:
    """Both kinds of evidence of one picture.

    The map knows contours of objects from other edges; edges know better where a contour is.
    """

    contour_map: ContourMap
    edges: EdgeVolume

    @property
    def header(self) -> Header:
        """Of the picture."""
        return self.edges.header

    @property
    def pinhole(self) -> Pinhole:
        """Of the pixels of the edges."""
        return self.edges.pinhole
