"""Writes a network as an ONNX file that OpenCV's dnn reads, from version 4.6 on.

Batch normalisation is folded into the convolutions. Operators: Conv, Relu, MaxPool,
ConvTranspose, Concat.
"""

from pathlib import Path
from typing import Any

import keras
import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper

_OPSET, _IR = 11, 6
INPUT, OUTPUT = 'picture', 'map'


def write(network: keras.Model, path: Path) -> None:
    """Write a network of `network.build` with float32 weights, (n, 3, h, w) to (n, 6, h, w)."""
    layers = network.layers
    names = {id(network.inputs[0]): INPUT}
    nodes: list[onnx.NodeProto] = []
    weights: list[onnx.TensorProto] = []

    def add(operator: str, layer: keras.Layer, kernel: NDArray[np.floating] | None = None,
            bias: NDArray[np.floating] | None = None, **attributes: Any) -> None:
        sources = layer.input if isinstance(layer.input, list) else [layer.input]
        inputs = [names[id(each)] for each in sources]
        name = OUTPUT if layer is layers[-1] else f'{operator}{len(nodes)}'
        for kind, values in (('kernel', kernel), ('bias', bias)):
            if values is not None:
                array = np.ascontiguousarray(values, np.float32)
                weights.append(onnx.numpy_helper.from_array(array, f'{name}_{kind}'))
                inputs.append(f'{name}_{kind}')
        nodes.append(helper.make_node(operator, inputs, [name], name=name, **attributes))
        names[id(layer.output)] = name

    following = {id(each.input): each for each in layers
                 if isinstance(each, keras.layers.BatchNormalization)}
    for layer in layers:
        match layer:
            case keras.layers.InputLayer():
                pass
            case keras.layers.Conv2D():
                scale, shift = _folded(following[id(layer.output)])
                kernel, stride = np.transpose(layer.kernel.numpy() * scale, (3, 2, 0, 1)), \
                    layer.strides[0]
                before = (kernel.shape[-1] - stride) // 2
                add('Conv', layer, kernel, shift, kernel_shape=kernel.shape[2:],
                    strides=[stride] * 2, pads=[before] * 4)
            case keras.layers.BatchNormalization():  # is in the convolution
                names[id(layer.output)] = names[id(layer.input)]
            case keras.layers.ReLU():
                add('Relu', layer)
            case keras.layers.MaxPooling2D():
                add('MaxPool', layer, kernel_shape=[2, 2], strides=[2, 2])
            case keras.layers.Conv2DTranspose():  # kernel (2, 2, out, in)
                add('ConvTranspose', layer, np.transpose(layer.kernel.numpy(), (3, 2, 0, 1)),
                    layer.bias.numpy(), kernel_shape=[2, 2], strides=[2, 2])
            case keras.layers.Concatenate():
                add('Concat', layer, axis=1)
            case _:
                raise TypeError(f'no ONNX form of {layer}')
    floats = onnx.TensorProto.FLOAT
    graph = helper.make_graph(
        nodes, 'contour_map', initializer=weights,
        inputs=[helper.make_tensor_value_info(INPUT, floats, ['n', 3, 'h', 'w'])],
        outputs=[helper.make_tensor_value_info(OUTPUT, floats, ['n', 6, 'h', 'w'])])
    model = helper.make_model(graph, producer_name='pmcl_ros', ir_version=_IR,
                              opset_imports=[helper.make_opsetid('', _OPSET)])
    onnx.checker.check_model(model)
    path.write_bytes(model.SerializeToString())


def _folded(layer: keras.layers.BatchNormalization
            ) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """(scale, shift) that the normalisation is when it is used: (channels,) each."""
    gamma, beta, mean, variance = (each.numpy().astype(np.float64) for each in (
        layer.gamma, layer.beta, layer.moving_mean, layer.moving_variance))
    scale = gamma / np.sqrt(variance + layer.epsilon)
    return scale, beta - mean * scale
