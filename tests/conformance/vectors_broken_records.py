# SPDX-License-Identifier: Apache-2.0
"""Records and layouts that break a rule (6)."""
import struct

from vector_file import File, Meta, Run, Segment
from vector_list import changed, must_fail, plain, replaced, separate_sh, vector
from vector_records import RANS, Body, Stream, layouts_payload
from vector_scenes import coded_streams, float_streams, own_body
from vectors_broken_groups import sum_of_4096

NAN = float("nan")


def broken_records():
    fields()
    layouts()
    rows()
    joins()
    attributes()
    units()


def with_segment(**more):
    file = plain()
    for key, value in more.items():
        setattr(file.root[0].segments[0], key, value)
    return file


def fields():
    for name, clause, flags in (("not_critical", "3.3", 0), ("flags_3", "3.4", 3), ("flags_2", "3.3", 2)):
        must_fail(f"segment_{name}", clause, f"SEGM with flags {flags}", with_segment(flags=flags))
    must_fail("segment_tag", "5.3", "a record of another tag", with_segment(tag=b"SEGN"))
    for name, stated in (("level", (0, 0)), ("slot", (-1, 1))):
        must_fail(f"segment_states_another_{name}", "6.5", f"the record states another {name}", with_segment(stated=stated))
    short = with_segment(more=1)
    short.tail = b"\0"
    must_fail("segment_shorter", "5.3", "the index lists a byte more than the record has", short)
    long = with_segment(more=-1)
    must_fail("segment_longer", "5.3", "the index lists a byte less than the record has", long, clause_of="3.2")
    must_fail("segment_states_another_tier", "6.5", "the record of the second tier states the first", File(
        [Run([Segment(-1, 0, [Body(float_streams(1, 0, 3), 1), FirstTier(float_streams(1, 0, 4), 1)])])], Meta(profile=0)))
    for n in (2, 4):
        must_fail(f"segment_states_{n}_of_3", "6.5", f"the index lists {n} primitives, the record 3", with_segment(counts=[n]))
    rest = separate_sh()
    rest.sh[0].n = 2
    must_fail("sh_states_2_primitives", "6.5", "the record of content 1 states 2 of 3 primitives", File(
        [Run([rest])], Meta(profile=0, degree=1)))
    for size in (7, 11, 13):
        must_fail(f"segment_of_{size}_bytes", "6.5", f"a payload of {size} bytes", plain(body=Cut(float_streams(1, 0, 1), 1, size)))


class FirstTier(Body):
    def payload(self, level, layer, slot):
        return super().payload(level, 0, slot)


class Cut(Body):
    """A payload that is cut off after `size` bytes; the index lists as many primitives as it has bytes."""

    def __init__(self, streams, n, size):
        super().__init__(streams, n)
        self.size = size

    def payload(self, level, layer, slot):
        return super().payload(level, layer, slot)[:self.size]


