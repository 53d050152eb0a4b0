# SPDX-License-Identifier: Apache-2.0
"""Clauses 6 and 7: from SEGM records to integers, from integers to floats."""
import math
import struct

import numpy as np

import rans
from container import floats_bytes, known, present
from fields import Fields, Refused, checksum, need, record_at
from frames import check_stored, unpack
from layouts import COMPONENTS, DRACO, MORTON, RANS, Layouts, check_attributes, read_layouts

F32 = np.float32


def decode_tier(file, tier):
    """Returns {attribute: (integers, floats)}, and the error that refuses its SH, or None (5.7).
    integers has one row per component, floats one per primitive."""
    memory = file.limits.max_memory - floats_bytes(file, tier)  # conformance.md 1.5
    base = open_record(file, tier, tier.base, 0, memory)
    need(file.degree > 0 or tier.sh is None, "5.7", "a separate record of SH at degree 0")
    if file.degree > 0:  # 5.7
        need(base[2] == (tier.sh is not None), "5.7", "SH stored twice or not at all")
    out = decoded(file, tier, base)
    if tier.sh is None:
        return out, None
    try:
        rest = open_record(file, tier, tier.sh, 1, base[-1])
        return {**out, **decoded(file, tier, rest)}, None
    except Refused as error:
        return out, error


def decoded(file, tier, record):
    check_sizes(record, tier.n)  # of all streams, before memory is allocated for the primitives
    out = {}
    decode_record(file, tier, record, out)
    for attribute, (_, floats) in out.items():
        check_values(attribute, floats)
    return out


def take(memory, count):  # conformance.md 1.5
    need(count <= memory, "conformance 1.5", "a segment that exceeds the memory limit", unsupported=True)
    return memory - count


def open_record(file, tier, location, content, memory):  # 6.1
    present(file, location.offset, location.size)
    memory = take(memory, location.size)
    tag, flags, payload, payload_sum = record_at(file.data, location.offset,
                                                 location.offset + location.size)
    need(tag == b"SEGM" and len(payload) + 32 == location.size, "5.3", f"record {tag} of another size")
    need(flags & 1 == 1, "3.2", "a segment that is not marked critical")
    known(tag, flags, (b"SEGM",))
    need(checksum(payload) == payload_sum, "3.1", "the checksum of SEGM")
    fields = Fields(payload, "6.1")
    stated = (fields.i16(), fields.u16(), fields.u32(), fields.u32())
    need(stated == (tier.level, 256 * content + tier.number, tier.slot, tier.n), "6.1",
         f"the record states {stated}")
    number, planes_sum = fields.u16(), fields.u64()
    layouts = file.layouts
    if number == 65535:
        layouts, number = read_layouts(fields, memory, 256), 0
        memory = take(memory, 16384 * len(layouts.tables))
        need(len(layouts.layouts) == 1, "6.1", f"{len(layouts.layouts)} layouts of its own")
    need(number < len(layouts.layouts), "6.1", f"layout {number} does not exist")
    layout = layouts.layouts[number]
    if isinstance(layout, Refused):
        raise layout
    if layouts is not file.layouts:
        named = {t for s in layout for t in s.tables}
        need(len(named) == len(layouts.tables), "6.1", "a table that no plane uses")
    partial = check_attributes(layout, content, file.degree)
    for s in layout:  # 8.1
        if not s.optional():
            need(s.mapping == 0 or file.profile != 0, "8.1", "a mapping in a lossless file")
            need(s.coder != DRACO or file.profile not in (0, 1), "8.1", "Draco in another profile")
    for s in layout:
        coded = [t for t in s.tables if layouts.tables[t].only is None]
        memory = take(memory, tier.n * (len(coded) if s.coder == RANS else s.planes()))
    first_key = 0
    if any(s.prediction == MORTON and not s.optional() for s in layout):
        first_key = fields.u64()
    sizes = [None if s.coder == RANS else fields.u64() for s in layout]
    stored = [b"" if size is None else fields.bytes(size) for size in sizes]
    group = fields.bytes(fields.left()) if any(s.coder == RANS for s in layout) else b""
    need(fields.left() == 0, "6.1", f"{fields.left()} bytes after the streams")
    return (layouts, layout, partial, first_key, stored, group, planes_sum, memory)


def check_sizes(record, n):  # 7.2
    _, layout, _, _, stored, group, _, _ = record
    for s, data in zip(layout, stored):
        need(s.optional() or s.coder != DRACO, "7.2.1", "positions that only Draco decodes",
             unsupported=True)
        if not s.optional() and s.coder != RANS:
            check_stored(data, n * s.planes())


def decode_record(file, tier, record, out):
    layouts, layout, _, first_key, stored, group, planes_sum, _ = record
    n = tier.n
    in_group = [layouts.tables[t] for s in layout for t in s.tables
                if layouts.tables[t].only is None]
    coded = iter(rans.decode_group(group, n, in_group)) if group or \
        any(s.coder == RANS for s in layout) else iter(())
    summed, planes_of = bytearray(), []
    for s, data in zip(layout, stored):
        planes = []
        if s.optional():  # 6.5
            pass
        elif s.coder == RANS:
            for t in s.tables:
                only = layouts.tables[t].only
                planes.append(bytes([only]) * n if only is not None else bytes(next(coded)))
                if only is None:
                    summed += planes[-1]
        else:
            data = unpack(data, n * s.planes())
            summed += data
            planes = [data[p * n:(p + 1) * n] for p in range(s.planes())]
        planes_of.append(planes)
    need(checksum(summed) == planes_sum, "6.1", "the checksum of the planes")
    done = {}
    for s, planes in zip(layout, planes_of):
        if s.optional():
            continue
        q = predicted(s, values(s, planes, n), first_key)
        done[s.attribute] = q, mapped(file, tier, s, q, {**out, **done})
    out.update(done)


