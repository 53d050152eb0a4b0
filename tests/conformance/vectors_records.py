# SPDX-License-Identifier: Apache-2.0
"""Valid records: layouts, coders, groups, SH degrees (6, 7)."""
import struct

from vector_file import File, Meta, Run, Segment
from vector_list import coded, must_fail, plain, replaced, separate_sh, vector
from vector_records import RANS, Body, Patched, Stream, bits_of, layouts_payload
from vector_scenes import Lcg, coded_streams, few_planes, float_streams, give_tables, own_body


def valid_records():
    primitive = [(1, 1.0, 2.0, 3.0), (2, 0.5), (3, 1.0), (4, 0.25), (5, 0.0, 0.0, 0.0),
                 (6, -1.0, -2.0, -3.0), (7, 1.0, 0.0, 0.0, 0.0), (8, 2.0), (9, 0.1, 0.2, 0.3)]
    streams = [Stream(a, 0, 0, [[bits_of(v)] for v in values]) for a, *values in primitive]
    vector("one_primitive", "6.5", "one primitive in floats, with its own layout", plain(body=Body(streams, 1)))
    for degree in range(4):
        vector(f"floats_degree_{degree}", "6.3", f"mapping 0, SH degree {degree}", plain(4, degree, 10 + degree))
    shared = [float_streams(2, 0, 8, 0, 5), float_streams(3, 0, 9, 5, 5)]
    layt = struct.pack("<HH", 0, 2) + b"\x01" + Stream(0x8001, 0, 0, [[0]]).row() + b"\x09"
    layt += b"".join(s.row() for s in shared[0])
    segments = [Segment(0, 2 * i, [Body(s, len(s[0].v[0]), layout=1)]) for i, s in enumerate(shared)]
    vector("shared_layout", "6.1", "two records with layout 1 of LAYT, which follows INDX and has additions",
           File([Run(segments)], Meta(profile=0), layouts=layt + b"later", order=(b"META", b"INDX", b"LAYT")))
    shared_tables()
    optional_streams()
    groups()
    sh_degrees()


def shared_tables():
    streams = [coded_streams(9, 1, 5, which=w) for w in ("base", "rest")]
    second = [coded_streams(4, 1, 6, which=w) for w in ("base", "rest")]
    tables = []
    give_tables([streams[0]], tables)
    give_tables([streams[1], second[1]], tables)
    give_tables([second[0]], tables)
    layt = layouts_payload(tables, [streams[0], streams[1], second[0]])
    bodies = [Body(streams[0], 9, 0, tables), Body(second[0], 4, 2, tables)]
    rest = [Body(streams[1], 9, 1, tables), Body(second[1], 4, 1, tables)]
    vector("tiers", "5.5", "two tiers, SH in records of their own, layouts and tables of LAYT",
           File([Run([Segment(-1, 0, bodies, rest)])], Meta(degree=1), layouts=layt))
    vector("apart_floats", "5.5", "SH of degree 2 in a record of its own",
           File([Run([separate_sh(degree=2)])], Meta(profile=0, degree=2)))


def optional_streams():
    streams = float_streams(3, 0, 1)
    extra = Stream(0x8001, 9, 3, [[1, 2, 3]], 7, 0, (8,), (1.0,), stored=b"whatever")
    vector("optional_stream", "6.2", "attribute 0x8001 between the others, skipped",
           plain(body=Body(streams[:4] + [extra] + streams[4:], 3)))
    extra = Stream(0xBFFF, 200, -128, [[1]], 3, 77, (8,), m=0, joins=0, stored=b"", later=b"more")
    vector("optional_unknown_coder", "6.2", "an optional attribute with an unknown coder and no bytes, skipped",
           plain(body=Body(streams + [extra], 3)))
    first = Stream(0x8000, 0, 0, [[1]], stored=b"any")
    vector("optional_first", "6.2", "attribute 0x8000 before the others", plain(body=Body([first] + streams, 3)))
    short = Stream(0xBFFF, 0, 0, [[1]], 0, 77, stored=b"x")
    vector("optional_short_row", "6.2", "a row of an optional attribute that ends with its coder",
           plain(body=Patched(Body([short] + streams, 3), short.row(), struct.pack("<HH3B", 5, 0xBFFF, 0, 0, 77))))
    longer = float_streams(3, 0, 1)
    for i, s in enumerate(longer):
        s.later = b"later"[:i]
    vector("longer_rows", "6.2", "rows with additions, which are ignored", plain(body=Body(longer, 3)))
    unused = [Stream(a, m, 0, [[0]], p, c) for a, m, p, c in ((14, 0, 0, 0), (8, 9, 0, 0), (8, 0, 4, 0),
                                                            (8, 0, 0, 3))]
    layt = struct.pack("<HH", 0, 2) + b"\x04" + b"".join(s.row() for s in unused)
    layt += b"\x09" + b"".join(s.row() for s in streams)
    vector("unknown_rows_unused", "6.2", "an unknown attribute, mapping, prediction and coder in a layout that no "
           "record uses", plain(body=Body(streams, 3, layout=1), layouts=layt), validator=[403])
    vector("padded_record", "6.5", "bytes after the units, which are ignored",
           plain(body=Body(streams, 3, after=b"\0\0more")))
    few = [Stream(s.attribute, s.mapping, s.e, [row[:1] * 400 for row in s.v], s.prediction, RANS, s.bits, s.origin,
                  low=s.low) for s in coded_streams(1, 0, 2)]
    vector("one_primitive_per_byte", "5.5", "400 identical primitives in 400 bytes", plain(body=own_body(few, 400)))


