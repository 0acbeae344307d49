"""Pictures on disk as a camera that takes them one after the other."""

import time
from pathlib import Path

from pmcl_ros.camera.client import CameraStatus, Picture
from pmcl_ros.camera.files import list_pictures, read_metadata, read_picture
from pmcl_ros.runtime.errors import CameraError


class NoMorePictures(CameraError):  # noqa: N818 -- the end of a folder, no failure
    """The last picture has been taken."""


class FileCamera:
    """A `CameraClient` whose card is `path`, a picture or a folder of them.

    loop: begin again after the last. Raises CameraError when there is none.
    """

    def __init__(self, path: Path | str, loop: bool = False) -> None:
        self._folder, self._paths, self._loop = path, list_pictures(path), loop
        self._taken: list[Picture] = []

    def status(self) -> CameraStatus:
        """The serial number of the first picture's camera."""
        return CameraStatus(read_metadata(self._paths[0]).serial, '', None)

    def pictures(self) -> list[Picture]:
        """What has been taken, oldest first."""
        return list(self._taken)

    def capture(self) -> Picture:
        """The next picture's shutter is pressed now; NoMorePictures after the last."""
        count = len(self._taken)
        if count == len(self._paths) and not self._loop:
            raise NoMorePictures(f'all {count} pictures of {self._folder} are published; set loop '
                                 'to begin again')
        path = self._paths[count % len(self._paths)]
        self._taken.append(Picture(f'{count + 1} {path.name}', time.time_ns()))
        return self._taken[-1]

    def fetch(self, picture: Picture) -> tuple[bytes, str]:
        """The .RAW (12 bits, packed) and the .TXT (JSON)."""
        number = int(picture.id.partition(' ')[0]) - 1
        return read_picture(self._paths[number % len(self._paths)])

    def delete(self, picture: Picture) -> None:
        """Nothing: the files stay."""

    def close(self) -> None:
        """Nothing is open."""
