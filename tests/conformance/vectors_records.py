# SPDX-License-Identifier: Apache-2.0
"""Valid records: layouts, coders, predictions, mappings (6, 7, annex A)."""
import struct

from vector_file import (RANS, Body, File, Meta, Part, Patched, Segment, Stream, bits_of,
                         layouts_payload)
from vector_list import coded, framed, plain, replaced, vector
from vector_scenes import coded_streams, deltas, float_streams, give_tables, own_body, zigzags


def valid_lossless():
    primitive = [(1, 1.0, 2.0, 3.0), (2, 0.5), (3, 1.0), (4, 0.25), (5, 0.0, 0.0, 0.0),
                 (6, -1.0, -2.0, -3.0), (7, 1.0, 0.0, 0.0, 0.0), (8, 2.0), (9, 0.1, 0.2, 0.3)]
    streams = [Stream(a, 0, 0, [[bits_of(v)] for v in values]) for a, *values in primitive]
    vector("one_primitive", "9", "the example's primitive, with its own layout",
           plain(body=Body(streams, 1)))
    for degree in range(4):
        vector(f"floats_degree_{degree}", "7.5.1", f"mapping 0, SH degree {degree}",
               plain(4, degree, 10 + degree))
    two = [Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)]),
           Segment(1, 0, [Body(float_streams(1, 0, 4, 0, 10), 1)]),
           Segment(0, 0, [Body(float_streams(2, 0, 5, 0, 5), 2)]),
           Segment(0, 1, [Body(float_streams(1, 0, 6, 2.5, 5), 1)]),
           Segment(0, 4, [Body(float_streams(1, 0, 7, 10, 5), 1)])]
    vector("levels", "5.4", "persistent segment, levels 0 and 1, omitted slots", File(
        [Part(two)], Meta(profile=0)))
    shared = [float_streams(2, 0, 8, 0, 5), float_streams(3, 0, 9, 5, 5)]
    layt = struct.pack("<HH", 0, 2) + b"\x01" + Stream(0x8001, 0, 0, [[0]]).row() + b"\x09"
    layt += b"".join(s.row() for s in shared[0])
    segments = [Segment(0, 2 * i, [Body(s, len(s[0].v[0]), layout=1)]) for i, s in enumerate(shared)]
    vector("shared_layout", "6.2", "two records with layout 1 of LAYT, behind INDX in the head",
           File([Part(segments)], Meta(profile=0), layouts=layt, order=(b"META", b"INDX", b"LAYT")))
    for kind in ("raw", "repeat"):
        streams = float_streams(6, 0, 12)
        if kind == "repeat":
            streams[7].v = [[0x40404040] * 6]
        streams[7].zstd = kind
        vector(f"zstd_{kind}", "7.2", f"a stream as one zstd frame of a {kind} block",
               plain(body=Body(streams, 6)))
    streams = float_streams(3, 0, 1)
    streams[7].stored = framed(b"".join(streams[7].planes()), window=0x68)
    vector("zstd_window", "7.2.2", "a frame with a window of 8 MiB", plain(body=Body(streams, 3)))
    extra = Stream(0x8001, 9, 3, [[1, 2, 3]], 7, 0, (8,), (1.0,), stored=b"whatever")
    streams = float_streams(3, 0, 1)
    vector("optional_stream", "6.5", "attribute 0x8001 between the others, skipped",
           plain(body=Body(streams[:4] + [extra] + streams[4:], 3)))
    extra = Stream(0xBFFF, 200, -128, [[1]], 3, 77, (8,), m=0, stored=b"whatever", later=b"more")
    vector("optional_unknown_coder", "6.5", "an optional attribute with an unknown coder, skipped",
           plain(body=Body(streams + [extra], 3)))
    short = Stream(0xBFFF, 0, 0, [[1]], 0, 77, stored=b"")
    body = Body(streams + [short], 3)
    vector("optional_short_row", "6.3", "a row of an optional attribute that ends with its coder",
           plain(body=Patched(body, short.row(), struct.pack("<HH4B", 6, 0xBFFF, 1, 0, 0, 77))))
    longer = float_streams(3, 0, 1)
    for i, s in enumerate(longer):
        s.later = b"later"[:i]
    vector("longer_rows", "6.3", "rows with additional fields, which are ignored",
           plain(body=Body(longer, 3)))
    unused = [Stream(a, m, 0, [[0]], p, c) for a, m, p, c in ((13, 0, 0, 0), (8, 8, 0, 0), (8, 0, 4, 0),
                                                            (8, 0, 0, 3))]
    layt = struct.pack("<HH", 0, 2) + b"\x04" + b"".join(s.row() for s in unused)
    layt += b"\x09" + b"".join(s.row() for s in streams)
    vector("unknown_rows_unused", "6.3", "an unknown attribute, mapping, prediction and coder in a layout "
           "that no record uses", plain(body=Body(streams, 3, layout=1), layouts=layt))


