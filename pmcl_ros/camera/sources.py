"""The camera that the settings name."""

from pmcl_ros.camera.client import CameraClient
from pmcl_ros.camera.file_camera import FileCamera
from pmcl_ros.camera.gateway.client import GatewayClient
from pmcl_ros.camera.gateway.settings import GatewaySettings
from pmcl_ros.camera.gateway.token import read_token
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.lytro.discovery import find_camera
from pmcl_ros.camera.lytro.settings import LinkSettings
from pmcl_ros.camera.settings import CameraSettings
from pmcl_ros.runtime.errors import SettingsError


def open_camera(settings: CameraSettings) -> CameraClient:
    """Connect to the camera of `settings.source`.

    Raises CameraError when it cannot be reached, SettingsError when its address is none,
    or it cannot do what they ask.
    """
    if settings.delete and settings.source == 'gateway':
        raise SettingsError('a gateway deletes no pictures: set delete to false, and use `pmcl '
                            'camera capture --download all --delete` where the gateway runs')
    if settings.source == 'files':
        return FileCamera(settings.path, settings.loop)
    if settings.source == 'gateway':
        token = read_token(settings.token_file) if settings.token_file else None
        return GatewayClient(settings.gateway, token, GatewaySettings(patience=settings.patience))
    link = LinkSettings(patience=settings.patience, picture_timeout=settings.picture_timeout)
    return LytroClient(find_camera(settings.address), link)
