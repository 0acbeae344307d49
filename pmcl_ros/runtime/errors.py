"""Everything this package raises on purpose.

Messages say what is wrong, with the values, and what to do.
"""

from collections.abc import Iterator
from contextlib import contextmanager

_NO_MEMORY = -4  # cv2.Error.StsNoMem
_LONGEST = 2000  # characters of a message: files and libraries have a say in them


class PmclError(Exception):
    """Root of the package's exceptions; as text one line that is safe to show in a terminal."""

    def __str__(self) -> str:
        return one_line(super().__str__())


def one_line(text: str) -> str:
    """A text without line breaks and control characters, shortened in its middle."""
    text = ' '.join(text.split())
    if len(text) > _LONGEST:
        text = f'{text[:_LONGEST // 2]} ... {text[-_LONGEST // 2:]}'
    return ''.join(each if each.isprintable() else ascii(each)[1:-1] for each in text)


@contextmanager
def told_as(kind: type[Exception], *others: type[PmclError], name: object = '') -> Iterator[None]:
    """Raises errors of the kinds `others`, by default of `kind`, again as `kind`.

    name: what their text then begins with, as that of a file.
    """
    caught = others or (kind,)
    try:
        yield
    except caught as error:
        raise kind(f'{name}: {error}' if name else str(error)) from None


def is_out_of_memory(error: Exception) -> bool:
    """Whether the system gave no more memory, to Python or to OpenCV (cv2.error)."""
    return isinstance(error, MemoryError) or getattr(error, 'code', None) == _NO_MEMORY


def is_foreseen(error: Exception) -> bool:
    """Whether `error_line` says all that a user needs: no traceback is due."""
    return isinstance(error, PmclError) or is_out_of_memory(error)


def error_line(error: Exception) -> str:
    """In one line what is wrong and what to do, also where the system gives no more memory."""
    why = one_line(str(error))
    if isinstance(error, PmclError):
        return why
    return (f'there is not enough memory{f": {why}" if why else ""}; make pixels larger (--shrink '
            '2, shrink: 2), or the region of interest smaller')


class FileError(PmclError):
    """A file is missing, damaged, too large, or of another kind."""



class SettingsError(PmclError):
    """A parameter, a YAML file or a calibration is impossible or incomplete."""


class OutputError(PmclError):
    """A file that would be written is there already, or cannot be written."""


class CameraError(PmclError):
    """A capture or its metadata cannot be read."""


class LinkError(CameraError):
    """The camera cannot be reached, or the connection to it was lost."""


class ProtocolError(LinkError):
    """What came from the camera is not what its protocol allows; the connection is given up."""


class PictureError(PmclError):
    """A picture, or a labelled picture, cannot be used."""


class LightFieldError(PmclError):
    """A light field cannot be made from what was given."""


class CalibrationError(PmclError):
    """A camera's geometry does not follow from the pictures that were given."""


class VolumeError(PmclError):
    """A depth likelihood volume cannot be made from, or is not, what was given."""


class ObjectModelError(PmclError):
    """A mesh or an object description cannot be used."""


class SimulationError(PmclError):
    """A scene cannot be described, or not be rendered."""


class RenderError(PmclError):
    """No OpenGL context, or the renderer refused its work."""


class LocalizationError(PmclError):
    """The pose search was asked for something impossible."""


class ProfileError(PmclError):
    """No profile of an object can be measured in what was given."""


class GraspError(PmclError):
    """No grasp can be made or ranked from what was given."""


class PoseUnavailableError(PmclError):
    """The pose of an arm or a camera is not known at the time of a capture."""


class MissingRosError(PmclError, ImportError):
    """ROS is needed and not installed."""


class MessageError(PmclError):
    """A ROS message does not hold what its topic promises."""


class BagError(PmclError):
    """A bag cannot be written, or is not what was expected."""
