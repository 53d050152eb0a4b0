# SPDX-License-Identifier: Apache-2.0
"""Violations of the rules of records and their streams (6, 7, annex A)."""
import struct

from vector_file import (RANS, Body, File, Meta, Part, Patched, Segment, Stream, bits_of, group,
                         record, table_bytes, zstd_frame)
from vector_list import separate_sh, changed, framed, must_fail, plain, replaced, vector, flipped
from vector_scenes import float_streams, own_body


def broken_segment():
    def three():
        return File([Part([Segment(0, 2 * i, [Body(float_streams(2, 0, i, 5 * i, 5), 2)])
                           for i in range(3)])], Meta(profile=0))

    good = three().bytes()
    second = good.index(b"SEGM", good.index(b"SEGM") + 4)
    must_fail("damage_to_one_segment", "3.1", "a flipped bit in the second of three segments; the others are decoded",
           flipped(good, second + 100))
    for name, clause, flags in (("segment_not_critical", "3.2", 0), ("segment_flags", "3.4", 3)):
        file = plain()
        file.parts[0].segments[0].flags = flags
        must_fail(name, clause, f"SEGM with flags {flags}", file)
    file = plain()
    file.parts[0].segments[0].stated = (0, 3)
    must_fail("another_segment", "6.1", "the record states another level and slot than the index", file)
    streams = float_streams(3, 0, 1)
    must_fail("layout_not_there", "6.1", "layout 0 without LAYT", plain(body=Body(streams, 3, layout=0)))
    must_fail("two_own_layouts", "6.1", "two layouts in a record",
           plain(body=Body(streams, 3, own_layouts=2)))
    must_fail("bytes_after_the_streams", "6.1", "one additional byte",
           plain(body=Body(streams, 3, after=b"\0")))
    must_fail("planes_checksum", "6.1", "a wrong checksum of the planes",
              plain(body=Body(streams, 3, planes_sum=0)), may=True)
    bad, good = Stream(1, 0, 0, [[0]] * 3, m=2), float_streams(3, 0, 1)
    layt = struct.pack("<HH", 0, 2) + b"\1" + bad.row() + b"\x09" + b"".join(s.row() for s in good)
    bodies = [Body(float_streams(3, 0, 1, 5 * i, 5), 3, layout=i) for i in (0, 1)]
    both = [Segment(0, 2 * i, [body]) for i, body in enumerate(bodies)]
    must_fail("bad_layout", "7.5.1", "a row with m = 2 in one of two layouts: one of two records is decoded",
              File([Part(both)], Meta(profile=0), layouts=layt))
    vector("bad_layout_unused", "7.5.1", "a row with m = 2 in a layout that no record uses",
           File([Part(both[1:])], Meta(profile=0), layouts=layt), reported=[404])
    coded = float_streams(3, 0, 1)
    coded[7] = Stream(8, 1, 0, [[0, 1, 2]], 0, RANS, (2,))
    must_fail("own_table_unnamed", "6.1", "a table of a record that no plane uses",
              plain(body=own_body(coded, 3, more_tables=1)))
    must_fail("own_tables_257", "6.1", "257 tables in a record",
              plain(body=own_body(coded, 3, more_tables=256)))
    must_fail("attribute_missing", "6.4", "no radius",
           plain(body=Body(streams[:3] + streams[4:], 3)))
    must_fail("attributes_out_of_order", "6.4", "time before position",
           plain(body=Body([streams[1], streams[0]] + streams[2:], 3)))
    must_fail("unknown_attribute", "6.3", "attribute 13",
           plain(body=Body(streams + [Stream(13, 0, 0, [[0, 0, 0]])], 3)))
    must_fail("harmonics_nowhere", "5.7", "neither in the record nor in a separate one",
           plain(body=Body(float_streams(3, 1, 1, which="base"), 3), degree=1))
    both = Segment(-1, 0, [Body(float_streams(3, 1, 1), 3)],
                   [Body(float_streams(3, 1, 1, which="rest"), 3)])
    must_fail("harmonics_twice", "5.7", "in both records", File([Part([both])], Meta(degree=1)))