def layouts():
    streams = float_streams(3, 0, 1)
    must_fail("layout_without_layt", "6.5", "layout 0 without LAYT", plain(body=Body(streams, 3, layout=0)))
    layt = layouts_payload([], [streams])
    must_fail("layout_1_of_1", "6.5", "layout 1 of LAYT, which has one", plain(body=Body(streams, 3, layout=1), layouts=layt))
    must_fail("two_own_layouts", "6.1", "two layouts in a record", plain(body=Body(streams, 3, own_layouts=2)))
    must_fail("no_own_layout", "6.1", "no layout in a record", plain(body=Body(streams, 3, own_layouts=0)))
    bad = Stream(1, 0, 0, [[0]] * 3, m=2)
    layt = struct.pack("<HH", 0, 2) + b"\1" + bad.row() + b"\x09" + b"".join(s.row() for s in streams)
    both = [Segment(0, 2 * i, [Body(float_streams(3, 0, 1, 5 * i, 5), 3, layout=i)]) for i in (0, 1)]
    must_fail("bad_layout", "8.5", "a row with m = 2 in one of two layouts: one of two records is decoded",
              File([Run(both)], Meta(profile=0), layouts=layt))
    vector("bad_layout_unused", "6.2", "a row with m = 2 in a layout that no record uses",
           File([Run(both[1:])], Meta(profile=0), layouts=layt), validator=[404])
    whole = layouts_payload([{0: 2048, 3: 2048}], [streams])
    for name, data in (("empty", b""), ("in_tables", whole[:3]), ("before_layouts", whole[:7]), ("in_a_row", whole[:-1]),
                       ("before_rows", whole[:10]), ("in_a_row_size", whole[:11])):
        must_fail(f"layt_cut_{name}", "6.1", f"LAYT of {len(data)} bytes", plain(layouts=data))
    must_fail("tables_1025", "6.1", "1025 tables", plain(layouts=struct.pack("<H", 1025) + bytes(1025) + struct.pack("<H", 0)))
    vector("tables_1024", "6.1", "1024 tables", plain(layouts=struct.pack("<H", 1024) + bytes(1024) + struct.pack("<H", 0)))
    vector("layouts_65534", "6.1", "65534 layouts, the last of which is used", plain(body=Body(streams, 3, layout=65533), layouts=
           struct.pack("<HH", 0, 65534) + bytes(65533) + b"\x09" + b"".join(s.row() for s in streams)))
    layt = layouts_payload([{0: 4096}], [streams[:7] + [Stream(8, 1, 0, [[0]], 0, RANS, (2,), tables=[1])] + streams[8:]])
    must_fail("layt_table_1_of_1", "6.2", "a layout of LAYT with table 1 of 1", plain(body=Body(streams, 3, layout=0), layouts=layt))
    two = Stream(8, 1, 0, [[0]], 0, RANS, (2, 2), tables=[0, 1])
    layt = layouts_payload([{0: 4096}], [streams[:7] + [two] + streams[8:]])
    must_fail("layt_tables_0_and_1_of_1", "6.2", "a layout of LAYT with tables 0 and 1 of 1", plain(
        body=Body(streams, 3, layout=0), layouts=layt))
    must_fail("layouts_65535", "6.1", "65535 layouts", plain(layouts=struct.pack("<HH", 0, 65535) + bytes(65535)))
    coded = float_streams(3, 0, 1)
    coded[7] = Stream(8, 1, 0, [[0, 1, 2]], 0, RANS, (2,))
    must_fail("own_table_unused", "6.1", "a table of a record that no plane uses", plain(body=own_body(coded, 3, more_tables=1)))
    must_fail("own_tables_257", "6.1", "257 tables in a record", plain(body=own_body(coded, 3, more_tables=256)))
    for name, table in (("sum", bytes([2]) + b"\xff" * 6), ("sum_of_4096", sum_of_4096())):
        must_fail(f"layt_table_{name}", "7.2", "LAYT with an invalid table: the file is refused",
                  plain(layouts=struct.pack("<H", 1) + table + struct.pack("<H", 0)))


