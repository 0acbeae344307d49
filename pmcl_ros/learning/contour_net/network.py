"""The network of the contour map in Keras, and its loss.

A U-Net that begins at half resolution; its last layer gives four pixels at each place (as Shi et
al., "Real-Time Single Image and Video Super-Resolution Using an Efficient Sub-Pixel CNN", 2016).
It takes a third of the time of one that has layers at full resolution.
"""

from collections.abc import Iterable

import keras
import numpy as np
import tensorflow as tf
from numpy.typing import NDArray

from pmcl_ros.evidence.contour_map import harmonics
from pmcl_ros.learning.contour_net.directions import direction_targets
from pmcl_ros.learning.contour_net.pictures import BINS
from pmcl_ros.learning.contour_net.training_plan import TrainingPlan

POSITIVE_WEIGHT = 20.0  # of contour pixels in the loss; calibration takes it out again
_EVERY = 4  # of the label's 32 directions are in one batch's loss
_CONTOUR_WEIGHT = 2.0  # of the contour's loss beside the inside's
_MOMENTUM = 0.95  # of the means and variances that the network is used with
_RATE = 0.001  # about that of a contour of a direction at a pixel: where training begins


class FusedNormalization(keras.layers.BatchNormalization):  # type: ignore[misc]
    """Keras' batch normalisation by TensorFlow's one operation: a step takes a third less time."""

    def call(self, inputs: tf.Tensor, training: bool = False) -> tf.Tensor:
        """Normalise over (n, h, w), with the batch's moments in training."""
        moments = {} if training else {'mean': tf.convert_to_tensor(self.moving_mean),
                                       'variance': tf.convert_to_tensor(self.moving_variance)}
        out, mean, variance = tf.compat.v1.nn.fused_batch_norm(
            tf.cast(inputs, self.compute_dtype), tf.convert_to_tensor(self.gamma),
            tf.convert_to_tensor(self.beta), epsilon=self.epsilon, is_training=training, **moments)
        if training:
            for moving, value in ((self.moving_mean, mean), (self.moving_variance, variance)):
                moving.assign(self.momentum * moving + (1 - self.momentum) * value)
        return out


def build(channels: tuple[int, ...] = TrainingPlan().channels, dtype: str = 'float32'
          ) -> keras.Model:
    """(n, h, w, 3) to (n, h, w, 6), h and w multiples of 16.

    Channels out: a0, c1, s1, c2, s2 of the contour's logit for a normal of angle t, a0 + c1 cos t
    + s1 sin t + c2 cos 2t + s2 sin 2t; logit of the inside. channels: of the layers at 1/2, 1/4,
    1/8, 1/16 of the resolution. dtype: 'float32', or 'mixed_bfloat16'.
    """
    layers = keras.layers

    def convolved(x: keras.KerasTensor, width: int, kernel: int = 3, stride: int = 1
                  ) -> keras.KerasTensor:
        x = layers.Conv2D(width, kernel, strides=stride, padding='same', use_bias=False,
                          dtype=dtype)(x)
        x = FusedNormalization(momentum=_MOMENTUM, dtype=dtype)(x)
        return layers.ReLU(dtype=dtype)(x)

    picture = keras.Input((None, None, 3))
    x = convolved(convolved(picture, channels[0], kernel=4, stride=2), channels[0])
    skipped = []
    for width in channels[1:]:
        skipped.append(x)
        x = layers.MaxPool2D(dtype=dtype)(x)
        x = convolved(convolved(x, width), width)
    x = convolved(x, channels[-1])
    for skip in reversed(skipped):
        width = skip.shape[-1]
        x = layers.Conv2DTranspose(width, 2, strides=2, dtype=dtype)(x)
        x = convolved(layers.Concatenate(dtype=dtype)([x, skip]), width)
    last = layers.Conv2DTranspose(6, 2, strides=2, dtype='float32')
    network = keras.Model(picture, last(x))
    last.bias.assign([np.log(_RATE * POSITIVE_WEIGHT), 0, 0, 0, 0, 0])
    return network


def normalise(network: keras.Model, batches: Iterable[NDArray[np.float32]]) -> None:
    """Tell the normalisations the statistics of batches of pictures (n, h, w, 3): outputs stay.

    In training, batches are normalised by their own: outputs are about the same then.
    """
    layers = [each for each in network.layers
              if isinstance(each, keras.layers.BatchNormalization)]
    inputs = keras.Model(network.input, [each.input for each in layers])
    moments = [[tf.nn.moments(tf.cast(values, tf.float32), (0, 1, 2))
                for values in inputs(pictures, training=False)] for pictures in batches]
    for layer, each in zip(layers, zip(*moments, strict=True), strict=True):
        means, variances = np.array(each).swapaxes(0, 1)  # of each batch
        mean, variance = means.mean(axis=0), (variances + means.var(axis=0)).mean(axis=0)
        gamma, beta, before, scatter = layer.get_weights()
        scale = gamma / np.sqrt(scatter + layer.epsilon)
        layer.set_weights([scale * np.sqrt(variance + layer.epsilon),
                           beta + (mean - before) * scale, mean, variance])


_TURNS = [_EVERY * np.arange(BINS // _EVERY) + offset for offset in range(_EVERY)]
_BASES = np.stack([harmonics(2 * np.pi * each / BINS).T for each in _TURNS])
_TARGETS = np.stack([direction_targets(each) for each in _TURNS])


@tf.function(jit_compile=True)
def losses(out: tf.Tensor, direction: tf.Tensor, inside: tf.Tensor, offset: tf.Tensor
           ) -> tuple[tf.Tensor, tf.Tensor]:
    """(contour's loss, inside's loss): cross entropies [nat] a pixel, the contour's weighted.

    out: (n, h, w, 6) of the network; direction, inside: labels (n, h, w); offset: 0 to 3. The
    contour's loss is that of 8 directions, which begin at `offset` of 32, added up.
    """
    logits = tf.matmul(out[..., :5], tf.gather(tf.constant(_BASES), offset))
    targets = tf.gather(tf.gather(tf.constant(_TARGETS), offset), tf.cast(direction, tf.int32) + 1)
    contour = tf.nn.weighted_cross_entropy_with_logits(targets, logits, POSITIVE_WEIGHT)
    region = tf.nn.sigmoid_cross_entropy_with_logits(tf.cast(inside, tf.float32), out[..., 5])
    return tf.reduce_mean(tf.reduce_sum(contour, -1)), tf.reduce_mean(region)


def total(contour: tf.Tensor, inside: tf.Tensor) -> tf.Tensor:
    """What training lowers."""
    return _CONTOUR_WEIGHT * contour + inside
