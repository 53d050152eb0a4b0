# SPDX-License-Identifier: Apache-2.0
"""The list of vectors, and the files from which many of them are derived by one change."""
import struct
from dataclasses import dataclass

from vector_file import Body, File, Meta, Part, Segment, record, text
from vector_scenes import coded_streams, float_streams, own_body

VECTORS = []


@dataclass
class Vector:
    name: str
    clause: str     # tested clause; for an invalid vector the one that refuses it
    about: str
    data: bytes
    limits: dict    # of the reader, if not the default ones
    fails: bool
    reported: list  # issues that only a validator reports
    may: bool       # readers may decode the vector, validators must refuse it


def vector(name, clause, about, file, limits=None, fails=False, reported=(),
           may=False):
    data = file if isinstance(file, bytes) else file.bytes()
    VECTORS.append(Vector(name, clause, about, data, limits or {}, fails, list(reported),
                          may))


def must_fail(name, clause, about, file, limits=None, may=False):
    vector(name, clause, about, file, limits, True, may=may)


def plain(n=3, degree=0, seed=1, **more):
    """Returns a file with one persistent segment of floats."""
    body = more.pop("body", None) or Body(float_streams(n, degree, seed), n)
    floats = all(s.mapping == 0 for s in body.streams if s.attribute < 0x8000)
    meta = more.pop("meta", None) or Meta(profile=int(not floats), degree=degree)
    return File([Part([Segment(-1, 0, [body])])], meta, **more)


def coded(n=5, degree=0, seed=2, level=-1, slot=0, **streams):
    return File([Part([Segment(level, slot, [own_body(coded_streams(n, degree, seed, **streams), n)])])],
                Meta(degree=degree))


def changed(attribute, n=3, degree=0, **fields):
    """Returns plain() with changed fields of one stream."""
    streams = float_streams(n, degree, 1)
    for s in streams:
        if s.attribute == attribute:
            for name, value in fields.items():
                setattr(s, name, value)
    return plain(body=Body(streams, n), degree=degree)


def replaced(stream, n=3, meta=None, **body):
    streams = [stream if s.attribute == stream.attribute else s for s in float_streams(n, 0, 1)]
    return plain(body=own_body(streams, n, **body), meta=meta)


def separate_sh(n=3, seed=1, rest=None, **more):
    """Returns a persistent segment of degree 1 with the SH streams `rest` in a separate record."""
    bodies = [Body(float_streams(n, 1, seed, which="base", **more), n)]
    rest = float_streams(n, 1, seed, which="rest") if rest is None else rest
    return Segment(-1, 0, bodies, [Body(rest, n)])


def further_header(layer, level=-1, slot=0):
    """Returns the beginning of the payload of a further record (5.13)."""
    return struct.pack("<hHI", level, layer, slot)


def private(*names):  # 3.5
    payload = struct.pack("<H", len(names))
    for kind, value, name in names:
        payload += struct.pack("<HH", kind, value) + text(name)
    return record(b"PRIV", payload, 0)


def framed(planes, window=None, size=True, dictionary=0, reserved=0):
    """Returns a zstd frame of a raw block, with another header than that of zstd_frame()."""
    head = 0x80 * bool(size) | 0x20 * (window is None) | reserved | bool(dictionary)
    out = struct.pack("<IB", 0xFD2FB528, head)
    out += b"" if window is None else bytes([window])
    out += bytes([dictionary] * bool(dictionary))
    out += struct.pack("<I", len(planes)) if size else b""
    return out + struct.pack("<I", len(planes) << 3 | 1)[:3] + planes


def flipped(data, at, flip=1):
    return data[:at] + bytes([data[at] ^ flip]) + data[at + 1:]
