"""The lattice as the camera's metadata tell it."""

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.lightfield.calibration.lattice import Lattice


def predicted_lattice(metadata: CameraMetadata) -> Lattice | None:
    """What the camera's metadata say of the lattice (lytro_f01.md, B3); None: nothing.

    Only nearly right in a real camera; the fits do without it.
    """
    mla, sensor = metadata.devices.mla, metadata.devices.sensor
    if mla.lensPitch is None or sensor.pixelPitch is None:
        return None
    exit_pupil, gap = metadata.devices.lens.exitPupilOffset.z, mla.sensorOffset.z
    # Seen from the exit pupil, the lenslets' images on the sensor behind them are farther apart.
    spread = (exit_pupil + gap) / exit_pupil if exit_pupil else 1
    pitch = mla.lensPitch / sensor.pixelPitch * spread
    centre = ((metadata.image.width - 1) / 2 + mla.sensorOffset.x / sensor.pixelPitch,
              (metadata.image.height - 1) / 2 + mla.sensorOffset.y / sensor.pixelPitch)
    return Lattice.make({'pitch_px': pitch * mla.scaleFactor.x,
                         'row_step_px': pitch * mla.scaleFactor.y * 3 ** 0.5 / 2,
                         'rotation': mla.rotation, 'centre_px': centre}, 'metadata')