def rows():
    for name, clause, about, row in (
            ("unknown_mapping", "6.2", "mapping 9", dict(mapping=9)), ("unknown_mapping_255", "6.2", "mapping 255", dict(mapping=255)),
            ("unknown_prediction", "6.2", "prediction 4", dict(prediction=4)), ("unknown_coder", "6.2", "coder 3", dict(coder=3)),
            ("row_of_4_bytes", "6.2", "a row that ends before its coder", dict(length=4)),
            ("row_of_5_bytes", "6.2", "a row that ends with its coder", dict(length=5)),
            ("row_cut_in_fields", "6.2", "a row that ends within its fields", dict(length=10)),
            ("row_cut_in_bits", "6.2", "a row that ends within its digits", dict(length=14)),
            ("row_cut_in_origin", "6.2", "a row that ends within its origin", dict(origin=(1.0,), length=17)),
            ("row_beyond_the_layout", "6.5", "a row longer than the remaining bytes", dict(length=65535)),
            ("multiplier_3_of_floats", "8.5", "mapping 0 with m = 3", dict(m=3)),
            ("prediction_1_of_floats", "8.5", "mapping 0 with prediction 1", dict(prediction=1)),
            ("exponent_of_floats_below_0", "8.5", "mapping 0 with e = -1", dict(e=-1)),
            ("exponent_21_of_floats", "8.5", "mapping 0 with e = 21", dict(e=21)),
            ("origin_of_floats", "8.5", "mapping 0 with an origin of 2^-101", dict(origin=(2.0 ** -101,))),
            ("multiplier_0", "8.5", "m = 0", dict(mapping=1, m=0)), ("multiplier_2", "8.5", "m = 2", dict(mapping=1, m=2)),
            ("exponent_minus_101", "8.5", "e = -101", dict(mapping=1, e=-101)), ("exponent_101", "8.5", "e = 101", dict(mapping=1, e=101)),
            ("origin_too_small", "8.5", "an origin below 2^-100", dict(mapping=1, origin=(2.0 ** -100 * (1 - 2.0 ** -24),))),
            ("origin_too_great", "8.5", "an origin above 2^100", dict(mapping=1, origin=(-2.0 ** 100 * (1 + 2.0 ** -23),))),
            ("origin_not_a_number", "8.5", "an origin that is not a number", dict(mapping=1, origin=(0.0, NAN))),
            ("origin_infinite", "8.5", "an infinite third number of the origin", dict(mapping=1, origin=(0.0, 0.0, float("inf")))),
            ("origin_of_4", "6.2", "an origin of 4 numbers", dict(mapping=1, origin=(1.0,) * 4)),
            ("mapping_4_of_opacity", "8.5", "an opacity with mapping 4", dict(mapping=4, e=-4)),
            ("mapping_2_of_opacity", "8.5", "an opacity with mapping 2", dict(mapping=2, origin=(1.0,))),
            ("mapping_8_of_opacity", "8.5", "an opacity with mapping 8", dict(mapping=8)),
            ("low_without_morton", "6.2", "low = 4 with prediction 0", dict(mapping=1, low=4)),
            ("morton_of_opacity", "8.3", "an opacity with prediction 3", dict(mapping=1, prediction=3)),
            ("joins_2", "6.2", "joins = 2", dict(joins=2)),
            ("no_digits", "6.2", "0 digits", dict(bits=(), v=[[0] * 3])),
            ("digit_of_9_bits", "6.2", "a digit of 9 bits", dict(bits=(9,), coder=RANS, v=[[0] * 3])),
            ("digit_of_0_bits", "6.2", "a digit of 0 bits", dict(bits=(8, 0), coder=RANS, v=[[0] * 3])),
            ("bytes_of_4_bits", "8.1", "coder 0 with digits of 4 bits", dict(mapping=1, bits=(4, 4), v=[[0] * 3])),
            ("planes_beyond_floats", "8.1", "81 planes for 80 bytes of floats", dict(bits=(7, 7, 7, 7, 4), coder=RANS, v=[[0] * 3]))):
        must_fail(name, clause, about, changed(8, **row))
    for name, attribute, row in (("linear_time", 2, dict(mapping=1)), ("linear_sigma", 3, dict(mapping=1)),
                                 ("linear_velocity", 5, dict(mapping=1)), ("linear_rotation", 7, dict(mapping=1)),
                                 ("truncated_time", 2, dict(mapping=2, origin=(1.0,))), ("displacement_of_position", 1, dict(mapping=3)),
                                 ("colour_of_position", 1, dict(mapping=5)), ("time_of_sigma", 3, dict(mapping=7)),
                                 ("rotation_of_velocity", 5, dict(mapping=6, e=-4, v=[[0] * 3] * 3))):
        must_fail(name, "8.5", f"attribute {attribute} with mapping {row['mapping']}", changed(attribute, **row))
    for name, about, row in (("truncated_from_0", "mapping 2 without an origin", dict(mapping=2, e=20)),
                             ("truncated_below_0", "mapping 2 from an origin of -1", dict(mapping=2, e=20, origin=(-1.0,))),
                             ("truncated_e_24", "mapping 2 with e = 24", dict(mapping=2, e=24, origin=(1.0,))),
                             ("truncated_e_minus_1", "mapping 2 with e = -1", dict(mapping=2, e=-1, origin=(1.0,)))):
        must_fail(name, "8.5", about, changed(3, **row))
    for mapping in (4, 6):
        for e in (0, -15):
            scale = Stream(6, 1, -3, [[1, 2, 3]] * 3)
            must_fail(f"mapping_{mapping}_e_{-e}", "8.5", f"mapping {mapping} with e = {e}",
                      replaced(Stream(7, mapping, e, [[0] * 3] * 3), scale))
    for name, about, scale in (("floats", "log-scales with mapping 0", None),
                               ("origins", "log-scales with different origins", Stream(6, 1, -3, [[1, 2, 3]] * 3, origin=(1.0, 1.0, 2.0))),
                               ("two_origins", "log-scales with an origin of two numbers", Stream(6, 1, -3, [[1, 2, 3]] * 3, origin=(1.0, 1.0)))):
        must_fail(f"shaped_with_{name}", "8.8", f"mapping 6 and {about}", replaced(
            Stream(7, 6, -9, [[0] * 3] * 3), *([scale] if scale else [])))
    for name, bits in (("digits_9", (1,) * 9), ("digits_of_33_bits", (8, 8, 8, 8, 1))):
        many = coded_streams(3, 0, 2)
        many[7] = Stream(8, 1, -20, [[0, 0, 0]], 0, RANS, bits)
        must_fail(name, "6.2", f"digits of {bits} bits", plain(body=own_body(many, 3), meta=Meta()))
    low = [[0] * 3] * 4
    must_fail("morton_low_15", "8.4", "15 low bits", replaced(Stream(1, 1, -10, low, 3, RANS, (8,), low=15)))
    must_fail("morton_low_4_in_bytes", "8.1", "coder 0 with 4 low bits", replaced(Stream(1, 1, -10, low, 3, bits=(8,), low=4)))
    must_fail("morton_of_floats", "8.5", "positions with mapping 0 and prediction 3", replaced(Stream(1, 0, 0, low[:1], 3)))
    must_fail("morton_of_scales", "8.3", "log-scales with prediction 3", replaced(Stream(6, 1, 0, low[:1], 3)))
    for name, degree in (("e_1", dict(e=1)), ("m_3", dict(m=3)), ("prediction_1", dict(prediction=1)), ("mapping_0", dict(mapping=0)),
                         ("mapping_1", dict(mapping=1)), ("e_minus_1", dict(e=-1))):
        must_fail(f"sh_degree_{name}", "8.5", f"sh_degree with {name.replace('_', ' ')}", changed(10, degree=1, **degree))
    must_fail("mapping_5_of_sh_degree", "8.5", "sh_degree with mapping 5", changed(10, degree=1, mapping=5))


