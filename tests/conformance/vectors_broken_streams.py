# SPDX-License-Identifier: Apache-2.0
"""Integers and values that are out of range (8, 6.3), and the limits of readers (conformance.md 1.5)."""
import struct

from vector_file import File, Link, Meta, Node, Run, Segment, copy_record
from vector_growing import Fragment, growing
from vector_list import coded, flipped, must_fail, must_report, plain, replaced, separate_sh, vector
from vector_records import RANS, Body, Stream, bits_of, layouts_payload, record
from vector_scenes import coded_streams, float_streams, own_body
from vectors_growing import fragment_sizes, many, recorded
from vectors_index import tree

NEGATIVE = 1 << 32


def broken_streams():
    integers()
    values()
    limits()
    limits_of_index()


def integers():
    for name, about, opacity in (
            ("integer_of_25_bits", "2^24", Stream(8, 1, -24, [[0, 1 << 24, 0]])),
            ("integer_of_minus_2_to_24", "-2^24", Stream(8, 1, -24, [[0, NEGATIVE - (1 << 24), 0]])),
            ("integer_of_minus_2_to_31", "-2^31", Stream(8, 1, -24, [[0, 1 << 31, 0]])),
            ("multiplied_integer", "3 * 5592406 = 2^24 + 2", Stream(8, 1, -24, [[0, 5592406, 0]], m=3)),
            ("delta_out_and_back", "one sum has more than 24 bits", Stream(8, 1, -20, [[10, 0xFFFFFFFF, 0xFFFFFFFF]], 2))):
        must_fail(name, "8.5", about, replaced(opacity))
    for i, name in enumerate("yog"):
        for sign, value in (("", 1 << 22), ("minus_", NEGATIVE - (1 << 22))):
            rows = [[0] * 3, [0] * 3, [0] * 3]
            rows[i] = [0, value, 0]
            must_fail(f"colour_{name}_{sign}2_to_22", "8.5", f"{name} of {sign.replace('_', ' ')}2^22",
                      replaced(Stream(9, 5, -24, rows)))
    must_fail("multiplied_colour", "8.5", "3 * 1398102 = 2^22 + 2", replaced(
        Stream(9, 5, -24, [[1398102, 0, 0], [0] * 3, [0] * 3], m=3)))
    keys = dict(bits=(8, 8, 8, 8))
    for name, about, v, key in (("first_key_of_31_bits", "a first key of 2^30", [0, 0, 0], 1 << 30),
                                ("key_of_31_bits", "the last key is 2^30", [0, 0, 1], (1 << 30) - 1),
                                ("keys_wrap", "a difference of 2^32 - 1", [0, 0xFFFFFFFF, 0], 5),
                                ("keys_out_and_back", "a difference of 2^32 - 2^29", [0, 1, NEGATIVE - (1 << 29)], 1 << 29)):
        must_fail(name, "8.4", about, replaced(Stream(1, 1, 0, [v], 3, **keys), first_key=key))
    must_fail("multiplied_key", "8.5", "a coordinate of 2^10 - 1 and 14 low bits, in steps of 3", replaced(
        Stream(1, 1, 0, [[0, 1, 0], [5] * 3, [5] * 3, [5] * 3], 3, RANS, (8,), low=14, m=3), first_key=(1 << 30) - 7))
    must_fail("wide_low", "8.5", "a low component of 2^16 - 1 on top of the last key of 14 low bits", replaced(
        Stream(1, 1, 0, [[0, 1, 0]] * 4, 3, RANS, (8,), low=14, digits=[bytes([0, 1, 0])] + [bytes([255] * 3)] * 6),
        first_key=(1 << 30) - 7))
    for name, about, sigma in (
            ("truncated_minus_1", "q = -1", Stream(3, 2, 18, [[1, 1, 0xFFFFFFFF]], origin=(1.0,))),
            ("truncated_infinite", "the bits of an infinity", Stream(3, 2, 23, [[0, 0, 128]], origin=(1.0,))),
            ("truncated_above_2_to_100", "the lowest float above 2^100", Stream(3, 2, 0, [[0, 0, 1]], origin=(2.0 ** 100,))),
            ("truncated_wraps", "a sum of 2^32 and 0.5", Stream(3, 2, 23, [[0, 512, 1]], origin=(0.5,))),
            ("truncated_of_25_bits", "2^24 units in the last place", Stream(3, 2, 0, [[0, 1 << 24, 0]], origin=(1.0,)))):
        must_fail(name, "8.5", about, replaced(sigma))
    for name, e, rows in (("x", -4, [[16, 0, 0], [0] * 3, [0] * 3]), ("minus_x", -4, [[NEGATIVE - 16, 0, 0], [0] * 3, [0] * 3]),
                          ("coarsest", -1, [[2, 0, 0], [0] * 3, [0] * 3]), ("beyond", -14, [[9460, 0, 0]] * 3),
                          ("wraps", -14, [[1 << 16, 0, 0], [0] * 3, [0] * 3])):
        must_fail(f"rotation_without_w_{name}", "8.7", f"R is not above 0, e = {e}", replaced(Stream(7, 4, e, rows)))
    must_fail("rotation_multiplied_without_w", "8.7", "5 * 4 = 20 > 16", replaced(Stream(7, 4, -4, [[4, 0, 0], [0] * 3, [0] * 3], m=5)))
    scale = Stream(6, 1, -3, [[0, 0, 0]] * 3)
    must_fail("shaped_without_w", "8.7", "a round primitive, 3 bits coarser", replaced(
        Stream(7, 6, -8, [[31, 32, 0], [0] * 3, [0] * 3]), scale))
    needle = Stream(6, 1, -3, [[0, 41, 0], [0] * 3, [0] * 3])
    vector("shaped_with_w", "8.8", "a needle, 3 bits finer", replaced(Stream(7, 6, -5, [[0, 255, 0], [0] * 3, [0] * 3]), needle))
    must_fail("needle_without_w", "8.7", "a needle, 3 bits finer", replaced(
        Stream(7, 6, -5, [[0, 256, 0], [0] * 3, [0] * 3]), needle))
    must_fail("time_of_25_bits", "8.5", "q = 2^24", replaced(Stream(2, 7, -20, [[1 << 24, 0, 0]])))