def sums(n):
    """Returns streams with constant differences: no coded planes, and sums that grow."""
    def same(attribute, mapping, e, v, prediction=0, bits=(8,), origin=()):
        return Stream(attribute, mapping, e, [[value] * n for value in v], prediction, RANS, bits, origin)

    return [same(1, 1, -12, [73], 3), same(2, 1, -12, [2], 2, origin=(10.0,)),
            same(3, 2, 0, [4], 2, origin=(0.5,)), same(4, 2, 3, [2], 2, origin=(0.25, 0.25)),
            same(5, 3, -20, [2, 4, 1], 2), same(6, 1, -14, [2, 1, 4], 2, origin=(-3.0,) * 3),
            same(7, 4, -9, [2, 4, 6], 1), same(8, 1, -12, [1], 2, origin=(4.0,)),
            same(9, 5, -20, [2, 1, 4], 2)]


def valid_coded():
    vector("coded", "7", "mappings 1 to 5 and 7, predictions 0 to 3, all rANS, persistent", coded())
    vector("shaped_rotation", "7.5.7", "mapping 6", coded(40, shaped=True))
    needles = float_streams(3, 0, 1)
    needles[5].v[0] = [bits_of(-9.0)] * 3
    needles[6] = Stream(7, 6, -7, [deltas([5, -7, 700]), deltas([0, 1, 2]), deltas([9, 9, 9])], 2)
    vector("shaped_rotation_of_needles", "7.5.7", "mapping 6, the finest steps, prediction 2",
           plain(body=own_body(needles, 3)))
    vector("moment_in_a_slot", "7.5.8", "mapping 7 counts from the beginning of its segment",
           coded(6, level=0, slot=2))
    vector("coded_degree_3", "7.5.6", "mapping 5 for all SH, tables shared between planes",
           coded(7, 3, 21))
    for n in (1, 64, 65, 2048, 2112):
        streams = float_streams(n, 0, 31) if n < 100 else None
        if streams is None:  # all attributes except position are constant
            streams = float_streams(1, 0, 31)
            for s in streams:
                s.v, s.zstd = [row * n for row in s.v], "repeat"
                s.coder, s.digits = RANS, None
        streams[0] = coded_streams(n, 0, 31)[0]
        vector(f"lanes_{n}", "A.1", f"a group of {n} primitives", plain(body=own_body(streams, n)))
    vector("group_of_no_planes", "A.1", "all tables have one symbol: blocks of states alone",
           replaced(Stream(8, 1, -2, [[5, 5, 5]], 0, RANS)))
    streams = coded_streams(9, 1, 5, which="base"), coded_streams(9, 1, 5, which="rest")
    second = coded_streams(4, 1, 6, which="base"), coded_streams(4, 1, 6, which="rest")
    tables = []
    give_tables([streams[0]], tables)
    give_tables([streams[1], second[1]], tables)
    give_tables([second[0]], tables)
    layt = layouts_payload(tables, [streams[0], streams[1], second[0]])
    bodies = [Body(streams[0], 9, 0, tables), Body(second[0], 4, 2, tables)]
    rest = [Body(streams[1], 9, 1, tables), Body(second[1], 4, 1, tables)]
    vector("tiers", "5.7", "two tiers, SH in separate records, layouts and tables of LAYT",
           File([Part([Segment(-1, 0, bodies, rest)])], Meta(degree=1), layouts=layt))
    wide = Stream(8, 1, -2, [[0, 0, 0]], 0, RANS, (2, 3), digits=[bytes([7, 1, 255]),
                                                                bytes([2, 0, 9])])
    vector("digits_wider_than_their_bits", "7.3", "the bits of digits are combined by or", replaced(wide))
    limits = Stream(8, 1, -24, [[(1 << 24) - 1, (1 << 32) - (1 << 24) + 1, 0]], 0)
    vector("integers_of_24_bits", "7.5", "the minimum and the maximum", replaced(limits))
    limits = Stream(8, 1, -24, [[65793, (1 << 32) - 65793, 0]], m=255)
    vector("multiplied_integers_of_24_bits", "7.5", "the minimum and the maximum for m = 255",
           replaced(limits))
    for name, e in (("least_step", -100), ("greatest_step", 100)):
        vector(name, "7.5", f"e = {e}, the limit that avoids subnormals and infinities",
               replaced(Stream(8, 1, e, [[(1 << 24) - 1, (1 << 32) - 1, 0]], origin=(-2.0 ** e,))))
    many = coded_streams(6, 1, 44, shaped=True)
    for s, m in zip(many, (3, 7, 5, 13, 9, 5, 3, 15, 11, 255)):
        s.m = m
    many[2].e = many[3].e = 17
    vector("multipliers", "7.5", "m of 3 to 255 in every mapping except 0 and 4, in a slot",
           File([Part([Segment(2, 1, [own_body(many, 6)])])], Meta(degree=1)))
    turned = Stream(7, 4, -9, [zigzags([100, -99, 0]), zigzags([1, 2, 3]), zigzags([3, -2, 1])], 1, m=5)
    vector("multiplied_rotation", "7.5.5", "mapping 4 with m = 5", replaced(turned))
    finest = [[bits_of(-9.0)] * 3, [bits_of(-3.0)] * 3, [bits_of(-3.0)] * 3]
    needles = float_streams(3, 0, 1)
    needles[5].v = finest
    needles[6] = Stream(7, 6, -14, [[5000, 0, 1], [0, 0, 1], [1, 2, 3]], m=3)
    vector("finest_rotation", "7.5.7", "the exponent stays at -14; R has more than 24 bits",
           plain(body=own_body(needles, 3)))
    lives = float_streams(3, 0, 1)
    lives[2].v = [[bits_of(v) for v in (2.0 ** -40, 2.0 ** -127, 2.0 ** 60)]]
    lives[3].v = [[bits_of(v) for v in (0.0, 2.0 ** -130, 0.0)]]
    for name, e in (("least_displacements", -100), ("greatest_displacements", 100)):
        lives = [Stream(5, 3, e, [[1, 2, (1 << 32) - 3]] * 3) if s.attribute == 5 else s for s in lives]
        vector(name, "7.5.4", f"e = {e} with lifespans shorter than any f32 step",
               plain(body=own_body(lives, 3)))
    vector("truncated_to_2_to_100", "7.5.3", "the maximum float of mapping 2",
           replaced(Stream(3, 2, 23, [[0, 0, 100]], origin=(1.0,))))
    vector("displacement_clamped", "7.5.4", "lifespans longer than the part",
           replaced(Stream(5, 3, -3, [[2, 3, 4]] * 3, 1)))
    key = Stream(1, 1, -10, [[0, 5, (1 << 40) + 3]], 3, bits=(8,) * 8)
    vector("morton_of_63_bits", "7.4", "a first key, differences of eight digits",
           replaced(key, first_key=(1 << 62) + 12345))
    limit = (1 << 22) - 1
    colour = Stream(9, 5, -24, [[limit, (1 << 32) - limit, 1], [limit, limit, 2], [(1 << 32) - limit, limit, 3]])
    vector("colour_of_24_bits", "7.5.6", "the maximum channels", replaced(colour))
    vector("sums_over_16500", "7.4", "keys and differences summed over many primitives",
           plain(body=own_body(sums(16500), 16500)))
    linear = coded_streams(5, 0, 40, segment_time=False)
    vector("linear_time", "7.5.2", "mapping 1 for time", plain(body=own_body(linear, 5)))
