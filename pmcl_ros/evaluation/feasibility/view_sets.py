"""Which of the pictures of a scene are used together."""

from collections.abc import Callable
from dataclasses import dataclass

from scipy.spatial.distance import pdist

from pmcl_ros.simulation.camera_plan import CameraPlan

Reach = Callable[[tuple[int, ...]], str]  # how far pictures are apart, in words
_WORDS = ('no', 'one', 'two', 'three', 'four', 'five', 'six', 'seven', 'eight', 'nine')


@dataclass(frozen=True)
class ViewSet:
    """Some of the pictures of a scene, by number. name: what they are, in words."""

    name: str
    pictures: tuple[int, ...]

    @property
    def is_one(self) -> bool:
        """Whether it is one picture, or one light field."""
        return len(self.pictures) == 1


def view_sets(plan: CameraPlan | None) -> tuple[ViewSet, ...]:
    """One picture; of a plan: the middle one, two beside each other, the outer two, these and the
    middle one, all of them.
    """
    if plan is None:
        return (ViewSet('one view', (0,)),)
    if plan.arc is not None:
        count, degrees = plan.arc
        step = degrees / max(count - 1, 1)
        return _distinct(count, lambda numbers: f'{step * (numbers[-1] - numbers[0]):.3g} degrees')
    places = plan.fixed[:, :3, 3]
    return _distinct(len(places),
                     lambda numbers: f'{1e3 * pdist(places[list(numbers)]).max():.3g} mm')


def _distinct(pictures: int, reach: Reach) -> tuple[ViewSet, ...]:
    middle, last = pictures // 2, pictures - 1
    wanted = ((middle,), (middle, middle + 1), (0, last), (0, middle, last),
              tuple(range(pictures)))
    sets = dict.fromkeys(numbers for numbers in wanted
                         if numbers[-1] <= last and len(set(numbers)) == len(numbers))
    named: dict[str, ViewSet] = {}  # of sets that people cannot tell apart, the first
    for numbers in sets:
        count = _WORDS[len(numbers)] if len(numbers) < len(_WORDS) else str(len(numbers))
        name = 'one view' if len(numbers) == 1 else f'{count} views over {reach(numbers)}'
        named.setdefault(name, ViewSet(name, numbers))
    return tuple(named.values())