def broken_sh():
    """If only SH is refused, the other attributes of the tier are decoded (5.7)."""
    def both():
        first = separate_sh()
        second = separate_sh(2, 2)
        first.tiers += second.tiers
        first.sh += second.sh
        return File([Part([first])], Meta(profile=0, degree=1)).bytes()

    complete = both()
    records = [i for i in range(len(complete)) if complete.startswith(b"SEGM", i)]
    must_fail("harmonics_damaged", "3.1", "a flipped bit in the SH of the first of two tiers",
              flipped(complete, records[2] + 100))
    must_fail("harmonics_cut_off", "2.6", "the file is truncated within the SH of the first of two tiers",
              complete[:records[2] + 100])
    must_fail("primitives_damaged", "3.1", "a flipped bit in the first of two tiers",
              flipped(complete, records[0] + 300))
    later = float_streams(3, 1, 1, which="rest")
    later[0].mapping = 8
    must_fail("harmonics_unknown", "6.3", "SH with a mapping of a later version",
              File([Part([separate_sh(rest=later)])], Meta(profile=1, degree=1)))
    broken = float_streams(3, 1, 1, which="rest")
    broken[0].v[0][1] = bits_of(float("nan"))
    must_fail("harmonics_not_numbers", "6.4", "a coefficient that is not a number",
              File([Part([separate_sh(rest=broken)])], Meta(profile=0, degree=1)))


