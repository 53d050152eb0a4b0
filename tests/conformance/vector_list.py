# SPDX-License-Identifier: Apache-2.0
"""The list of vectors, and the files from which many of them are derived by one change."""
import struct
from dataclasses import dataclass

from vector_file import File, Meta, Run, Segment
from vector_records import Body, record, text
from vector_scenes import coded_streams, float_streams, own_body

VECTORS = []


@dataclass
class Vector:
    name: str
    clause: str     # tested clause; for an invalid vector the one that refuses it
    about: str
    data: bytes
    limits: dict    # of the reader, if not the default ones
    fails: bool     # a part of the file is refused
    reports: bool   # an error is reported and reading continues
    validator: list  # issues that only a validator reports
    floats: bool    # the manifest states the floats
    found: str      # the clause by which the reference decoder refuses a part, if not `clause`


def vector(name, clause, about, file, limits=None, fails=False, reports=False, validator=(), floats=False,
           clause_of=""):
    data = file if isinstance(file, bytes) else file.bytes()
    VECTORS.append(Vector(name, clause, about, data, limits or {}, fails, reports, list(validator), floats,
                          clause_of or clause))


def must_fail(name, clause, about, file, limits=None, **more):
    vector(name, clause, about, file, limits, fails=True, **more)


def must_report(name, clause, about, file, limits=None, **more):
    vector(name, clause, about, file, limits, reports=True, **more)


def plain(n=3, degree=0, seed=1, **more):
    """Returns a file with one persistent segment of floats."""
    body = more.pop("body", None) or Body(float_streams(n, degree, seed), n)
    floats = all(s.mapping in (0, 8) and s.e == 0 for s in body.streams if s.attribute < 0x8000)
    meta = more.pop("meta", None) or Meta(profile=int(not floats), degree=degree)
    return File([Run([Segment(-1, 0, [body])])], meta, **more)


def coded(n=5, degree=0, seed=2, level=-1, slot=0, **streams):
    return File([Run([Segment(level, slot, [own_body(coded_streams(n, degree, seed, **streams), n)])])],
                Meta(degree=degree))


def changed(attribute, n=3, degree=0, **fields):
    """Returns plain() with changed fields of one stream."""
    streams = float_streams(n, degree, 1)
    for s in streams:
        if s.attribute == attribute:
            for name, value in fields.items():
                setattr(s, name, value)
    return plain(body=own_body(streams, n), degree=degree)


def replaced(*streams, n=3, degree=0, meta=None, degrees=None, **body):
    """Returns plain() with these streams instead of its own."""
    new = {s.attribute: s for s in streams}
    streams = [new.get(s.attribute, s) for s in float_streams(n, degree, 1, degrees=degrees)]
    return plain(body=own_body(streams, n, **body), meta=meta, degree=degree)


def separate_sh(n=3, seed=1, rest=None, degree=1, **more):
    """Returns a persistent segment with SH above degree 0 in a separate record."""
    bodies = [Body(float_streams(n, degree, seed, which="base", **more), n)]
    rest = float_streams(n, degree, seed, which="rest") if rest is None else rest
    return Segment(-1, 0, bodies, [Body(rest, n)])


def further(layer, first, last, kind="audio/opus", data=b"sound", level=-1, slot=0):
    """Returns layer and payload of a private further record (5.7)."""
    return layer, struct.pack("<hHIdd", level, layer, slot, first, last) + text(kind) + data


def private(*names):  # 3.5
    payload = struct.pack("<H", len(names))
    for kind, value, name in names:
        payload += struct.pack("<HH", kind, value) + text(name)
    return record(b"PRIV", payload, 0)


def flipped(data, at, flip=1):
    return data[:at] + bytes([data[at] ^ flip]) + data[at + 1:]
