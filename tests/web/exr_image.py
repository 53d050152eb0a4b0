# SPDX-License-Identifier: Apache-2.0
"""Reads the EXR images that `stgs render` writes, with the standard library alone."""
import math
import struct
import zlib

ROWS_PER_BLOCK = {0: 1, 2: 1, 3: 16}  # by compression: none, ZIPS, ZIP
FORMATS = {1: "e", 2: "f"}


def encoded_of(v):
    """The sRGB encoding of a linear value, extended above 1."""
    return v * 12.92 if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055


def text_at(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode("ascii"), end + 1


def read_header(data):
    at, attributes = 8, {}
    while data[at] != 0:
        name, at = text_at(data, at)
        _, at = text_at(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4:at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def channels_of(attribute):
    at, channels = 0, []
    while attribute[at] != 0:
        name, at = text_at(attribute, at)
        channels.append((name, FORMATS[struct.unpack_from("<i", attribute, at)[0]]))
        at += 16
    return channels


def unpacked(block, size, compression):
    if compression == 0 or len(block) == size:
        return block
    data = bytearray(zlib.decompress(block))
    for i in range(1, size):
        data[i] = (data[i - 1] + data[i] - 128) & 0xFF
    half = (size + 1) // 2
    out = bytearray(size)
    out[0::2], out[1::2] = data[:half], data[half:]
    return bytes(out)


def read_exr(path):
    """Returns width, height and the planes R, G, B (sRGB-encoded) and A, rows from the top."""
    with open(path, "rb") as file:
        data = file.read()
    attributes, at = read_header(data)
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    channels = channels_of(attributes["channels"])
    compression = attributes["compression"][0]
    row_bytes = sum(width * struct.calcsize(f) for _, f in channels)
    rows = ROWS_PER_BLOCK[compression]
    planes = {name: [] for name, _ in channels}
    for offset in struct.unpack_from(f"<{math.ceil(height / rows)}Q", data, at):
        y, size = struct.unpack_from("<ii", data, offset)
        count = min(rows, y1 + 1 - y)
        block = unpacked(data[offset + 8:offset + 8 + size], count * row_bytes, compression)
        at_row = 0
        for _ in range(count):
            for name, letter in channels:
                planes[name] += struct.unpack_from(f"<{width}{letter}", block, at_row)
                at_row += width * struct.calcsize(letter)
    for name in "RGB":
        planes[name] = [encoded_of(v) for v in planes[name]]
    return width, height, planes