def joins():
    def of(degree=1, **numbers):
        streams = coded_streams(6, degree, 7)
        for s in streams:
            s.joins = numbers.get(f"a{s.attribute}", 0)
        return File([Run([Segment(-1, 0, [own_body(streams, 6)])])], Meta(degree=degree))

    must_fail("joins_nothing", "6.5", "the first row joins", of(a1=1))
    must_fail("joins_2_coded", "6.2", "joins = 2 of a coded stream", of(a3=2))
    must_fail("sh1_joins", "6.5", "sh1 joins", of(a11=1))
    must_fail("sh2_joins", "6.5", "sh2 joins sh1", of(2, a12=1))
    must_fail("sh3_joins", "6.5", "sh3 joins sh2", of(3, a13=1))
    streams = coded_streams(6, 1, 7)
    streams[9], streams[10] = streams[10], streams[9]
    streams[10].joins = 1
    must_fail("joins_after_sh1", "6.5", "sh_degree stands after sh1 and joins it", plain(body=own_body(streams, 6), degree=1))
    streams = coded_streams(6, 0, 7)
    streams[1] = Stream(2, 7, -3, [[20, 21, 22, 23, 24, 25]], bits=(8,))
    streams[2].joins = 1
    must_fail("joins_bytes", "6.5", "a stream joins one that is not coded", plain(body=own_body(streams, 6), meta=Meta()))
    streams = coded_streams(6, 0, 7)
    streams[1] = Stream(2, 7, -3, [[20, 21, 22, 23, 24, 25]], bits=(8,), joins=1)
    must_fail("bytes_join", "6.5", "a stream of bytes joins", plain(body=own_body(streams, 6), meta=Meta()))
    streams = coded_streams(6, 0, 7)
    streams[2].joins = 1
    streams.insert(2, Stream(0x8001, 0, 0, [[]], stored=b"any"))
    must_fail("joins_optional", "6.5", "a stream joins an optional one", plain(body=own_body(streams, 6), meta=Meta()))


