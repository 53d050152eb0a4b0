# SPDX-License-Identifier: Apache-2.0
"""Violations of the container's rules: headers, heads, the index, limits (2 to 5)."""
import struct

from vector_file import (RANS, Body, File, Meta, Part, Segment, Stream, bits_of, layouts_payload, number,
                         record, text)
from vector_growing import Fragment, growing
from vector_list import coded, must_fail, plain, private, replaced, vector, flipped
from vector_scenes import float_streams
from vectors_growing import recorded_parts


def broken_rules():
    """One vector for each "must" that the others do not violate."""
    def one(level, slot, **more):
        return Segment(level, slot, [Body(float_streams(1, 0, 3), 1)], **more)

    must_fail("lossless_mapping", "8.1", "mapping 1 in a lossless file",
              replaced(Stream(8, 1, -2, [[0, 1, 2]]), meta=Meta(profile=0)))
    draco = Stream(1, 1, 0, [[0] * 3] * 3, 0, 2, (8, 8, 8), stored=b"DRACO")
    must_fail("draco_in_another_profile", "8.1", "coder 2 in a quantised file", replaced(draco))
    for tag, payload in ((b"LAYT", struct.pack("<HH", 0, 0)), (b"WNDW", struct.pack("<IIQQ", 0, 99, 1, 2)),
                         (b"INDX", File([]).index_payload())):
        twice = record(tag, payload, int(tag != b"WNDW"))
        must_fail(f"two_{tag.decode().lower()}", "2.3", f"{tag.decode()} twice",
                  plain(last_records=twice if tag == b"INDX" else twice + twice))
    must_fail("private_names_cut", "3.5", "a count of 2, one name",
              plain(last_records=record(b"PRIV", b"\2\0\0\0\1\xc0" + text("a"), 0)))
    must_fail("private_name_empty", "3.5", "no name", plain(last_records=private((0, 0xC001, ""))))
    must_fail("private_name_not_utf8", "3.5", "a name of \\xff",
              plain(last_records=private((0, 0xC001, b"\xff"))))
    must_fail("two_privs", "2.3", "PRIV twice", plain(last_records=private() + private()))
    must_fail("private_critical", "3.4", "a private record that is critical",
              plain(last_records=record(b"liGT", text("org.example.lights"))))
    must_fail("window_critical", "3.4", "WNDW with flags 1",
              plain(last_records=record(b"WNDW", struct.pack("<IIQQ", 0, 99, 1, 2))))
    must_fail("window_short", "4.5", "WNDW of 23 bytes", plain(last_records=record(b"WNDW", bytes(23), 0)))
    must_fail("bounds_inverted", "4.3", "a minimum above its maximum", plain(meta=Meta(
        profile=0, minimum=(1, 0, 0), maximum=(0, 0, 0))))
    for name, about, more in (("camera_size", "a start camera of 32769 pixels", dict(size=(32769, 4))),
                              ("camera_focal_length", "fx = 0", dict(lens=(0, 1, 0, 0)))):
        must_fail(name, "4.3", about, plain(meta=Meta(profile=0, **{"size": (4, 4), "lens": (1, 1, 0, 0),
                                                                    **more})))
    must_fail("totals_1025", "5.2", "1025 attribute totals", plain(totals=((1, 1),) * 1025))
    must_fail("total_of_attribute_65536", "5.2", "an attribute beyond 16 bits",
              plain(totals=((65536, 1),)))
    must_fail("slot_beyond_32_bits", "5.3", "slot 2^32", File(
        [Part([one(0, 0, raw_place=32 * (1 << 32) + 1)])], Meta(profile=0)))
    must_fail("tiers_257", "5.3", "257 tiers", plain(index=struct.pack("<d", 5.0) + b"\1\0\1" +
              struct.pack("<dd", 0, 30) + b"\0\1\0" + b"\x84\x08" + b"\1\1" * 257))
    for name, about, shape in (("segment_of_nothing", "no tiers and no further records", b"\0"),
                               ("harmonics_of_nothing", "no tiers, SH in a separate record", b"\3"),
                               ("no_further_records", "a count of 0 further records", b"\2\0")):
        must_fail(name, "5.3", about, plain(index=struct.pack("<d", 5.0) + b"\0\0\1" +
                  struct.pack("<dd", 0, 30) + b"\0\1\0" + shape))
    for name, about, part in (
            ("part_cut_backwards", "displayed from 20 to 10", dict(cut=(20, 10))),
            ("part_cut_outside", "displayed until a time after its end", dict(cut=(0, 31))),
            ("part_cut_before_the_timeline", "displayed from -1 on", dict(begin=-2, cut=(-1, 30))),
            ("part_moment", "a beginning of 2^-21 ticks", dict(begin=2.0 ** -21)),
            ("part_far", "an end beyond 2^32", dict(end=2.0 ** 33)),
            ("part_chunk", "an invalid chunk of its own", dict(chunk=0.0)),
            ("part_too_long", "a length of 2^32 + 1 ticks", dict(begin=-1.0, end=2.0 ** 32))):
        must_fail(name, "5.3", about, File([Part([one(-1, 0)], **part)], Meta(profile=0)))
    for tag in (b"SEGM", b"FRAG"):
        must_fail(f"{tag.decode().lower()}_in_the_head", "3.2", "with flags 0",
                  plain(last_records=record(tag, bytes(12), 0)))
    must_fail("up_of_length_2", "4.3", "an up vector of length 2",
              plain(meta=Meta(profile=0, up=(0, 2, 0))))
    must_fail("metres_below_0", "4.3", "a unit of -1 m", plain(meta=Meta(profile=0, metres=-1)))
    for name, about, more in (("sound_too_far", "audio from time 2^33 on", dict(audio_begin=2.0 ** 33)),
                              ("sound_at_no_moment", "a NaN", dict(audio_begin=float("nan"))),
                              ("sound_not_utf8", "a location truncated within a character", dict(audio=b"a\xe2\x82")),
                              ("generator_of_surrogates", "U+D800 as UTF-8", dict(generator=b"\xed\xa0\x80"))):
        must_fail(name, "4.3", about, plain(meta=Meta(profile=0, **more)))
    must_fail("further_record_of_content_1", "5.3", "layer 256 among the further records",
              File([Part([one(-1, 0, further=[(256, b"")])])], Meta(profile=0)))
    must_fail("tables_1025", "6.2", "1025 tables",
              plain(layouts=struct.pack("<H", 1025) + bytes(1025) + struct.pack("<H", 0)))
    must_fail("layouts_65535", "6.2", "65535 layouts",
              plain(layouts=struct.pack("<HH", 0, 65535)))
    constant = float_streams(3, 3, 1)
    for s in constant:
        s.v = [[0x01010101, 0x02020202, 0x03030303] for _ in s.v]
        s.coder, s.tables = RANS, [0] * (4 * len(s.v))
    must_fail("group_of_260_planes", "A.1", "a group of more than 256 planes", plain(degree=3, body=Body(
        constant, 3, tables=[{1: 1024, 2: 1024, 3: 2048}], group=b"")))
    must_fail("body_of_no_records", "3.3", "five bytes after the last segment", plain(tail=b"bytes"))
    must_fail("fragment_skips_its_own", "5.3", "records that are not before their FRAG record",
              growing([Part([], 0, 10, skip=1 << 20)], keep_skips=True))
    must_fail("fragment_after_a_closed_one", "5.12", "a fragment of the chain after a closed one",
              growing(recorded_parts(3), [Fragment(), Fragment(flags=1), Fragment()]))
    vector("closed_fragment_before_others", "5.12", "a closed fragment that is not in the chain",
           growing(recorded_parts(3), [Fragment(flags=1), Fragment(), Fragment()]), reported=[313])
    vector("fragment_flags_before_others", "5.12", "an unknown flag of a fragment that is not in the chain",
           growing(recorded_parts(3), [Fragment(flags=2), Fragment(), Fragment()]), reported=[113])
    vector("fragment_of_fewer_frames", "5.12", "20 frames, then 15",
           growing(recorded_parts(3), [Fragment(), Fragment(), Fragment(frames=15)]), reported=[313])
    between = recorded_parts(2)
    between[1].after = record(b"NOTE", b"", 0)
    vector("record_before_a_fragment", "5.12", "an unknown record after the segments of a fragment",
           growing(between), reported=[313])
    for tag in (b"NEWS", b"FRAG", b"IMPO"):
        vector(f"critical_{tag.decode().lower()}_in_the_body", "3.4", "a critical record after the segments",
               plain(tail=record(tag, bytes(12))), reported=[113])
    late = float_streams(1, 0, 3, 0, 5)
    late[1].v[0] = [bits_of(25.0)]
    vector("seen_outside_its_segment", "5.8", "a primitive of time 25 in [0, 5)",
           File([Part([Segment(0, 0, [Body(late, 1)])])], Meta(profile=0)), reported=[504])


