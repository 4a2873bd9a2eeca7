"""A network as an ONNX file, by hand: fields of protocol buffers, as onnx.proto numbers them."""

import numpy as np


def number(field: int, value: int) -> bytes:
    return varint(field << 3) + varint(value)


def part(field: int, data: bytes | str) -> bytes:
    data = data.encode() if isinstance(data, str) else data
    return varint(field << 3 | 2) + varint(len(data)) + data


def varint(value: int) -> bytes:
    digits = []
    while value > 127:
        digits.append(value & 127 | 128)
        value >>= 7
    return bytes([*digits, value])


def attribute(name: str, value: int | list[int]) -> bytes:
    if isinstance(value, int):
        return part(5, part(1, name) + number(3, value) + number(20, 2))
    return part(5, part(1, name) + b"".join(number(8, each) for each in value) + number(20, 7))


def node(kind: str, inputs: list[str], output: str, **attributes: int | list[int]) -> bytes:
    named = part(4, kind) + part(3, output) + part(2, output)
    listed = b"".join(attribute(name, value) for name, value in attributes.items())
    return part(1, b"".join(part(1, each) for each in inputs) + named + listed)


def tensor(name: str, values: np.ndarray) -> bytes:
    sizes = b"".join(number(1, size) for size in values.shape)
    return part(5, sizes + number(2, 1) + part(8, name) + part(9, values.astype("<f4").tobytes()))


def described(field: int, name: str, shape: tuple[int, ...]) -> bytes:
    sizes = b"".join(part(1, number(1, size)) for size in shape)
    return part(field, part(1, name) + part(2, part(1, number(1, 1) + part(2, sizes))))