def groups():
    vector("coded", "7", "mappings 1 to 5 and 7, predictions 0 to 3, a group for each stream", coded())
    vector("joined", "6.5", "two groups of several streams", coded(joined=True))
    for name, joins in (("joined_all", range(2, 11)), ("joined_after_bytes", (4, 5))):
        streams = coded_streams(6, 1, 7)
        for s in streams:
            s.joins = int(s.attribute in joins)
        if name == "joined_after_bytes":
            streams[1] = Stream(2, 7, -3, [[20, 21, 22, 23, 24, 25]], bits=(8,))
        vector(name, "6.5", "groups: " + ("one with all streams but SH" if name == "joined_all" else
                                        "one after a stream of bytes"),
               File([Run([Segment(-1, 0, [own_body(streams, 6)])])], Meta(degree=1)))
    one = own_body(coded_streams(1, 0, 2), 1)
    one.tables = [f if len(f) > 1 else {min(f): 4095, (min(f) + 1) % 256: 1} for f in one.tables]
    vector("lanes_1", "7.1", "groups of one symbol a plane", plain(body=one, meta=Meta()))
    for n in (255, 256, 257, 511, 513):
        vector(f"lanes_{n}", "7.1", f"a group of {n} symbols a plane", opacities(n))
    for n in (8192, 8193, 16384 + 300):
        vector(f"blocks_{n}", "7.3", f"a group of {n} symbols a plane", opacities(n))
    vector("group_of_no_planes", "7.1", "a table of one symbol: a group without bytes",
           replaced(Stream(8, 1, -2, [[5, 5, 5]], 0, RANS)))
    constant = Stream(8, 1, -2, [[5 + 256 * v for v in (1, 2, 3)]], 0, RANS, (8, 8))
    vector("group_with_a_known_plane", "6.5", "one plane of two has a table of one symbol", replaced(constant))
    every = opacities(300)
    every.root[0].segments[0].tiers = [all_symbols()]
    vector("table_of_256", "7.2", "a table of 256 symbols", every)
    vector("tables", "7.2", "tables with gaps, a first symbol above 0, and frequencies from 1 to 4095",
           plain(body=table_zoo()))
    wide = Stream(8, 1, -2, [[0, 0, 0]], 0, RANS, (2, 3), digits=[bytes([7, 1, 255]), bytes([2, 0, 9])])
    vector("digits_wider_than_their_bits", "8.1", "the bits of digits are combined by or", replaced(wide))
    for name, bits in (("digits_8", (4, 1, 2, 3, 4, 5, 6, 7)), ("digits_of_1_bit", (1,) * 8)):
        many = coded_streams(3, 0, 2)
        many[7] = Stream(8, 1, -20, [[5, 0xABCDEF, 0x123456]] if name == "digits_8" else [[0xAB, 0x55, 0xFE]], 0, RANS, bits)
        vector(name, "8.1", f"eight digits of {bits} bits", plain(body=own_body(many, 3), meta=Meta()))
    many = coded_streams(3, 0, 2)
    many[7] = Stream(8, 1, -20, [[0, 0, 0]], 0, RANS, (8, 8, 8, 1, 7), digits=[
        bytes([5, 6, 7]), bytes([0, 1, 0]), bytes([0, 0, 255]), bytes([1, 1, 0]), bytes([255, 127, 0])])
    vector("digits_beyond_32_bits", "8.1", "the last digit has a bit beyond 32", plain(body=own_body(many, 3), meta=Meta()))
    over = Stream(8, 1, -2, [[0, 0, 0]], 0, RANS, (8, 8, 8, 7), digits=[bytes(3)] * 3 + [bytes([0, 1, 255])])
    over.digits[0] = bytes([9, 8, 7])
    over.digits[3] = bytes([0, 0, 255])
    vector("digits_of_31_bits", "8.1", "a digit's bits from 31 on", replaced(over))