def broken_header():
    good = plain().bytes()
    must_fail("short", "2.2", "39 bytes", good[:39])
    must_fail("magic", "2.1", "another first byte", flipped(good, 0))
    must_fail("text_transfer", "2.1", "translated line ends", good[:4] + b"\n" + good[6:])
    must_fail("header_checksum", "2.2", "a flipped bit", flipped(good, 9))
    must_fail("major_version", "2.5", "major version 2", plain(major=2))
    must_fail("experiment", "2.5", "version 0.6", plain(major=0, minor=6))
    must_fail("header_flags", "2.4", "an unknown critical flag", plain(flags=2))
    must_fail("truncated", "2.6", "the last byte is missing", good[:-1])
    must_fail("truncated_head", "2.6", "the last byte of the head is missing",
              good[:good.index(b"SEGM") - 1])
    tail = record(b"IMPO", struct.pack("<6f", *[1] * 6), 0)
    three = File([Part([Segment(0, 2 * i, [Body(float_streams(2, 0, i, 5 * i, 5), 2)])
                        for i in range(3)])], Meta(profile=0), tail=tail).bytes()
    second = three.index(b"SEGM", three.index(b"SEGM") + 4)
    must_fail("truncated_between_segments", "2.6", "one of three segments is available", three[:second])
    must_fail("truncated_in_a_segment", "2.6", "one of three segments is available", three[:second + 60])
    must_fail("truncated_behind_the_segments", "2.6", "IMPO is truncated, all segments are available",
              three[:-1])
    must_fail("bytes_after_the_end", "2.6", "one additional byte", good + b"\0")
    must_fail("head_beyond_the_file", "2.3", "head_bytes too large", plain(head_bytes=1 << 20))
    must_fail("head_cuts_a_record", "3.3", "head_bytes one too small", plain(head_bytes=-1))