def values(s, planes, n):  # 7.3
    limit = 1 << (64 if s.prediction == MORTON else 32)
    out = []
    for c in range(s.components):
        v, shift = [0] * n, 0
        for d, bits in enumerate(s.bits):
            plane = planes[c * len(s.bits) + d]
            v = [(a | (symbol << shift)) % limit for a, symbol in zip(v, plane)]
            shift += bits
        out.append(v)
    return out


def signed(v):  # 32-bit two's complement
    v &= 0xFFFFFFFF
    return v - (1 << 32) if v >> 31 else v


def predicted(s, rows, first_key):  # 7.4
    if s.prediction == 0:
        return [[signed(v) for v in row] for row in rows]
    if s.prediction == MORTON:
        out, key = [[], [], []], first_key
        need(key < 1 << 63, "7.4", "a first key of 2^63 or more")
        for v in rows[0]:
            key += v
            need(v < 1 << 63 and key < 1 << 63, "7.4", "a key of 2^63 or more")
            for c in range(3):
                out[c].append(sum((key >> (3 * j + c) & 1) << j for j in range(21)))
        return out
    rows = [[-(v + 1) // 2 if v % 2 else v // 2 for v in row] for row in rows]
    if s.prediction == 2:
        for row in rows:
            q = 0
            for i, v in enumerate(row):
                row[i] = q = signed(q + v)
    return rows


def in_range(q, m, limit, clause):
    for row in q:
        need(all(abs(m * v) < limit for v in row), clause, "an integer out of range")


def power(k):  # 2^k
    return F32(math.ldexp(1.0, int(k)))


def steps(s, row):  # m * q, exact in f32 where in_range holds
    return np.array([s.m * v for v in row], dtype=np.int64).astype(F32)


def mapped(file, tier, s, q, out):  # 7.5
    with np.errstate(all="ignore"):
        if s.mapping == 0:
            return np.array(q, dtype=np.int64).astype(np.uint32).view(F32).T
        in_range(q, s.m, 1 << (22 if s.mapping == 5 else 24), "7.5")
        origin = [F32(v) for v in s.origin]
        if s.mapping == 1:
            return np.array([origin[c % 3] + power(s.e) * steps(s, row)
                             for c, row in enumerate(q)]).T
        if s.mapping == 2:
            return truncated(s, q[0], origin)
        if s.mapping == 3:
            return displacement(tier, s, q, out)
        if s.mapping in (4, 6):
            return rotation(s, q, out)
        if s.mapping == 5:
            return colour(s, q)
        return segment_time(tier, s, q[0], origin)


def truncated(s, q, origin):  # 7.5.3
    need(all(v >= 0 for v in q), "7.5.3", "an integer below 0")
    first = struct.unpack("<I", struct.pack("<f", origin[0]))[0]
    bits = [first + (s.m * v << s.e) for v in q]
    need(all(b <= 0x71800000 for b in bits), "7.5.3", "a float above 2^100")
    return (np.array(bits, dtype=np.uint32).view(F32) - origin[1]).reshape(-1, 1)


def displacement(tier, s, q, out):  # 7.5.4
    sigma, radius = out[3][1][:, 0], out[4][1][:, 0]
    begin, end = tier.part
    length = np.minimum(radius + F32(2) * sigma, F32(end - begin))
    e = np.clip((length.view(np.uint32) >> 23 & 255).astype(int) - 127, -32, 32)
    step = np.array([power(k) for k in np.clip(s.e - e, -100, 100)], dtype=F32)
    return np.array([step * steps(s, row) for row in q]).T


def rotation(s, q, out):  # 7.5.5, 7.5.7
    rows = []
    for i, v in enumerate(zip(*q)):
        x, y, z = (s.m * c for c in v)
        e = s.e
        if s.mapping == 6:
            scales = out[6][1][i]
            a = scales.max() - scales.min()
            e += 3 - sum(bool(a >= F32(v)) for v in (0.125, 0.5, 1.25, 2.375, 3.75, 5))
            e = max(-14, min(-1, e))
        r = (1 << -2 * e) - x * x - y * y - z * z
        need(r > 0, "7.5.5", "R is not above 0")
        rows.append([power(e) * np.sqrt(F32(r))] + [power(e) * F32(v) for v in (x, y, z)])
    return np.array(rows, dtype=F32)


def colour(s, q):  # 7.5.6
    rows = []
    for c in range(0, len(q), 3):
        y, o, g = (np.array(row, dtype=np.int64) for row in q[c:c + 3])
        rows += [power(s.e) * steps(s, v) for v in (y - g + o, y + g, y - g - o)]
    return np.array(rows).T


def segment_time(tier, s, q, origin):  # 7.5.8
    quotient = tier.start / math.ldexp(s.m, s.e)
    first = math.floor(max(-2.0 ** 25, min(2.0 ** 25, quotient)))
    sums = [v + first for v in q]
    in_range([sums], s.m, 1 << 24, "7.5.8")
    return (origin[0] + power(s.e) * steps(s, sums)).reshape(-1, 1)


def check_values(attribute, floats):  # 6.4, conformance.md 1.2
    need(np.isfinite(floats).all(), "6.4", "a value that is not finite")
    need(attribute != 3 or (floats > 0).all(), "6.4", "a sigma that is not above 0")
    need(attribute != 4 or (floats >= 0).all(), "6.4", "a radius below 0")
    need(attribute != 7 or (floats != 0).any(axis=1).all(), "6.4", "a quaternion of length 0")