def values():
    nan, infinite = float("nan"), float("inf")
    for name, clause, attribute, component, value in (
            ("nan", "6.3", 6, 0, nan), ("infinite", "6.3", 1, 2, infinite), ("infinite_below", "6.3", 8, 0, -infinite),
            ("sigma_0", "6.3", 3, 0, 0.0), ("sigma_below_0", "6.3", 3, 0, -1.0), ("sigma_minus_0", "6.3", 3, 0, -0.0),
            ("radius_below_0", "6.3", 4, 0, -2.0 ** -140), ("sigma_infinite", "6.3", 3, 0, infinite)):
        streams = float_streams(3, 0, 1)
        streams[attribute - 1].v[component][1] = bits_of(value)
        must_fail(f"value_{name}", clause, f"attribute {attribute} is {value}", plain(body=Body(streams, 3)))
    for name, bits in (("0", 0), ("minus_0", 0x80000000)):
        streams = float_streams(3, 0, 1)
        for row in streams[6].v:
            row[2] = bits
        must_fail(f"quaternion_{name}", "6.3", "a quaternion of length 0", plain(body=Body(streams, 3)))
    must_fail("sigma_truncated_0", "6.3", "sigma with mapping 2: 0.5 - 0.5", replaced(
        Stream(3, 2, 20, [[1, 0, 2]], origin=(0.5, 0.5))))
    must_fail("sigma_truncated_below_0", "6.3", "sigma with mapping 2: 0.5 - 0.75", replaced(
        Stream(3, 2, 20, [[4, 0, 8]], origin=(0.5, 0.75))))
    must_fail("radius_truncated_below_0", "6.3", "radius with mapping 2: 0.5 - 0.75", replaced(
        Stream(4, 2, 20, [[4, 0, 8]], origin=(0.5, 0.75))))
    vector("radius_truncated_0", "6.3", "radius with mapping 2: 0.5 - 0.5", replaced(
        Stream(4, 2, 20, [[1, 0, 2]], origin=(0.5, 0.5))))
    vector("sigma_truncated_from_below_0", "8.5", "sigma with mapping 2 and origin[1] = -0.25", replaced(
        Stream(3, 2, 20, [[1, 0, 2]], origin=(0.5, -0.25))), floats=True)
    rest = float_streams(3, 1, 1, which="rest")
    rest[1].v[0][1] = bits_of(nan)
    must_fail("value_nan_of_sh", "6.3", "a coefficient of a record of content 1: the other attributes are decoded", File(
        [Run([separate_sh(rest=rest)])], Meta(profile=0, degree=1)))