def broken_streams():
    for name, clause, about, fields in (
            ("unknown_mapping", "6.3", "mapping 8", dict(mapping=8)),
            ("unknown_prediction", "6.3", "prediction 4", dict(prediction=4)),
            ("unknown_coder", "6.3", "coder 3", dict(coder=3)),
            ("row_too_short", "6.3", "a row that ends within its fields", dict(length=12)),
            ("row_without_a_kind", "6.3", "a row of five bytes", dict(length=5)),
            ("row_beyond_the_layout", "6.1", "a row longer than the remaining bytes", dict(length=65535)),
            ("multiplier_of_floats", "7.5.1", "mapping 0 with m = 3", dict(m=3)),
            ("multiplier_0", "7.5", "m = 0", dict(mapping=1, m=0)),
            ("multiplier_2", "7.5", "m = 2", dict(mapping=1, m=2)),
            ("step_too_small", "7.5", "e = -101", dict(mapping=1, e=-101)),
            ("step_too_great", "7.5", "e = 101", dict(mapping=1, e=101)),
            ("origin_too_small", "7.5", "an origin of 2^-101", dict(mapping=1, origin=(2.0 ** -101,))),
            ("origin_too_great", "7.5", "an origin of 2^101", dict(mapping=1, origin=(-2.0 ** 101,))),
            ("origin_not_a_number", "7.5", "an origin that is not a number",
             dict(mapping=1, origin=(0.0, float("nan")))),
            ("draco_elsewhere", "7.2.1", "an opacity with the coder for positions",
             dict(coder=2, mapping=1, bits=(8, 8, 8))),
            ("float_with_prediction", "7.5.1", "mapping 0, prediction 1", dict(prediction=1)),
            ("mapping_of_another", "7.5", "an opacity with mapping 4", dict(mapping=4)),
            ("components", "7.5", "an opacity of 2 components", dict(components=2)),
            ("digits_of_33_bits", "7.3", "5 digits of 8, 8, 8, 8 and 1 bits",
             dict(bits=(8, 8, 8, 8, 1), coder=RANS, v=[[0, 0, 0]])),
            ("digit_of_9_bits", "7.3", "a digit of 9 bits", dict(bits=(9,), coder=RANS,
                                                               v=[[0, 0, 0]])),
            ("stored_digits_of_4_bits", "7.2", "coder 0, 4 bits", dict(bits=(4, 4), v=[[0, 0, 0]])),
            ("planes_beyond_floats", "7.3", "81 planes for 80 bytes of floats",
             dict(bits=(8, 8, 8, 4, 4), coder=RANS, v=[[0, 0, 0]])),
            ("truncated_opacity", "7.5", "an opacity with mapping 2", dict(mapping=2))):
        if fields.get("coder") == RANS:
            streams = float_streams(3, 0, 1)
            for field, value in fields.items():
                setattr(streams[7], field, value)
            must_fail(name, clause, about, plain(body=own_body(streams, 3)))
        else:
            must_fail(name, clause, about, changed(8, **fields))
    must_fail("truncated_from_0", "7.5.3", "mapping 2 from an origin of 0",
              changed(3, mapping=2, e=20))
    must_fail("coarse_lifespans", "7.5.3", "mapping 2 with e = 24",
              changed(3, mapping=2, e=24, origin=(1.0,)))
    must_fail("coarse_rotation", "7.5.5", "mapping 4 with e = 0", replaced(
        Stream(7, 4, 0, [[0] * 3] * 3)))
    for name, clause, about, stored in (
            ("zstd_window_of_9_mib", "7.2.2", "a window of 9 MiB", framed(b"123456789012", window=0x69)),
            ("zstd_skippable", "7.2.2", "a skippable frame before the frame",
             struct.pack("<II", 0x184D2A50, 0) + zstd_frame(b"123456789012")),
            ("zstd_skippable_behind", "7.2", "a skippable frame after the frame",
             zstd_frame(b"123456789012") + struct.pack("<II", 0x184D2A50, 0)),
            ("zstd_legacy", "7.2.2", "a frame of format 0.7",
             b"\x27" + zstd_frame(b"123456789012")[1:]),
            ("zstd_without_size", "7.2.2", "a frame that does not state its content's size",
             framed(b"123456789012", window=0x50, size=None)),
            ("zstd_dictionary", "7.2.2", "a frame that requires dictionary 1",
             framed(b"123456789012", dictionary=1)),
            ("zstd_reserved_bit", "7.2.2", "a reserved bit in a frame's header",
             framed(b"123456789012", reserved=8)),
            ("zstd_checksum", "7.2.2", "a frame with a checksum of its own",
             framed(b"123456789012", reserved=4) + b"\0\0\0\0")):
        must_fail(name, clause, about, changed(8, stored=stored))
    must_fail("zstd_size", "7.2.2", "a frame that states another size", changed(
        8, stored=zstd_frame(b"1234567", size=13)))
    must_fail("zstd_two_frames", "7.2", "a second frame after the frame", changed(
        8, stored=zstd_frame(b"123456789012") + zstd_frame(b"")))
    must_fail("zstd_damaged", "7.2", "a block of a reserved kind", changed(
        8, stored=zstd_frame(b"123456789012").replace(b"\x61\0\0", b"\x67\0\0")))
    must_fail("integer_of_25_bits", "7.5", "2^24", replaced(Stream(8, 1, -24, [[0, 1 << 24, 0]])))
    must_fail("integer_of_minus_2_to_24", "7.5", "-2^24",
              replaced(Stream(8, 1, -24, [[0, (1 << 32) - (1 << 24), 0]])))
    must_fail("multiplied_integer_of_25_bits", "7.5", "3 * 5592406 = 2^24 + 2",
              replaced(Stream(8, 1, -24, [[0, 5592406, 0]], m=3)))
    must_fail("colour_of_23_bits", "7.5", "a luma of 2^22",
              replaced(Stream(9, 5, -24, [[1 << 22, 0, 0], [0] * 3, [0] * 3])))
    must_fail("multiplied_key", "7.5", "a coordinate of 2^21 - 1 in steps of 9", replaced(
        Stream(1, 1, 0, [[0, 1, 0]], 3, bits=(8,), m=9), first_key=(1 << 61) - 1))
    must_fail("delta_out_and_back", "7.5", "sums wrap at 32 bits, but one of them has more than 24",
              replaced(Stream(8, 1, -20, [[10, 0xFFFFFFFF, 0xFFFFFFFF]], 2)))
    must_fail("truncated_below_0", "7.5.3", "q = -1",
           replaced(Stream(3, 2, 18, [[1, 1, 0xFFFFFFFF]], origin=(1.0,))))
    must_fail("truncated_infinite", "7.5.3", "the bits of an infinity",
           replaced(Stream(3, 2, 23, [[0, 0, 128]], origin=(1.0,))))
    must_fail("truncated_above_2_to_100", "7.5.3", "the lowest float above 2^100",
              replaced(Stream(3, 2, 0, [[0, 0, 1]], origin=(2.0 ** 100,))))
    must_fail("truncated_integer_of_25_bits", "7.5", "2^24 units in the last place of 1",
              replaced(Stream(3, 2, 0, [[0, 1 << 24, 0]], origin=(1.0,))))
    must_fail("rotation_without_w", "7.5.5", "x^2 = 2^-2e",
           replaced(Stream(7, 4, -4, [[16, 0, 0], [0, 0, 0], [0, 0, 0]])))
    must_fail("morton_overflow", "7.4", "a key of 2^63", replaced(
        Stream(1, 1, 0, [[0, 1, 0]], 3, bits=(8,)), first_key=(1 << 63) - 1))
    must_fail("moment_beyond_24_bits", "7.5.8", "a sum of 2^24 in a slot",
           File([Part([Segment(0, 4, [own_body(
               [Stream(2, 7, -3, [[(1 << 24) - 1, 0, 0]]) if s.attribute == 2 else s
                for s in float_streams(3, 0, 1)], 3)])])]))
    for name, attribute, about, value in (
            ("not_a_number", 6, "a log-scale", float("nan")), ("sigma_0", 3, "a sigma of 0", 0.0),
            ("radius_below_0", 4, "a radius of -1", -1.0)):
        streams = float_streams(3, 0, 1)
        streams[attribute - 1].v[0][1] = bits_of(value)
        must_fail(name, "6.4", about, plain(body=Body(streams, 3)))
    streams = float_streams(3, 0, 1)
    for row in streams[6].v:
        row[2] = 0
    must_fail("quaternion_0", "6.4", "a quaternion of length 0", plain(body=Body(streams, 3)))
    must_fail("importance_size", "5.11", "one importance too few",
           plain(tail=record(b"IMPO", struct.pack("<2f", 1, 1), 0)))
    must_fail("importance_below_0", "5.11", "an importance of -1",
           plain(tail=record(b"IMPO", struct.pack("<3f", 1, 1, -1), 0)))