def attributes():
    streams = float_streams(3, 0, 1)
    for name, about, changed_streams in (
            ("missing", "no radius", streams[:3] + streams[4:]), ("out_of_order", "time before position",
             [streams[1], streams[0]] + streams[2:]), ("twice", "two opacities", streams[:8] + streams[7:]),
            ("none", "no rows", []), ("last_missing", "no sh0", streams[:8])):
        must_fail(f"attribute_{name}", "6.3", about, plain(body=Body(changed_streams, 3), meta=Meta(profile=0)))
    for number in (0, 14, 16, 0x7FFF):
        must_fail(f"attribute_{number}", "6.2", f"attribute {number}", plain(body=Body(
            streams + [Stream(number, 0, 0, [[0, 0, 0]])], 3), meta=Meta(profile=0)))
    degree_1 = float_streams(3, 1, 1)
    must_fail("sh_of_another_degree", "6.3", "SH of degree 1 in a file of degree 0", plain(
        body=Body(degree_1, 3, degrees=[]), meta=Meta(profile=0)))
    must_fail("sh_nowhere", "6.3", "SH neither in the record nor apart", plain(
        body=Body(float_streams(3, 1, 1, which="base"), 3), degree=1))
    must_fail("sh_degree_missing", "6.3", "no sh_degree", plain(body=Body(streams + degree_1[10:], 3), degree=1))
    must_fail("sh2_missing", "6.3", "no sh2 in a file of degree 2", plain(body=Body(degree_1, 3, degrees=[3, 3]), degree=2))
    both = Segment(-1, 0, [Body(degree_1, 3)], [Body(float_streams(3, 1, 1, which="rest"), 3)])
    must_fail("sh_twice", "6.3", "SH in both records", File([Run([both])], Meta(profile=0, degree=1)))
    rest = float_streams(3, 1, 1, which="rest")
    for name, about, wrong in (("all", "all attributes in the record of content 1", degree_1), ("cut", "sh_degree alone", rest[:1]),
                               ("unknown", "an unknown mapping", [rest[0], Stream(11, 9, 0, rest[1].v)])):
        must_fail(f"sh_apart_{name}", "6.2" if name == "unknown" else "6.3", about + ": the other attributes are decoded", File(
            [Run([separate_sh(rest=wrong)])], Meta(profile=0, degree=1)))
    for name, degrees, values, clause in (("counts_ascend", [2, 3, 0], None, "6.5"), ("more_than_n", [4, 3, 3], None, "6.5"),
                                          ("counts_ascend_last", [3, 1, 2], None, "6.5"),
                                          ("degree_4", None, [3, 3, 4], "8.5")):
        wrong = float_streams(3, 3, 1)
        if values:
            wrong[9].v = [values]
        must_fail(f"sh_{name}", clause, f"n_1 to n_D are {degrees or [3, 3, 3]}, the degrees {values or [3, 3, 3]}",
                  plain(body=Body(wrong, 3, degrees=degrees), degree=3))
    for k, values in ((1, [3, 2, 0]), (2, [3, 1, 1]), (3, [2, 2, 1])):
        wrong = float_streams(3, 3, 1, degrees=[3, 2, 1])
        wrong[9].v = [values]
        must_fail(f"sh_other_count_of_{k}", "6.3", f"n_1 to n_3 are 3, 2, 1, the degrees {values}",
                  plain(body=Body(wrong, 3), degree=3))
    negative = float_streams(3, 1, 1)
    negative[9] = Stream(10, 8, 0, [[1, 1, 0xFFFFFFFF]])
    negative[10].v = [row[:2] for row in negative[10].v]
    must_fail("sh_degree_below_0", "8.5", "a degree of -1", plain(body=Body(negative, 3, degrees=[2]), degree=1))
    above = float_streams(3, 1, 1)
    above[9].v = [[1, 1, 2]]
    must_fail("sh_degree_above_d", "8.5", "a degree of 2 in a file of degree 1", plain(body=Body(above, 3), degree=1))
    must_fail("lossless_mapping", "11.1", "mapping 1 in a lossless file", replaced(
        Stream(8, 1, 0, [[0, 1, 2]]), meta=Meta(profile=0)))
    must_fail("lossless_exponent", "11.1", "mapping 0 with e = 1 in a lossless file", replaced(
        Stream(8, 0, 1, [[0, 1, 2]]), meta=Meta(profile=0)))
    extra = Stream(0x8001, 1, 3, [[1, 2, 3]], 0, 0, stored=b"any")
    vector("lossless_optional", "11.1", "an optional stream with mapping 1 in a lossless file",
           plain(body=Body(streams + [extra], 3), meta=Meta(profile=0)))


