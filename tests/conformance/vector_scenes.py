# SPDX-License-Identifier: Apache-2.0
"""Small sets of primitives for make_vectors.py, as streams of a record."""
from vector_records import COMPONENTS, RANS, Body, Stream, bits_of, table_for


class Lcg:
    """Random numbers that are the same on every machine (Knuth's MMIX constants)."""

    def __init__(self, seed):
        self.state = seed

    def below(self, count):
        self.state = (self.state * 6364136223846793005 + 1442695040888963407) % (1 << 64)
        return (self.state >> 33) % count


def zigzag(q):
    return 2 * q if q >= 0 else -2 * q - 1


def zigzags(row):
    return [zigzag(q) for q in row]


def deltas(row):
    return [zigzag(b - a) for a, b in zip([0] + row[:-1], row)]


def attributes_of(degree, which):
    above = [10] + list(range(11, 11 + degree)) if degree > 0 else []
    return {"all": list(range(1, 10)) + above, "base": list(range(1, 10)), "rest": above}[which]


def degrees_of(n, degree, degrees):
    return [degree] * n if degrees is None else degrees


def count_of(attribute, n, degree, degrees):
    """Returns the number of primitives that have an attribute (6.3)."""
    return sum(d >= attribute - 10 for d in degrees_of(n, degree, degrees)) if attribute > 10 else n


def float_streams(n, degree, seed, start=0.0, span=30.0, which="all", degrees=None):
    """Streams of mapping 0. Each primitive is visible for 3 ticks around the middle of
    [start, start + span)."""
    random = Lcg(seed)

    def small(_):
        return (random.below(512) - 256) / 256.0

    make = {1: lambda c: 2 * small(c), 2: lambda c: start + span / 2 + small(c) / 4,
            3: lambda c: 0.25 + random.below(64) / 256.0, 4: lambda c: random.below(64) / 256.0,
            5: lambda c: small(c) / 16, 6: lambda c: -3 + small(c),
            7: lambda c: small(c) + (2.0 if c == 0 else 0.0), 8: lambda c: 2 * small(c)}
    streams = []
    for a in attributes_of(degree, which):
        if a == 10:
            streams.append(Stream(a, 8, 0, [degrees_of(n, degree, degrees)], bits=(8,)))
            continue
        count = count_of(a, n, degree, degrees)
        streams.append(Stream(a, 0, 0, [[bits_of(make.get(a, small)(c)) for _ in range(count)]
                                        for c in range(COMPONENTS[a])]))
    return streams


def coded_streams(n, degree, seed, which="all", shaped=False, degrees=None, joined=False):
    """rANS streams with every mapping except 0 and every prediction."""
    random = Lcg(seed)

    def spread(count, components, low=0, n=n):
        return [[low + random.below(count) for _ in range(n)] for _ in range(components)]

    def coded(attribute, mapping, e, v, bits, prediction=0, origin=(), **more):
        return Stream(attribute, mapping, e, v, prediction, RANS, bits, origin, **more)

    out = [
        coded(1, 1, -6, spread(3000, 1) + spread(16, 3), (8, 4), 3, (-1.0, -2.0, 0.5), low=4),
        coded(2, 7, -3, [zigzags(r) for r in spread(9, 1, 16)], (6,), 1, (0.0,)),
        coded(3, 2, 20, spread(8, 1), (3,), 0, (0.25, 0.0)),
        coded(4, 2, 20, spread(12, 1), (4,), 0, (0.5, 0.5)),
        coded(5, 3, -7, [zigzags(r) for r in spread(5, 3, -2)], (3,), 1),
        coded(6, 1, -4, [deltas(r) for r in spread(20, 3, -10)], (3, 3), 2,
              (-3.0, -3.0, -3.0) if shaped else (-3.0, -3.5, -4.0)),
        coded(7, 6 if shaped else 4, -9 if shaped else -7, [zigzags(r) for r in spread(61, 3, -30)], (7,), 1),
        coded(8, 1, -2, spread(16, 1), (4,), 0, (-1.0,)),
        coded(9, 5, -5, [zigzags(r) for r in spread(31, 3, -15)], (5,), 1),
    ]
    if degree > 0:
        out.append(coded(10, 8, 0, [degrees_of(n, degree, degrees)], (2,)))
    for a in range(11, 11 + degree):
        count = count_of(a, n, degree, degrees)
        out.append(coded(a, 5, -6, [zigzags(r) for r in spread(3, COMPONENTS[a], -1, count)], (2,), 1))
    if joined:  # time to rotation in one group, opacity to SH degree in another
        for s in out:
            s.joins = int(s.attribute in (3, 4, 5, 6, 7, 9, 10))
    return [s for s in out if s.attribute in attributes_of(degree, which)]


def few_planes(n):
    """Returns streams of n equal primitives in a few rANS planes of one symbol."""
    def same(attribute, mapping, e, v, origin=()):
        return Stream(attribute, mapping, e, [[value] * n for value in v], 0, RANS, (8,), origin)

    return [same(1, 1, -4, (1, 2, 3)), same(2, 7, -2, (60,)), same(3, 2, 20, (5,), (0.25,)), same(4, 2, 20, (5,), (0.25,)),
            same(5, 3, -7, (1, 0, 2)), same(6, 1, -4, (1, 2, 3), (-4.0,) * 3), same(7, 4, -7, (1, 2, 3)), same(8, 1, -2, (3,)),
            same(9, 5, -5, (1, 2, 3))]


def give_tables(records, tables):
    """Adds a table for each rANS plane of records that share a layout to `tables`."""
    for streams in zip(*records):
        if streams[0].coder != RANS:
            continue
        planes = [s.planes() for s in streams]
        numbers = []
        for same in zip(*planes):
            f = table_for(same)
            if f not in tables:
                tables.append(f)
            numbers.append(tables.index(f))
        for s in streams:
            s.tables = numbers


def own_body(streams, n, more_tables=0, **more):
    """Returns a record with its own layout and tables, and `more_tables` unused tables."""
    tables = []
    give_tables([streams], tables)
    tables += [{0: 1 + i, 1: 4095 - i} for i in range(more_tables)]
    return Body(streams, n, tables=tables, **more)