def both_sides(name, about, limit, file, clause="conformance 1.5", key="max_memory"):
    """Adds a vector at a limit, and one that exceeds it."""
    vector(f"limit_of_{name}_kept", clause, f"{about}, at the limit", file, {key: limit})
    must_fail(f"limit_of_{name}", clause, f"{about}, more than the limit", file, {key: limit - 1})


def limits():
    record_bytes = 24 + len(plain().root[0].segments[0].payloads()[0])
    # 3 primitives with 80 bytes of floats and 80 bytes of planes each.
    both_sides("planes", "a tier's floats, bytes and planes", 480 + record_bytes, plain().bytes())
    sh = File([Run([separate_sh()])], Meta(profile=0, degree=1))
    sizes = [24 + len(p) for p in sh.root[0].segments[0].payloads()]
    both_sides("sh", "a tier's floats, bytes and planes of both records", 3 * 4 * 29 + sum(sizes) + 3 * (80 + 37), sh.bytes())
    must_fail("limit_of_base", "conformance 1.5", "a tier's record of content 0, more than the limit", sh,
              {"max_memory": 3 * 4 * 29 + sizes[0] + 3 * 80 - 1})
    own = coded()
    tables = len(own.root[0].segments[0].tiers[0].tables)
    planes = sum(len([t for t in s.tables if len(own.root[0].segments[0].tiers[0].tables[t]) > 1])
                 for s in own.root[0].segments[0].tiers[0].streams)
    size = 24 + len(own.root[0].segments[0].payloads()[0])
    both_sides("own_tables", "tables of a record", 5 * 80 + size + 16384 * tables + 5 * planes, own.bytes())
    optional = float_streams(3, 0, 1)
    optional[8] = Stream(9, 1, 0, [[5] * 3] * 3, 0, RANS, (8,))
    optional.append(Stream(0x8001, 0, 0, [[0] * 3], stored=bytes(100)))
    body = own_body(optional, 3)
    file = plain(body=body)
    both_sides("optional_planes", "a tier with planes that take no memory", 240 + 24 + len(body.payload(-1, 0, 0)) +
               16384 + 3 * 17 * 4, file.bytes())
    streams = coded_streams(4, 3, 9, degrees=[3, 0, 1, 2])
    body = own_body(streams, 4)
    file = File([Run([Segment(-1, 0, [body])])], Meta(degree=3))
    symbols = sum({11: 3, 12: 2, 13: 1}.get(s.attribute, 4) for s in streams for t in s.tables if len(body.tables[t]) > 1)
    both_sides("sh_planes", "planes of fewer symbols than primitives", 4 * 4 * 65 + 24 + len(body.payload(-1, 0, 0)) +
               16384 * len(body.tables) + symbols, file.bytes())
    layt = layouts_payload([{0: 2048, 1: 2048}] * 2, [float_streams(3, 0, 1)])
    both_sides("tables", "two tables of LAYT", 32768, plain(layouts=layt).bytes())
    head_bytes = struct.unpack_from("<I", plain(n=1, last_records=long_note()).bytes(), 24)[0]
    both_sides("head", "the head", head_bytes, plain(n=1, last_records=long_note()).bytes())
    damaged = flipped(plain(n=1, copy=copy_record, last_records=long_note()).bytes(), 3)
    must_report("limit_of_a_copied_head_kept", "10.2", "a head from its copy, at the limit", damaged, limits={"max_memory": head_bytes})
    must_fail("limit_of_a_copied_head", "conformance 1.5", "a head from its copy, more than the limit", damaged,
              {"max_memory": head_bytes - 1})
    both_sides("rows", "1,275 rows of 5 layouts", 128 * 256, plain(layouts=many_rows(5)).bytes())
    both_sides("layouts", "1,280 layouts of no rows", 128 * 256,
               plain(layouts=struct.pack("<HH", 0, 1280) + bytes(1280)).bytes())
    both_sides("primitives", "3 primitives", 3, plain().bytes(), key="max_primitives")
    must_fail("limit_of_stated_primitives", "conformance 1.5", "INDX states 4 primitives", plain(total=4), {"max_primitives": 3})
    must_fail("limit_of_listed_primitives", "conformance 1.5", "INDX states 1 primitive and lists 3", plain(total=1),
              {"max_primitives": 2})


