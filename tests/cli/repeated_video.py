# SPDX-License-Identifier: Apache-2.0
"""MP4 files whose table lists one stored frame many times."""
import struct

PARENTS = (b"moov", b"trak", b"mdia", b"minf", b"stbl")
DROPPED = (b"edts", b"ctts", b"stss")  # they describe the frames of the source


def boxes(data):
    while data:
        size, kind = struct.unpack(">I4s", data[:8])
        yield kind, data[8:size]
        data = data[size:]


def box(kind, payload):
    return struct.pack(">I4s", 8 + len(payload), kind) + payload


def table(data, kind):
    for name, payload in boxes(data):
        found = payload if name == kind else table(payload, kind) if name in PARENTS else None
        if found is not None:
            return found
    return None


def with_tables(data, tables):
    out = b""
    for kind, payload in boxes(data):
        if kind not in DROPPED:
            inner = with_tables(payload, tables) if kind in PARENTS else tables.get(kind, payload)
            out += box(kind, inner)
    return out


def repeated_video(source, count, stray=b""):
    """Returns a video of `count` times the first stored frame of the MP4 file `source` (bytes), each
    followed by the bytes `stray`."""
    contents = dict(boxes(source))
    sizes, chunks = table(source, b"stsz"), table(source, b"stco")
    begin = struct.unpack(">I", chunks[8:12])[0]
    size = struct.unpack(">I", sizes[4:8])[0] or struct.unpack(">I", sizes[12:16])[0]
    frame = source[begin:begin + size] + stray
    file = box(b"ftyp", contents[b"ftyp"])
    at = len(file) + 8
    file += box(b"mdat", frame) + box(b"free", bytes(8 * count))  # a file has 8 bytes per frame
    tables = {b"stts": struct.pack(">4I", 0, 1, count, 512),
              b"stsz": struct.pack(">3I", 0, len(frame), count),
              b"stsc": struct.pack(">5I", 0, 1, 1, 1, 1),
              b"stco": struct.pack(">2I", 0, count) + struct.pack(">I", at) * count}
    return file + with_tables(box(b"moov", contents[b"moov"]), tables)
