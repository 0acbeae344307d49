"""EvidenceVolume -> SceneEstimate: several objects in one capture."""

from collections.abc import Sequence

import numpy as np

from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.multi_object.scene_estimate import ListedObjects, SceneEstimate
from pmcl_ros.pmcl.multi_object.scene_search import SceneSearch
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import LocalizationError
from pmcl_ros.runtime.progress import Progress


class SceneLocalizer(Closing):
    """Finds several objects in edge volumes (docs/concepts/several.md).

    Each object is searched for alone. Then the poses are assigned jointly, at most one to each
    listed object. Missing objects are searched for again in the residual edges.
    models: listed; copies are the same ObjectModel. Use and close it in one thread.
    Raises LocalizationError for no or too many objects, or equal names; RenderError when there is
    no GL.
    """

    def __init__(self, models: Sequence[ObjectModel], settings: PmclSettings) -> None:
        self._objects = ListedObjects.from_models(models, settings)
        if settings.evidence == 'map':
            raise LocalizationError('several objects need evidence edges, it is '
                                    f'{settings.evidence}')
        self._settings = settings
        self._least = ContourProfile.learned().least
        self._localizers: list[Localizer] = []
        try:
            for each in self._objects.distinct:
                self._localizers.append(Localizer(each, settings))
        except BaseException:
            self.close()
            raise
        self.renderer = self._localizers[0].renderer

    def close(self) -> None:
        """Release the GL contexts, if there are any."""
        for each in self._localizers:
            each.close()

    def localize(self, edges: EvidenceVolume, rng: np.random.Generator,
                 progress: Progress | None = None) -> SceneEstimate:
        """The poses of the listed objects in one capture.

        progress: called with 0..1; returning False ends the search: what is not found by then is
        lost.
        Raises LocalizationError for edges made of a likelihood, else what `Localizer.localize`
        raises.
        """
        if isinstance(edges, EdgeVolume) and edges.from_likelihood:
            raise LocalizationError('several objects are distinguished by their contours: they '
                                    'need an edge volume (dlv/edges)')
        objects = self._objects
        search = SceneSearch(self._localizers, objects.distinct, objects.interiors,
                             objects.numbers, edges, rng, progress or (lambda _: True),
                             self._least, self._settings.least_support)
        found = search.run()
        # Copies are named from left to right in the image.
        return objects.estimate(found, search.alone, lambda pose: pose[0, 3] / pose[2, 3])