def long_note():
    return record(b"NOTE", bytes(600), 0)


def many_rows(layouts):
    """Returns a LAYT with layouts of 255 rows of unknown attributes."""
    row = struct.pack("<HHBBB", 5, 0x8000, 1, 0, 0)
    return struct.pack("<HH", 0, layouts) + layouts * (bytes([255]) + 255 * row)


def limits_of_index():
    both_sides("entries", "1,293 entries of nodes", 512 * 269, many_entries())
    pages = File(tree(extra=bytes(1500))[0], Meta(profile=0)).bytes()
    sizes = [struct.unpack_from("<Q", pages, i + 8)[0] for i in range(len(pages)) if pages.startswith(b"PAGE", i)]
    both_sides("pages", "the payloads of three PAGE records", sum(sizes), pages)
    made = many(17)
    sizes = fragment_sizes(made.out)
    vector("limit_of_fragments_kept", "conformance 1.5", "the payloads of 17 FRAG records, at the limit", made.out,
           {"max_memory": sum(sizes)})
    must_fail("limit_of_fragments", "conformance 1.5", "the payloads of 17 FRAG records, more than the limit", made.out,
              {"max_memory": sum(sizes) - 1})
    lost = flipped(made.out, made.offsets[15] + 60)
    vector_sizes = sum(sizes)
    for name, more in (("kept", 0), ("", -1)):
        must_fail(f"limit_of_fragments_instead_{name}".rstrip("_"), "9.5" if more == 0 else "conformance 1.5",
                  "the payloads of 17 FRAG records, of which one is damaged", lost, {"max_memory": vector_sizes + more})
    # 9.5: fragment 3 is lost, the search examines it and finds fragment 2.
    large = growing([*recorded(2), Fragment(recorded(3)[2].runs, extra=bytes(3000)), *recorded(4)[3:]])
    offsets = [i for i in range(len(large)) if large.startswith(b"FRAG", i)]
    lost = flipped(large, offsets[2] + 60)
    must_fail("fragment_large_damaged", "9.5", "a large FRAG record is damaged", lost)


def many_entries():
    """Returns a file of two nodes with a link, and 2 segments of one tier and 321 further records each."""
    def run(part):
        return Run([Segment(level, 0, [Body(float_streams(1, 0, 1), 1, layout=0)], further=[(1024 + j, b"") for j in range(321)])
                    for level in (-1, 0)], part=part)
    layt = struct.pack("<HH", 0, 1) + b"\x09" + b"".join(s.row() for s in float_streams(1, 0, 1))
    return File(Node([run(0)], [Link(Node([run(1)]))]), Meta(profile=0), layouts=layt).bytes()
