"""The edge volume as written down: sub-pixel shifts are phases, derivatives factors."""

import cv2
import numpy as np
import scipy.fft

PAD = 24  # px: mirrored border: the transform's period puts one border's content at the other


def edge_volume(field, depths, views):
    """(height, width, labels, 3) tensor of the inner `views` x `views` views, all with light."""
    pinhole, half = field.grid.pinhole, views // 2
    row, column = field.grid.centre
    square = np.s_[row - half:row + half + 1, column - half:column + half + 1]
    pictures = np.clip(field.views[square].astype(float), 0, 1)  # linear light
    pictures = pictures.reshape(-1, *pictures.shape[2:])
    centre = np.clip(field.centre_view.astype(float), 0, 1)
    pictures *= centre.mean() / pictures.mean(axis=(1, 2, 3), keepdims=True)
    padded = np.pad(pictures, ((0, 0), (PAD, PAD), (PAD, PAD), (0, 0)), mode='reflect')
    spectra = scipy.fft.fft2(padded, axes=(1, 2)).transpose(0, 3, 1, 2)
    wy = 2 * np.pi * scipy.fft.fftfreq(padded.shape[1])[:, None]
    wx = 2 * np.pi * scipy.fft.fftfreq(padded.shape[2])
    spectra *= np.exp(-0.5 * 0.8 ** 2 * (wx ** 2 + wy ** 2)) / len(pictures)
    steps = field.grid.positions[square].reshape(-1, 2) * [
        -pinhole.fx * field.grid.baseline, -pinhole.fy * field.grid.baseline]
    tensor = np.empty((pinhole.height, pinhole.width, len(depths), 3))
    for label, depth in enumerate(depths):
        phases = np.exp(1j * (steps[:, 0, None, None] * wx + steps[:, 1, None, None] * wy) / depth)
        refocused = (spectra * phases[:, None]).sum(axis=0)
        gx, gy = (scipy.fft.ifft2(refocused * 1j * each, axes=(1, 2)).real[:, PAD:-PAD, PAD:-PAD]
                  for each in (wx, wy))
        tensor[:, :, label] = np.stack([gx * gx, gy * gy, gx * gy], axis=-1).sum(axis=0)
    energy = tensor[..., 0] + tensor[..., 1]
    around = np.stack([cv2.GaussianBlur(each, (0, 0), 12.0) for each in
                       np.moveaxis(energy, 2, 0)], axis=2)
    return tensor / (around + np.median(energy))[..., None]