def equal_primitives(n, opacity):
    """Returns a record of n primitives that differ in their opacity alone."""
    streams = few_planes(n)
    streams[7] = opacity
    return own_body(streams, n)


def all_symbols():
    return equal_primitives(300, Stream(8, 1, -2, [[v % 256 for v in range(300)]], 0, RANS, (8,)))


def opacities(n):
    """Returns a file of a group of two planes of n symbols."""
    random = Lcg(n)
    values = [random.below(3) * random.below(7) + 256 * random.below(2) for _ in range(n)]
    return plain(body=equal_primitives(n, Stream(8, 1, -2, [values], 0, RANS, (8, 1))))


def table_zoo():
    """Returns a record whose planes have tables of many forms."""
    random = Lcg(77)
    zoo = [{0: 1, 255: 4095}, {7: 4095, 8: 1}, {0: 2048, 1: 2048}, {1: 1000, 2: 1, 9: 95, 100: 3000},
           {s: 1 for s in range(0, 256, 2)} | {255: 4096 - 128}, {250: 4095, 255: 1}]
    streams = float_streams(50, 0, 1)
    planes = []
    for f in zoo:
        symbols = sorted(f)
        planes.append(bytes(symbols[random.below(len(symbols))] for _ in range(50)))
    streams[7] = Stream(8, 1, -20, [[]], 0, RANS, (4,) * 4, digits=planes[:4], tables=[0, 1, 2, 3])
    streams[0] = Stream(1, 1, -20, [[], [], []], 0, RANS, (8, 2), (1.0,), digits=(planes[4:] + planes[1:3]) + planes[4:],
                        tables=[4, 5, 1, 2, 4, 5])
    streams[7].v = [[0] * 50]
    streams[0].v = [[0] * 50] * 3
    return Body(streams, 50, tables=zoo)


def own_tables():
    """Returns a record with 256 tables of its own, each used by one of 261 planes, and streams of all attributes."""
    streams = float_streams(1, 3, 1)
    low, high = iter(range(255, 60, -1)), iter([*range(1, 61), 0, 1, 2, 3, 4])
    for s in streams:
        s.coder, s.digits = RANS, []
        for _ in s.v if s.attribute != 10 else ():
            s.digits += [bytes([next(low)]) for _ in range(3)] + [bytes([next(high)])]
        if s.attribute == 10:
            s.digits = None
        s.tables = [plane[0] for plane in s.planes()]
    return Body(streams, 1, tables=[{v: 4096} for v in range(256)])


def sh_degrees():
    vector("own_tables_256", "6.1", "256 tables of one record", plain(body=own_tables(), degree=3))
    more = own_tables()
    more.tables.append({4: 2048, 5: 2048})
    more.streams[-1].tables[-1] = 256  # instead of table 4, which another plane uses
    must_fail("own_tables_257_used", "6.1", "257 tables of one record, each used", plain(body=more, degree=3))
    first, second = (coded_streams(4, 3, seed, degrees=d) for seed, d in ((5, [3, 3, 2, 1]), (6, [1, 0, 1, 2])))
    tables = []
    give_tables([first, second], tables)
    layt = layouts_payload(tables, [first])
    vector("sh_degrees_shared", "7.1", "two records of one layout, one of which has no primitives of degree 3", File(
        [Run([Segment(-1, 0, [Body(first, 4, 0, tables), Body(second, 4, 0, tables)])])], Meta(degree=3), layouts=layt))
    mixed = [3, 0, 2, 1, 1, 3, 0]
    for name, make in (("floats", lambda **more: Body(float_streams(7, 3, 4, degrees=mixed, **more), 7)),
                       ("coded", lambda **more: own_body(coded_streams(7, 3, 4, degrees=mixed, **more), 7))):
        vector(f"sh_degrees_{name}", "6.3", "primitives of SH degrees 0 to 3",
               File([Run([Segment(-1, 0, [make()])])], Meta(degree=3, profile=int(name == "coded"))))
    rest = float_streams(7, 3, 4, degrees=mixed, which="rest")
    segment = separate_sh(7, 4, rest, 3)
    vector("sh_degrees_apart", "6.3", "SH degrees 0 to 3 in a record of its own",
           File([Run([segment])], Meta(degree=3, profile=0)))
    for name, degrees in (("lower", [1, 0, 1]), ("none", [0, 0, 0])):
        streams = coded_streams(3, 3, 4, degrees=degrees)
        vector(f"sh_degrees_{name}", "7.1", f"D is 3, the primitives have degrees {degrees}: planes of no symbols",
               File([Run([Segment(-1, 0, [own_body(streams, 3)])])], Meta(degree=3)))