def broken_rans():
    def opacity(stored_group=None):
        streams = float_streams(3, 0, 1)
        streams[7] = Stream(8, 1, 0, [[0, 1, 2]], 0, RANS, (2,))
        return own_body(streams, 3, group=stored_group)

    good = opacity()
    table = table_bytes(good.tables[0])
    valid = group([bytes([0, 1, 2])], [good.tables[0]], 3)
    words, state = struct.unpack_from("<II", valid)
    must_fail("group_cut", "A.6", "the last word is missing", plain(body=opacity(valid[:-2])))
    must_fail("group_without_sizes", "A.6", "three bytes", plain(body=opacity(valid[:3])))
    must_fail("state_too_low", "A.4", "a state of 65535",
           plain(body=opacity(struct.pack("<II", words, 65535) + valid[8:])))
    must_fail("word_left", "A.5", "one word more than is read",
           plain(body=opacity(struct.pack("<II", words + 1, state) + valid[8:] + b"\0\0")))
    constant = Stream(8, 1, -2, [[5, 5, 5]], 0, RANS)
    for name, about, size, first in (("no_planes_state", "a state of 65537 in a group of no planes", 0, 65537),
                                     ("no_planes_word", "a word in a group of no planes", 1, 65536)):
        must_fail(name, "A.5", about, replaced(constant, group=struct.pack("<2I", size, first) + bytes(2 * size)))
    must_fail("last_state", "A.5", "a block that ends with another state",
           plain(body=opacity(struct.pack("<II", words, state + 4096) + valid[8:])))
    must_fail("table_sum", "A.2", "frequencies that add up to more than 4096",
           plain(body=Patched(good, table, bytes([2]) + b"\xff" * 6)))
    must_fail("table_padding", "A.2", "a nonzero bit after a table", plain(
        body=Patched(good, table, flipped(table, len(table) - 1, 128))))
    streams = float_streams(3, 0, 1)
    streams.append(Stream(0x8001, 0, 0, [[0, 0, 0]], 0, RANS, (8,)))
    must_fail("optional_rans", "6.5", "an optional stream with coder rANS",
           plain(body=own_body(streams, 3)))
    row = good.streams[7].row()
    must_fail("table_not_there", "6.3", "table 1 of 1",
              plain(body=Patched(good, row, row[:-2] + b"\1\0")))
