# SPDX-License-Identifier: Apache-2.0
"""Clause 8: from the planes of a stream to integers, and from integers to floats."""
import math
import struct
from dataclasses import dataclass, field
from fractions import Fraction

from fields import need
from layouts import LOG_SCALE, MORTON, RADIUS, SIGMA

MASK = 0xFFFFFFFF  # all operations are modulo 2^32 (1.6)


@dataclass
class Integers:
    """A stream after 8.4 and the checks of 8.5 to 8.9."""
    row: object
    q: list                     # one list for each component
    exponents: list = field(default_factory=list)  # of the steps of each primitive, mappings 3, 4 and 6
    first: int = 0              # F, mapping 7


def bits_of(value):
    return struct.unpack("<I", struct.pack("<f", value))[0]


def as_float(bits):
    return struct.unpack("<f", struct.pack("<I", bits))[0]


def signed(v):  # 8.2
    return v - (1 << 32) if v >> 31 else v


def unzigzag(v):  # 8.2
    return -(v + 1) // 2 if v % 2 else v // 2


def values(row, planes, n):  # 8.1
    out, planes = [], iter(planes)
    for bits in row.components():
        v, shift = [0] * n, 0
        for b in bits:
            v = [(a | symbol << shift) & MASK for a, symbol in zip(v, next(planes))]
            shift += b
        out.append(v)
    return out


def predicted(row, v, first_key):  # 8.3
    if row.prediction == 0:
        return [[signed(a) for a in component] for component in v]
    if row.prediction == MORTON:
        return morton(row, v, first_key)
    out = [[unzigzag(a) for a in component] for component in v]
    if row.prediction == 2:
        for component in out:
            q = 0
            for i, a in enumerate(component):
                component[i] = q = signed((q + a) & MASK)
    return out


def morton(row, v, key):  # 8.4
    out = [[], [], []]
    for i, difference in enumerate(v[0]):
        key += difference
        need(key < 1 << 30, "8.4", 407, "a key of 2^30 or more")
        for c in range(3):
            h = sum((key >> (3 * j + c) & 1) << j for j in range(10))
            out[c].append((h << row.low) + v[1 + c][i])
    return out


def integers(row, q, before, segment, run, degree):
    """Checks the ranges of 8.5 to 8.9 and returns Integers. `before` has those of the attributes of
    lower numbers of the record."""
    out = Integers(row, q)
    if row.mapping == 0:
        out.q = [[v << row.e & MASK for v in component] for component in q]
        return out
    if row.mapping == 8:
        need(all(0 <= v <= degree for v in q[0]), "8.5", 407, "an SH degree out of range")
        return out
    limit = 1 << (22 if row.mapping == 5 else 24)
    need(all(abs(row.m * v) < limit for component in q for v in component), "8.5", 407, "an integer out of range")
    if row.mapping == 2:
        need(all(v >= 0 for v in q[0]), "8.5", 407, "an integer below 0")
        need(all(b <= bits_of(2.0 ** 100) for b in truncated_bits(out)), "8.5", 407, "a float above 2^100")
    if row.mapping == 3:
        out.exponents = [clamp(row.e - e, -100, 100) for e in lifespans(before, run)]
    if row.mapping in (4, 6):
        shapes = shaped(before[LOG_SCALE]) if row.mapping == 6 else [0] * len(q[0])
        exponents = [clamp(row.e + s, -14, -1) for s in shapes]
        need(all(r > 0 for r in squares(out, exponents)), "8.7", 407, "R is not above 0")
        out.exponents = exponents
    if row.mapping == 7:
        start = Fraction(segment.start, 1 << 21)  # slot * H; 0 if the segment is persistent
        out.first = math.floor(start / (row.m * Fraction(2) ** row.e))
    return out


def clamp(v, least, greatest):
    return max(least, min(greatest, v))


def truncated_bits(stream):  # 8.5, mapping 2
    row = stream.row
    return [bits_of(row.origin[0]) + (row.m * v << row.e) for v in stream.q[0]]


def lifespan_bits(stream):  # 8.6
    return truncated_bits(stream) if stream.row.mapping == 2 else [b % (1 << 31) for b in stream.q[0]]


def lifespans(before, run):  # E of 8.6
    longest = (run.end - run.begin).bit_length() - 1 - 20  # floor(log2(end - begin))
    out = []
    for sigma, radius in zip(lifespan_bits(before[SIGMA]), lifespan_bits(before[RADIUS])):
        e = max((sigma >> 23) - 127 + 1, (radius >> 23) - 127)
        out.append(clamp(min(e, longest), -32, 32))
    return out


def squares(stream, exponents):  # R of 8.7
    m = stream.row.m
    return [(1 << -2 * e) - sum((m * v) ** 2 for v in axis) for e, *axis in zip(exponents, *stream.q)]


def shaped(log_scale):  # s of 8.8
    step = 8 * log_scale.row.m * Fraction(2) ** log_scale.row.e
    spans = [max(axes) - min(axes) for axes in zip(*log_scale.q)]
    return [3 - sum(step * span >= t for t in (1, 4, 10, 19, 30, 40)) for span in spans]


def floats_of(stream):
    return [[as_float(b) for b in component] for component in stream.q]


def check_finite(streams):  # 6.3
    for stream in streams.values():
        need(stream.row.mapping != 0 or all(math.isfinite(v) for component in floats_of(stream) for v in component),
             "6.3", 500, "a value that is not finite")


def check_values(attribute, stream):  # 6.3
    mapping, origin = stream.row.mapping, stream.row.origin
    if mapping == 0:
        floats = floats_of(stream)
        need(attribute != 7 or all(any(q) for q in zip(*floats)), "6.3", 503, "a quaternion of length 0")
    if attribute in (SIGMA, RADIUS):
        lives = floats[0] if mapping == 0 else [as_float(b) - origin[1] for b in truncated_bits(stream)]
        need(attribute != SIGMA or all(v > 0 for v in lives), "6.3", 501, "a sigma that is not above 0")
        need(all(v >= 0 for v in lives), "6.3", 502, "a radius below 0")


def floats(stream):
    """Returns the numbers of 8.5 in binary64, one list for each component."""
    row, q = stream.row, stream.q
    step = row.m * 2.0 ** row.e
    if row.mapping == 0:
        return [[as_float(b) for b in component] for component in q]
    if row.mapping == 1:
        return [[row.origin[c % 3] + step * v for v in component] for c, component in enumerate(q)]
    if row.mapping == 2:
        return [[as_float(b) - row.origin[1] for b in truncated_bits(stream)]]
    if row.mapping == 3:
        return [[row.m * 2.0 ** e * v for e, v in zip(stream.exponents, component)] for component in q]
    if row.mapping in (4, 6):
        w = [2.0 ** e * math.sqrt(r) for e, r in zip(stream.exponents, squares(stream, stream.exponents))]
        return [w] + [[row.m * 2.0 ** e * v for e, v in zip(stream.exponents, component)] for component in q]
    if row.mapping == 5:
        return colours(q, step)
    if row.mapping == 7:
        return [[row.origin[0] + step * (v + stream.first) for v in q[0]]]
    return [[float(v) for v in component] for component in q]  # mapping 8


def colours(q, step):  # 8.5, mapping 5
    out = []
    for c in range(0, len(q), 3):
        rows = list(zip(*q[c:c + 3]))
        out += [[step * (y - g + o) for y, o, g in rows], [step * (y + g) for y, o, g in rows],
                [step * (y - g - o) for y, o, g in rows]]
    return out
