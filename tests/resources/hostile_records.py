# SPDX-License-Identifier: Apache-2.0
"""Cases of files with many small segment records, which cost more than their bytes. Importing this
adds them to hostile.CASES.
"""
import struct

from hostile import case, constant_streams, finished, index_of, run
from vector_file import Meta
from vector_records import Body, layouts_payload, number, record
from vector_scenes import few_planes, give_tables

TIERS = 256  # of a part


def tiers_of(size, n, payload, *, degree, layouts=None):
    """A file of records with this payload, each one tier of n primitives, which are needed all the time."""
    count = max(1, size // (len(payload) + 32))
    parts = [min(TIERS, count - first) for first in range(0, count, TIERS)]
    body = []
    for tiers in parts:
        body.append(b"".join(record(b"SEGM", payload[:2] + struct.pack("<H", tier) + payload[4:]) for tier in range(tiers)))
    def index(at):
        runs = []
        for p, tiers in enumerate(parts):
            entry = number(0) + number(4 * tiers) + (number(n) + number(len(payload))) * tiers
            runs.append(run(p, at, [entry], chunk=30.0))
            at += len(body[p])
        return index_of(runs, primitives=n * count)
    return finished(index, meta=Meta(profile=1, degree=degree), layouts=layouts, body=b"".join(body))


@case("SEGM", n=(1, 4096), degree=(0, 3))
def small_records(size, n, degree):
    """Records of n equal primitives, by a layout of the head."""
    streams, tables = few_planes(n) if degree == 0 else constant_streams(n, degree, True), []
    give_tables([streams], tables)
    payload = Body(streams, n, layout=0, tables=tables).payload(-1, 0, 0)
    return tiers_of(size, n, payload, degree=degree, layouts=layouts_payload(tables, [streams]))


@case("SEGM", n=(1, 4096), degree=(0, 3), joined=(0, 1))
def small_records_with_tables(size, n, degree, joined):
    """Records of n equal primitives with a layout of their own, and a table of two symbols for each plane."""
    streams, tables = constant_streams(n, degree, joined), []
    for stream in streams:
        stream.tables = []
        for plane in stream.planes():
            symbol = plane[0] if plane else 0
            stream.tables.append(len(tables))
            tables.append({symbol: 4095, (symbol + 1) % 256: 1})
    return tiers_of(size, n, Body(streams, n, tables=tables).payload(-1, 0, 0), degree=degree)
