"""Which of a camera's pictures are still to be published: none twice, none never."""

from collections import Counter

from pmcl_ros.camera.client import CameraClient, Picture

_TRIES = 3  # another client that uses the camera spoils a download, but not for ever


class Roll:
    """The pictures that were taken after this was made, by whomever, until they are `done`.

    A picture whose announcement, reply or download was lost is on the camera's card all the same:
    the list of the card is what counts. Raises CameraError as the camera does.
    """

    def __init__(self, camera: CameraClient) -> None:
        self._camera = camera
        self._done = {each.id for each in camera.pictures()}
        self._failed: Counter[str] = Counter()

    def waiting(self) -> list[Picture]:
        """Oldest first."""
        pictures = self._camera.pictures()
        ids = {each.id for each in pictures}
        self._done &= ids  # what is deleted need not be remembered
        for each in self._failed.keys() - ids:
            del self._failed[each]
        return [each for each in pictures if each.id not in self._done]

    def done(self, picture: Picture) -> None:
        """It is published, or can never be."""
        self._done.add(picture.id)
        del self._failed[picture.id]

    def failed(self, picture: Picture) -> bool:
        """It came, but is no picture; whether that was so often that it counts as done."""
        self._failed[picture.id] += 1
        if self._failed[picture.id] < _TRIES:
            return False
        self.done(picture)
        return True
