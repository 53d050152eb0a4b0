# SPDX-License-Identifier: Apache-2.0
"""Clause 6.5: SEGM records, and further records (5.7)."""
import struct

from fields import RECORD, Fields, Refused, check_available, check_payload, need, need_memory, record_header
from layouts import MORTON, RANS, SH, SH_DEGREE, check_attributes, check_profile, read_own
from rans import decode_group
from streams import check_finite, check_values, integers, predicted, values


class Memory:  # conformance.md 1.5
    def __init__(self, limit):
        self.left = limit

    def take(self, count):
        need(count <= self.left, "conformance 1.5", 308, "a segment that exceeds the memory limit")
        self.left -= count


def decode_tier(file, run, segment, tier):
    """Returns {attribute: Integers} of a tier, and the error that refuses its SH above degree 0, or
    None (10.1)."""
    base, apart = segment.tiers[tier], segment.sh != []
    need(file.meta.degree > 0 or not apart, "5.5", 402, "SH of degree 0 in a record of its own")
    check_available(file.data, base.offset, base.bytes)
    memory = Memory(file.limits.max_memory)
    memory.take(4 * (17 + 3 * (file.meta.degree + 1) ** 2) * base.n)
    out = decode_record(file, run, segment, base, apart, memory)
    if not apart:
        return out, None
    try:
        return {**out, **decode_record(file, run, segment, segment.sh[tier], apart, memory)}, None
    except Refused as error:
        return out, error


def open_record(file, segment, record):
    """Returns the payload of a SEGM record (6.5)."""
    tag, flags, length, _ = record_header(file.data, record.offset, record.offset + RECORD + record.bytes)
    need(tag == b"SEGM" and length == record.bytes, "5.3", 400, f"record {tag} of {length} bytes")
    need(flags & 1 == 1, "3.3", 116, "SEGM is not marked critical")
    need(flags == 1, "3.4", 113, f"SEGM with flags {flags:#x}")
    f = Fields(check_payload(file.data, record.offset), "6.5", 401)
    stated = f.i16(), f.u16(), f.u32()
    need(stated == (segment.level, record.layer, segment.slot), "6.5", 400, f"the record states {stated}")
    return f


def decode_record(file, run, segment, record, apart, memory):
    check_available(file.data, record.offset, record.bytes)
    memory.take(RECORD + record.bytes)
    f = open_record(file, segment, record)
    n = f.u32()
    need(n == record.n, "6.5", 400, f"the record states {n} primitives")
    layout, tables = record_layout(file, f, memory)
    check_attributes(layout, record.layer // 256, apart, file.meta.degree)
    check_profile(layout, file.meta.profile)
    counts = [n]
    if any(r.attribute == SH_DEGREE for r in layout):
        counts += [f.u32() for _ in range(file.meta.degree)]
    need(all(a >= b for a, b in zip(counts, counts[1:])), "6.5", 401, f"primitives of each degree: {counts}")
    first_key = f.u32() if any(r.prediction == MORTON and not r.optional() for r in layout) else None
    units = units_of(layout)
    sizes = [f.u32() for _ in units]
    stored = [f.bytes(size) for size in sizes]
    check_units(units, stored, tables, counts, memory)
    planes = {}
    for rows, data in zip(units, stored):
        planes.update(unit_planes(rows, data, tables, counts))
    return decode_streams(file, run, segment, planes, layout, counts, first_key)


def record_layout(file, f, memory):
    number = f.u16()
    if number == 65535:
        layout, tables = read_own(f, memory.left)
        memory.take(16384 * len(tables))
        return layout, tables
    need(number < len(file.layouts.layouts), "6.5", 409, f"layout {number} does not exist")
    layout = file.layouts.layouts[number]
    if isinstance(layout, Refused):
        raise layout
    return layout, file.layouts.tables


def units_of(layout):
    """Returns the rows of each unit (6.5)."""
    units = []
    for row in layout:
        if row.joins:
            units[-1].append(row)
        else:
            units.append([row])
    return units


def count_of(row, counts):
    """Returns the symbols of each plane of a stream (6.3)."""
    return counts[SH.index(row.attribute)] if row.attribute in SH else counts[0]


def check_units(units, stored, tables, counts, memory):
    """Checks sizes before memory is needed for planes (12.1, conformance.md 1.5)."""
    required = [(rows, data) for rows, data in zip(units, stored) if not rows[0].optional()]
    for rows, _ in required:
        for row in rows:
            planes = row.planes() if row.coder != RANS else sum(tables[t].only is None for t in row.tables)
            memory.take(planes * count_of(row, counts))
    for (row, *_), data in required:
        need(row.coder == RANS or len(data) == row.planes() * count_of(row, counts), "6.4", 405,
             f"{len(data)} bytes of planes")


def unit_planes(rows, data, tables, counts):
    """Returns {attribute: planes} of a unit."""
    if rows[0].optional():  # skipped (6.2)
        return {}
    n = count_of(rows[0], counts)
    if rows[0].coder != RANS:
        return {rows[0].attribute: [data[n * p:n * (p + 1)] for p in range(rows[0].planes())]}
    coded = [tables[t] for row in rows for t in row.tables if tables[t].only is None]
    group = iter(decode_group(data, n, coded))
    return {row.attribute: [next(group) if tables[t].only is None else bytes([tables[t].only]) * n
                            for t in row.tables] for row in rows}


def decode_streams(file, run, segment, planes, layout, counts, first_key):  # 8
    out = {}
    for row in layout:
        if row.optional():
            continue
        q = predicted(row, values(row, planes[row.attribute], count_of(row, counts)), first_key)
        out[row.attribute] = integers(row, q, out, segment, run, file.meta.degree)
    if SH_DEGREE in out:
        degrees = out[SH_DEGREE].q[0]
        for k in range(1, file.meta.degree + 1):
            need(sum(d >= k for d in degrees) == counts[k], "6.3", 407, f"primitives of degree {k} or more")
    check_finite(out)
    for attribute, stream in out.items():
        check_values(attribute, stream)
    return out


def read_further(file, segment, record):
    """Returns begin, end, type and bytes of a private further record (5.7)."""
    check_available(file.data, record.offset, record.bytes)
    need_memory(record.bytes, file.limits.max_memory, f"a further record of {record.bytes} bytes")
    f = open_record(file, segment, record)
    f.clause, f.issue = "5.7", 315
    begin, end, kind = f.f64(), f.f64(), f.text()
    unit = 2.0 ** 21
    need(segment.start <= begin * unit <= end * unit <= segment.stop, "5.7", 315, f"times {begin} to {end}")
    return begin, end, kind, f.bytes(f.left())


def little_endian(numbers):
    """Returns integers as u32 in two's complement."""
    return struct.pack(f"<{len(numbers)}I", *(v & 0xFFFFFFFF for v in numbers))
