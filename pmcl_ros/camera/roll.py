"""Which of a camera's pictures are still to be published: none twice, none never."""

from pmcl_ros.camera.client import CameraClient, Picture


class Roll:
    """The pictures that were taken after this was made, by whomever, until they are `done`.

    A picture whose announcement, reply or download was lost is on the camera's card all the same:
    the list of the card is what counts. Raises CameraError as the camera does.
    """

    def __init__(self, camera: CameraClient) -> None:
        self._camera = camera
        self._done = {each.id for each in camera.pictures()}

    def waiting(self) -> list[Picture]:
        """Oldest first."""
        pictures = self._camera.pictures()
        self._done &= {each.id for each in pictures}  # what is deleted need not be remembered
        return [each for each in pictures if each.id not in self._done]

    def done(self, picture: Picture) -> None:
        """It is published, or can never be."""
        self._done.add(picture.id)