def broken_head():
    good = plain().bytes()
    must_fail("record_header_checksum", "3.1", "META's, a flipped bit", flipped(good, 50))
    must_fail("meta_checksum", "3.1", "META's payload, a flipped bit", flipped(good, 90))
    must_fail("index_checksum", "3.1", "INDX's payload, a flipped bit",
           flipped(good, good.index(b"INDX") + 34))
    must_fail("meta_not_critical", "3.2", "flags 0", plain(record_flags={b"META": 0}))
    must_fail("unknown_critical", "3.4", "a critical record of an unknown tag",
           plain(last_records=record(b"NEWS", b"")))
    must_fail("unknown_record_flag", "3.4", "INDX with flags 3", plain(record_flags={b"INDX": 3}))
    must_fail("two_metas", "2.3", "META twice", plain(last_records=record(b"META", Meta().payload())))
    must_fail("no_index", "2.3", "META alone", plain(order=(b"META",)))
    must_fail("index_before_meta", "2.3", "INDX first", plain(order=(b"INDX", b"META")))
    for name, about, meta in (
            ("no_frames", "a duration of 0", Meta(frames=0)),
            ("time_base", "a denominator of 0", Meta(time_base=(1, 0))),
            ("degree_4", "SH degree 4", Meta(degree=4)),
            ("convention", "axes 1", Meta(conventions=(0, 1, 0, 0)))):
        must_fail(name, "4.2", about, plain(meta=meta))
    for name, about, meta in (
            ("bounds_not_finite", "a bound that is not a number", Meta(minimum=(float("nan"), 0, 0))),
            ("near_plane", "a near plane below 0", Meta(near=-1.0)),
            ("not_a_rotation", "a start camera that mirrors",
             Meta(size=(4, 4), lens=(1, 1, 0, 0), rotation=(-1, 0, 0, 0, 1, 0, 0, 0, 1))),
            ("not_utf8", "a generator that is not UTF-8", Meta(generator=b"\xff"))):
        must_fail(name, "4.3", about, plain(meta=meta))
    must_fail("window_outside", "4.5", "a training window outside its capture",
           plain(last_records=record(b"WNDW", struct.pack("<IIQQ", 71, 100, 1, 2), 0)))