def units():
    streams = float_streams(3, 0, 1)
    for name, sizes in (("beyond", {8: 37}), ("far_beyond", {0: (1 << 32) - 1})):
        must_fail(f"unit_{name}", "6.5", "a unit is longer than the record", plain(body=Body(streams, 3, sizes=sizes)))
    whole = Body(streams, 3).payload(-1, 0, 0)
    must_fail("units_cut", "6.5", "the record ends within the sizes", plain(body=Cut(streams, 3, len(whole) - 36 * 4)))
    for name, size in (("short", 11), ("long", 13)):
        wrong = float_streams(3, 0, 1)
        wrong[7].stored = bytes(size)
        must_fail(f"unit_{name}", "6.4", f"{size} bytes for 4 planes of 3 bytes", plain(body=Body(wrong, 3)))
    empty = coded_streams(3, 2, 3, degrees=[1, 0, 1])
    empty[11].stored = b"\0"
    must_fail("unit_of_no_symbols", "7.1", "a byte in a group of planes of no symbols", File(
        [Run([Segment(-1, 0, [own_body(empty, 3)])])], Meta(degree=2)))
    must_fail("unit_of_no_planes", "7.1", "four bytes in a group of no planes", replaced(
        Stream(8, 1, -2, [[5, 5, 5]], 0, RANS, stored=bytes(4))))
    zero = float_streams(3, 2, 3, degrees=[1, 0, 1])
    zero[11].stored = b"\0"
    must_fail("unit_of_no_bytes", "6.4", "a byte in a stream of no symbols", plain(body=Body(zero, 3), degree=2))
    must_fail("first_key_cut", "6.5", "the record ends within its first key", plain(body=Cut(
        [Stream(1, 1, 0, [[1]], 3, bits=(8,))] + float_streams(1, 0, 1)[1:], 1, first_key_end())))


def first_key_end():
    streams = [Stream(1, 1, 0, [[1]], 3, bits=(8,))] + float_streams(1, 0, 1)[1:]
    whole = Body(streams, 1).payload(-1, 0, 0)
    units = sum(len(s.planes()) for s in streams)
    return len(whole) - units - 4 * len(streams) - 1
