"""Where each of several objects is, and how sure that is."""

from dataclasses import dataclass
from typing import Any

from pmcl_ros.pmcl.estimate import PoseEstimate


@dataclass(frozen=True)
class SceneEstimate:
    """The poses of listed objects that explain one capture jointly.

    names: (n,) distinct; copies of one object are numbered. estimates: (n,) of each; what is not
    there is lost. alone: (n,) what the search for each by itself found, without the others.
    depth: how deep the deepest two that are not lost are in each other [m], 0: none is.
    """

    names: tuple[str, ...]
    estimates: tuple[PoseEstimate, ...]
    alone: tuple[PoseEstimate, ...]
    depth: float

    def as_dict(self) -> dict[str, Any]:
        """The fields of the command line's JSON."""
        return {'objects': {name: each.as_dict() for name, each
                            in zip(self.names, self.estimates, strict=True)},
                'interpenetration': self.depth}

    def describe(self) -> str:
        """A line for each object."""
        return '\n'.join(f'{name}: {each.describe()}' for name, each
                         in zip(self.names, self.estimates, strict=True))