def broken_index():
    def one(level, slot, **more):
        return Segment(level, slot, [Body(float_streams(1, 0, 3), 1)], **more)

    def of(segments, **part):
        return File([Part(segments, **part)])

    must_fail("chunk", "5.2", "a chunk of 0", plain(chunk=0.0))
    must_fail("chunk_too_fine", "5.2", "a chunk of 5 + 2^-21 ticks", plain(chunk=5 + 2.0 ** -21))
    must_fail("chunk_too_long", "5.2", "a chunk of 2^33 ticks", plain(chunk=2.0 ** 33))
    must_fail("chunk_infinite", "5.2", "an infinite chunk", plain(chunk=float("inf")))
    must_fail("index_cut", "5.2", "the index ends within its counts", plain(index=struct.pack("<d", 5.0)))
    must_fail("number_too_long", "1.8", "0 stored in two bytes",
           plain(index=struct.pack("<d", 5.0) + b"\x80\x00\x00\x00"))
    must_fail("number_too_great", "1.8", "a number of 70 bits",
           plain(index=struct.pack("<d", 5.0) + b"\xff" * 9 + b"\x7f\x00\x00"))
    must_fail("total", "5.2", "a wrong total", plain(total=4))
    must_fail("out_of_order", "5.6", "a later segment first", of([one(0, 2), one(1, 0)]))
    must_fail("longer_one_second", "5.6", "of two that begin together the shorter first",
           of([one(0, 0), one(1, 0)]))
    must_fail("outside_the_timeline", "5.4", "a slot after the end of the timeline", of([one(0, 12)]))
    must_fail("outside_its_part", "5.4", "a slot after the end of its part", of([one(0, 8)], begin=10.0))
    must_fail("part_inverted", "5.3", "a part that ends before it begins", of([one(-1, 0)], begin=30.0,
                                                                        end=29.0))
    must_fail("persistent_slot", "5.3", "slot 1 of level -1", of([one(-1, 0, raw_place=32)]))
    must_fail("record_beyond_the_end", "5.3", "a skip past the end", of([one(-1, 0)], skip=1 << 20))
    must_fail("no_primitives", "5.3", "a tier of 0 primitives", of([one(-1, 0, counts=[0])]))
    must_fail("too_many_primitives", "5.5", "more than 16 primitives per byte", of([one(-1, 0, counts=[1 << 31])]))
    must_fail("harmonics_of_degree_0", "5.7", "a separate SH record at degree 0",
           of([Segment(-1, 0, [Body(float_streams(1, 0, 3), 1)], [Body([], 1)])]))
    must_fail("expansion", "5.5", "6 million primitives in 12 kB of frames, 2 GB when decoded",
              expansion())
    # 3 primitives with 80 bytes of floats and 80 bytes of planes each.
    record_bytes = 32 + len(plain().parts[0].segments[0].payloads()[0])
    vector("limit_of_planes_kept", "conformance 1.5", "a segment's floats, bytes and planes at the limit",
           plain(), {"max_memory": 480 + record_bytes})
    must_fail("limit_of_planes", "conformance 1.5", "a byte more than the limit", plain(),
              {"max_memory": 479 + record_bytes})
    must_fail("limit_of_own_tables", "conformance 1.5", "tables of a segment, more than the limit",
              coded(), {"max_memory": 16384})
    layt = layouts_payload([{0: 2048, 1: 2048}] * 2, [float_streams(3, 0, 1)])
    must_fail("limit_of_tables", "conformance 1.5", "two tables of LAYT, more than the limit",
              plain(layouts=layt), {"max_memory": 32767})
    head_bytes = struct.unpack_from("<Q", plain().bytes(), 24)[0]
    must_fail("limit_of_a_head", "conformance 1.5", "a byte more than the limit", plain(),
              {"max_memory": head_bytes - 1})
    # FRAG records 4, 6 and 7 are read, which list 4, 2 and 1 parts; number 16 lists all.
    sizes = fragment_sizes(growing(recorded_parts(7)))
    must_fail("limit_of_fragments", "conformance 1.5", "the index of a recording, a byte more than the limit",
              growing(recorded_parts(7)), {"max_memory": sizes[3] + sizes[5] + sizes[6] - 1})
    must_fail("limit_of_a_fragment", "conformance 1.5", "one fragment, a byte more than the limit",
              growing(recorded_parts(16)), {"max_memory": fragment_sizes(growing(recorded_parts(16)))[15] - 1})
    must_fail("limit_of_rows", "conformance 1.5", "1,275 rows of layouts, more than the limit",
              plain(layouts=many_rows(5)), {"max_memory": 128 * 251 - 1})
    vector("limit_of_rows_kept", "conformance 1.5", "1,275 rows of layouts that no record uses, at the limit",
           plain(layouts=many_rows(5)), {"max_memory": 128 * 251})
    # A part and 5 segments of 256 tiers, whose records are missing.
    must_fail("limit_of_entries", "conformance 1.5", "1,281 entries of the index, more than the limit",
              many_entries(5), {"max_memory": 512 * 257 - 1})
    must_fail("limit_of_primitives", "conformance 1.5", "3 primitives, the limit is 2", plain(),
           {"max_primitives": 2})
    must_fail("limit_of_memory", "conformance 1.5", "240 bytes of floats, the limit is 239", plain(),
           {"max_memory": 239})


