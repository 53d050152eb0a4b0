# SPDX-License-Identifier: Apache-2.0
"""Clause 7.2, coder 0: plain bytes, or one Zstandard frame of them."""
import zstandard

from fields import need


def check_stored(data, size):
    """Refuses `data` that cannot decode to `size` bytes; allocates no memory for these (7.2.2)."""
    if len(data) == size:
        return
    need(data[:4] == b"\x28\xb5\x2f\xfd", "7.2.2", "neither the bytes nor a frame")
    need(len(data) > 4 and data[4] & 12 == 0, "7.2.2", "a reserved bit, or a checksum")
    try:
        frame = zstandard.get_frame_parameters(data)
    except zstandard.ZstdError:
        need(False, "7.2.2", "a truncated frame")
    need(frame.content_size == size and frame.dict_id == 0, "7.2.2",
         "a frame of another size, or with a dictionary")
    need(frame.window_size <= max(8 << 20, frame.content_size), "7.2.2", "too large a window")
    need(frame.content_size <= 32768 * len(data), "7.2.2", "more content than a frame can contain")


def unpack(data, size):
    if len(data) == size:
        return data
    frame = zstandard.ZstdDecompressor().decompressobj()
    try:
        out = frame.decompress(data)
    except zstandard.ZstdError as error:
        need(False, "7.2", f"zstd: {error}")
    need(len(out) == size and frame.eof and not frame.unused_data, "7.2",
         "a frame of another size, or something after it")
    return out