def many_rows(layouts):
    """Returns a LAYT with layouts of 255 rows of unknown attributes."""
    row = struct.pack("<HHBBBB", 6, 0x8000, 1, 0, 0, 0)
    return struct.pack("<HH", 0, layouts) + layouts * (bytes([255]) + 255 * row)


def many_entries(segments):
    """Returns a file with an index of segments of 256 tiers of one primitive, truncated after the
    head."""
    tiers = 256 * segments
    row = number(1) + number(4 * 256) + 256 * (number(1) + number(40))
    index = (struct.pack("<d", 1.0) + number(tiers) + number(0) + number(1) + struct.pack("<dd", 0, 30) +
             number(0) + number(segments) + segments * row)
    return File([], index=index, file_bytes=72 * tiers)


def fragment_sizes(data):
    """Returns the sizes of the payloads of a recording's FRAG records."""
    sizes, at = [], data.find(b"FRAG")
    while at >= 0:
        sizes.append(struct.unpack_from("<Q", data, at + 8)[0])
        at = data.find(b"FRAG", at + 1)
    return sizes


def expansion():
    """Returns a file whose frames of one value expand 12 kB to 2 GB."""
    n = 6 << 20
    streams = float_streams(1, 3, 1)
    for s in streams:
        s.mapping, s.prediction, s.bits, s.e = 1, 0, (8,), 0
        s.mapping = {3: 2, 4: 2, 5: 3, 7: 4}.get(s.attribute, 1)
        s.e = {7: -4}.get(s.attribute, 0)
        s.v = s.v[:3] if s.attribute == 7 else s.v
        s.origin = (1.0,) if s.attribute == 3 else ()
        blocks = n * len(s.v) >> 17
        s.stored = struct.pack("<IBI", 0xFD2FB528, 0xA0, blocks << 17)
        for i in range(blocks):
            s.stored += struct.pack("<I", 1 << 20 | 2 | (i + 1 == blocks))[:3] + b"\0"
    return plain(body=Body(streams, n, planes_sum=0), degree=3)
