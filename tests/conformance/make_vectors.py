#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the conformance vectors: small files, sound or broken in one way, the same on every machine.

usage: make_vectors.py DIR            writes DIR/NAME.stgs for each vector
       make_vectors.py --update       writes those of this folder, and manifest.json: what each is
                                      about, and what the reference decoder answers
"""
import json
import os
import struct
import sys
from dataclasses import dataclass

from vector_file import (RANS, Body, File, Meta, Part, Patched, Segment, Stream, bits_of, checksum,
                         group, layouts_payload, record, table_bytes, text, zstd_frame)
from vector_growing import Fragment, fragment, growing
from vector_scenes import coded_streams, deltas, float_streams, give_tables, own_body, zigzags

HERE = os.path.dirname(os.path.abspath(__file__))
VECTORS = []


@dataclass
class Vector:
    name: str
    clause: str     # that it is about; of what must fail, the one that refuses it
    about: str
    data: bytes
    limits: dict    # of the reader, where they are not the default ones
    fails: bool
    reported: list  # issues of a validator, where readers do not see what is wrong


def vector(name, clause, about, file, limits=None, fails=False, reported=()):
    data = file if isinstance(file, bytes) else file.bytes()
    VECTORS.append(Vector(name, clause, about, data, limits or {}, fails, list(reported)))


def must_fail(name, clause, about, file, limits=None):
    vector(name, clause, about, file, limits, True)


def plain(n=3, degree=0, seed=1, **more):
    """One persistent segment of floats."""
    body = more.pop("body", None) or Body(float_streams(n, degree, seed), n)
    floats = all(s.mapping == 0 for s in body.streams if s.attribute < 0x8000)
    meta = more.pop("meta", None) or Meta(profile=int(not floats), degree=degree)
    return File([Part([Segment(-1, 0, [body])])], meta, **more)


def coded(n=5, degree=0, seed=2, level=-1, slot=0, **streams):
    return File([Part([Segment(level, slot, [own_body(coded_streams(n, degree, seed, **streams), n)])])],
                Meta(degree=degree))


def changed(attribute, n=3, degree=0, **fields):
    """plain() with one stream's fields changed."""
    streams = float_streams(n, degree, 1)
    for s in streams:
        if s.attribute == attribute:
            for name, value in fields.items():
                setattr(s, name, value)
    return plain(body=Body(streams, n), degree=degree)


def replaced(stream, n=3, meta=None, **body):
    streams = [stream if s.attribute == stream.attribute else s for s in float_streams(n, 0, 1)]
    return plain(body=own_body(streams, n, **body), meta=meta)


def place(layer, level=-1, slot=0):
    """What the payload of a further record begins with (5.13)."""
    return struct.pack("<hHI", level, layer, slot)


def private(*names):  # 3.5
    payload = struct.pack("<H", len(names))
    for kind, value, name in names:
        payload += struct.pack("<HH", kind, value) + text(name)
    return record(b"PRIV", payload, 0)


def framed(planes, window=None, size=True, dictionary=0, reserved=0):
    """A zstd frame of a raw block, with another header than zstd_frame's."""
    head = 0x80 * bool(size) | 0x20 * (window is None) | reserved | bool(dictionary)
    out = struct.pack("<IB", 0xFD2FB528, head)
    out += b"" if window is None else bytes([window])
    out += bytes([dictionary] * bool(dictionary))
    out += struct.pack("<I", len(planes)) if size else b""
    return out + struct.pack("<I", len(planes) << 3 | 1)[:3] + planes


def with_byte(data, at, flip=1):
    return data[:at] + bytes([data[at] ^ flip]) + data[at + 1:]


def sound_lossless():
    primitive = [(1, 1.0, 2.0, 3.0), (2, 0.5), (3, 1.0), (4, 0.25), (5, 0.0, 0.0, 0.0),
                 (6, -1.0, -2.0, -3.0), (7, 1.0, 0.0, 0.0, 0.0), (8, 2.0), (9, 0.1, 0.2, 0.3)]
    streams = [Stream(a, 0, 0, [[bits_of(v)] for v in values]) for a, *values in primitive]
    vector("one_primitive", "9", "the primitive of the example, with its own layout",
           plain(body=Body(streams, 1)))
    for degree in range(4):
        vector(f"floats_degree_{degree}", "7.5.1", f"mapping 0, harmonics of degree {degree}",
               plain(4, degree, 10 + degree))
    two = [Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)]),
           Segment(1, 0, [Body(float_streams(1, 0, 4, 0, 10), 1)]),
           Segment(0, 0, [Body(float_streams(2, 0, 5, 0, 5), 2)]),
           Segment(0, 1, [Body(float_streams(1, 0, 6, 2.5, 5), 1)]),
           Segment(0, 4, [Body(float_streams(1, 0, 7, 10, 5), 1)])]
    vector("levels", "5.4", "persistent, levels 0 and 1, slots that are left out", File(
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
    vector("zstd_window", "7.2.2", "a frame of a window of 8 MiB", plain(body=Body(streams, 3)))
    extra = Stream(0x8001, 9, 3, [[1, 2, 3]], 7, 0, (8,), (1.0,), stored=b"whatever")
    streams = float_streams(3, 0, 1)
    vector("optional_stream", "6.5", "an attribute of 0x8001 between the others, skipped",
           plain(body=Body(streams[:4] + [extra] + streams[4:], 3)))
    extra = Stream(0xBFFF, 200, -128, [[1]], 3, 77, (8,), m=0, stored=b"whatever", later=b"more")
    vector("optional_unknown_coder", "6.5", "an optional attribute of an unknown coder, skipped",
           plain(body=Body(streams + [extra], 3)))
    short = Stream(0xBFFF, 0, 0, [[1]], 0, 77, stored=b"")
    body = Body(streams + [short], 3)
    vector("optional_short_row", "6.3", "a row of an optional attribute that ends with its coder",
           plain(body=Patched(body, short.row(), struct.pack("<HH4B", 6, 0xBFFF, 1, 0, 0, 77))))
    longer = float_streams(3, 0, 1)
    for i, s in enumerate(longer):
        s.later = b"later"[:i]
    vector("longer_rows", "6.3", "rows with more than this version's fields, which are ignored",
           plain(body=Body(longer, 3)))
    unused = [Stream(a, m, 0, [[0]], p, c) for a, m, p, c in ((13, 0, 0, 0), (8, 8, 0, 0), (8, 0, 4, 0),
                                                            (8, 0, 0, 3))]
    layt = struct.pack("<HH", 0, 2) + b"\x04" + b"".join(s.row() for s in unused)
    layt += b"\x09" + b"".join(s.row() for s in streams)
    vector("unknown_rows_unused", "6.3", "an unknown attribute, mapping, prediction and coder in a layout "
           "that no record has", plain(body=Body(streams, 3, layout=1), layouts=layt))


def sound_coded():
    vector("coded", "7", "mappings 1 to 5 and 7, predictions 0 to 3, all rANS, persistent", coded())
    vector("shaped_rotation", "7.5.7", "mapping 6", coded(40, shaped=True))
    needles = float_streams(3, 0, 1)
    needles[5].v[0] = [bits_of(-9.0)] * 3
    needles[6] = Stream(7, 6, -7, [deltas([5, -7, 700]), deltas([0, 1, 2]), deltas([9, 9, 9])], 2)
    vector("shaped_rotation_of_needles", "7.5.7", "mapping 6, the finest steps, as differences",
           plain(body=own_body(needles, 3)))
    vector("moment_in_a_slot", "7.5.8", "mapping 7 counts from the beginning of its segment",
           coded(6, level=0, slot=2))
    vector("coded_degree_3", "7.5.6", "mapping 5 for all harmonics, tables shared between planes",
           coded(7, 3, 21))
    for n in (1, 64, 65, 2048, 2112):
        streams = float_streams(n, 0, 31) if n < 100 else None
        if streams is None:  # all but position is the same for all primitives
            streams = float_streams(1, 0, 31)
            for s in streams:
                s.v, s.zstd = [row * n for row in s.v], "repeat"
                s.coder, s.digits = RANS, None
        streams[0] = coded_streams(n, 0, 31)[0]
        vector(f"lanes_{n}", "A.1", f"a group of {n} primitives", plain(body=own_body(streams, n)))
    streams = coded_streams(9, 1, 5, which="base"), coded_streams(9, 1, 5, which="rest")
    second = coded_streams(4, 1, 6, which="base"), coded_streams(4, 1, 6, which="rest")
    tables = []
    give_tables([streams[0]], tables)
    give_tables([streams[1], second[1]], tables)
    give_tables([second[0]], tables)
    layt = layouts_payload(tables, [streams[0], streams[1], second[0]])
    bodies = [Body(streams[0], 9, 0, tables), Body(second[0], 4, 2, tables)]
    rest = [Body(streams[1], 9, 1, tables), Body(second[1], 4, 1, tables)]
    vector("tiers", "5.7", "two tiers, harmonics apart, layouts and tables of LAYT",
           File([Part([Segment(-1, 0, bodies, rest)])], Meta(degree=1), layouts=layt))
    wide = Stream(8, 1, -2, [[0, 0, 0]], 0, RANS, (2, 3), digits=[bytes([7, 1, 255]),
                                                                bytes([2, 0, 9])])
    vector("digits_wider_than_their_bits", "7.3", "they are or-ed all the same", replaced(wide))
    limits = Stream(8, 1, -24, [[(1 << 24) - 1, (1 << 32) - (1 << 24) + 1, 0]], 0)
    vector("integers_of_24_bits", "7.5", "the least and the greatest", replaced(limits))
    limits = Stream(8, 1, -24, [[65793, (1 << 32) - 65793, 0]], m=255)
    vector("multiplied_integers_of_24_bits", "7.5", "the least and the greatest for m = 255",
           replaced(limits))
    for name, e in (("least_step", -100), ("greatest_step", 100)):
        vector(name, "7.5", f"e = {e}, as far out as f32 needs for no subnormal or infinity",
               replaced(Stream(8, 1, e, [[(1 << 24) - 1, (1 << 32) - 1, 0]], origin=(-2.0 ** e,))))
    many = coded_streams(6, 1, 44, shaped=True)
    for s, m in zip(many, (3, 7, 5, 13, 9, 5, 3, 15, 11, 255)):
        s.m = m
    many[2].e = many[3].e = 17
    vector("multipliers", "7.5", "m of 3 to 255 in every mapping but 0 and 4, in a slot",
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
        vector(name, "7.5.4", f"e = {e} over lifespans that no f32 step can be as short as",
               plain(body=own_body(lives, 3)))
    vector("truncated_to_2_to_100", "7.5.3", "the greatest float of mapping 2",
           replaced(Stream(3, 2, 23, [[0, 0, 100]], origin=(1.0,))))
    vector("displacement_clamped", "7.5.4", "lifespans longer than the part",
           replaced(Stream(5, 3, -3, [[2, 3, 4]] * 3, 1)))
    key = Stream(1, 1, -10, [[0, 5, (1 << 40) + 3]], 3, bits=(8,) * 8)
    vector("morton_of_63_bits", "7.4", "a first key, differences of eight digits",
           replaced(key, first_key=(1 << 62) + 12345))
    most = (1 << 22) - 1
    colour = Stream(9, 5, -24, [[most, (1 << 32) - most, 1], [most, most, 2], [(1 << 32) - most, most, 3]])
    vector("colour_of_24_bits", "7.5.6", "the greatest channels", replaced(colour))
    linear = coded_streams(5, 0, 40, moment=False)
    vector("linear_time", "7.5.2", "mapping 1 for time", plain(body=own_body(linear, 5)))


def sound_container():
    note = record(b"NOTE", b"hello", 0)
    later = plain(degree=1, minor=9, flags=0x10000, head_first=note, head_last=record(b"INDX", b"", 2),
                  tail=note + record(b"SEGM", b"????????", 2), index_extra=b"later",
                  meta=Meta(profile=0, degree=1, extra=b"later"))
    vector("newer_minor", "2.5", "minor version 9, unknown flags, records and fields", later)
    vector("newer_profile", "4.2", "profile 9 and unit 7, which only inform",
           plain(meta=Meta(profile=9, conventions=(7, 0, 0, 0))))
    seen = Meta(profile=0, size=(640, 480), lens=(500.0, 500.0, 320.0, 240.0),
                rotation=(0, 0, 1, 0, 1, 0, -1, 0, 0))
    vector("start_camera", "4.3", "a start camera", plain(meta=seen))
    window = struct.pack("<IIQQ", 5, 100, 1, 2)
    vector("window", "4.5", "WNDW", plain(head_last=record(b"WNDW", window + b"later", 0)))
    vector("importance", "5.11", "IMPO behind an unknown record", plain(
        tail=note + record(b"IMPO", struct.pack("<3f", 0.5, 0, 3), 0)))
    parts = [Part([Segment(-1, 0, [Body(float_streams(2, 0, 3, 0, 15), 2)])], 0, 14.5),
             Part([Segment(-1, 0, [own_body(coded_streams(3, 0, 3, moment=False), 3)]),
                   Segment(0, 6, [own_body(coded_streams(2, 0, 4), 2)])], 14.5, 30, note)]
    vector("parts", "5.10", "two parts, a record between them", File(parts, Meta()))
    far = 1 << 20
    late = [Segment(-1, 0, [own_body(coded_streams(3, 0, 3), 3)]),
            Segment(0, 2 * far // 5 + 1, [own_body(coded_streams(2, 0, 4), 2)])]
    vector("late_part", "7.5.8", "mapping 7 in a part from tick 2^20 on, which cuts its segment",
           File([Part(late, far, far + 30)], Meta(frames=far + 30)))
    further = Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)],
                      further=[(512, place(512) + b"new"), (0xBF07, place(0xBF07))])
    vector("further_records", "5.7", "contents 2 and 191, ignored", File([Part([further])], Meta(
        profile=0)))
    sound = struct.pack("<dd", 0.0, 12.5) + text("audio/opus") + bytes(range(40))
    lights = text("org.example.lights")
    names = private((0, 0xC005, "org.example.heat"), (1, 0xC001, "org.example.rig"),
                    (2, 200, "org.example.sound"), (9, 1, "later"))
    streams = float_streams(2, 0, 3)
    streams.insert(4, Stream(0xC005, 0, 0, [[1, 2]], stored=b"warm"))
    timed = Segment(-1, 0, [Body(streams, 2)], further=[(200 << 8, place(200 << 8) + sound)])
    vector("private_numbers", "3.5", "an attribute, a profile, a content of timed data, records",
           File([Part([timed])], Meta(profile=0xC001), head_first=record(b"liGT", lights + b"?", 0),
                head_last=names + record(b"priv", lights, 0), tail=record(b"zzzz", lights, 0)))
    unnamed = File([Part([timed])], Meta(profile=0xC001))
    vector("private_numbers_unnamed", "3.5", "the same numbers without PRIV", unnamed,
           reported=[117] * 3)
    for place_of in ("head_last", "tail"):
        vector(f"private_record_unnamed_{place_of}", "3.5", "a private record without a name",
               plain(**{place_of: record(b"liGT", b"\0\0\0\0", 0)}), reported=[117])
    wrong = Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)], further=[(512, place(513))])
    vector("further_record_of_another_layer", "5.13", "it says another layer than the index",
           File([Part([wrong])], Meta(profile=0)), reported=[400])
    vector("unknown_record_damaged", "3.1", "a record of the head that readers skip",
           plain(head_first=with_byte(record(b"NOTE", b"hello", 0), 34)), reported=[112])
    vector("empty", "5.2", "no primitives, no parts", File([]))
    vector("attribute_totals", "5.2", "totals, of an unknown attribute too",
           plain(totals=((1, 36), (0x8001, 1 << 40))))
    moved = [Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)]),
             Segment(30, 0, [Body(float_streams(1, 0, 3), 1)])]
    late = float_streams(1, 0, 3)
    for attribute, value in ((2, 204802.5), (3, 0.25), (4, 1.8496), (8, 0.0)):
        late[attribute - 1].v[0] = [bits_of(value)]
    vector("support_near_its_end", "5.8", "seen up to a tenth of a tick before its interval ends, late",
           File([Part([Segment(0, 81920, [Body(late, 1)])], 0, 300000)], Meta(profile=0, frames=300000)))
    vector("level_30", "5.4", "the longest level", File([Part(moved)]))


def stretches(count):
    return [Part([Segment(-1, 0, [Body(float_streams(2, 0, 10 + i, 1, 8), 2)])],
                 10 * i, 10 * i + 10) for i in range(count)]


def sound_growing():
    vector("growing_empty", "5.12", "a recording before its first stretch", growing([]))
    vector("growing", "5.12", "three stretches, found in two fragments", growing(stretches(3)))
    vector("growing_eight", "5.12", "eight stretches in one fragment", growing(stretches(8)))
    vector("growing_closed", "5.12", "a closed recording",
           growing(stretches(3), closed=Fragment(flags=1)))
    whole, less = growing(stretches(3)), growing(stretches(2))
    for name, size in (("growing_cut_in_a_record", len(less) + 100),
                       ("growing_cut_in_a_header", len(less) + 7),
                       ("growing_cut_in_a_fragment", len(whole) - 1)):
        vector(name, "5.12", "cut off: read up to the last complete stretch", whole[:size])


    # A record whose payload holds a fragment: right but for where it stands.
    less, part = growing(stretches(2)), stretches(3)[2]
    third = whole[whole.rindex(b"FRAG"):]
    at = len(less) + 32 + 8
    for name, about, said in (
            ("forged_fragment", "a fragment within an unknown record leads nowhere", {}),
            ("forged_fragment_of_segments", "as before, as if segments came before it",
             {"skip": len(less) - less.rindex(b"FRAG")})):
        forged = forged_fragment(less, at, part, **said)
        vector(name, "5.12", about, less + record(b"NOTE", b"8 bytes." + forged, 0))
    vector("foreign_fragment", "5.12", "another file's fragment within an unknown record",
           less + record(b"NOTE", third, 0))
    noted = stretches(3)
    for i, part in enumerate(noted):
        part.before = record(b"POSE", bytes([i] * 9), 0)
    vector("growing_with_further_records", "5.12", "a record of another kind before each stretch's",
           growing(noted) + record(b"POSE", b"\3" * 9, 0))
    vector("growing_cut_before_a_stretch", "5.12", "cut off behind such a record",
           growing(noted)[:len(growing(noted[:2])) + 41 + 5])


def forged_fragment(less, at, part, skip=None):
    """A FRAG record for byte `at`, after the recording `less`: of no records, or of a skip."""
    before = less.rindex(b"FRAG")
    head_bytes = struct.unpack_from("<Q", less, 24)[0]
    empty = Part([], part.begin, part.end)
    return fragment([empty], part.end, Fragment(), [at - before if skip is None else skip], at,
                    checksum(less[:head_bytes]), before, before)


def broken_growing():
    whole = growing(stretches(3))
    must_fail("growing_states_its_size", "2.6", "file_bytes in a growing file",
              growing(stretches(1), file_bytes=1))
    must_fail("growing_cut_head", "2.6", "shorter than its head", growing([])[:-1])
    must_fail("growing_with_index", "3.4", "INDX in the head of a growing file",
              growing(stretches(1), head_last=record(b"INDX", File([]).index_payload())))
    must_fail("growing_after_the_end", "5.12", "bytes after a closed fragment",
              growing(stretches(1), closed=Fragment(flags=1), tail=b"x"))
    flags = [Fragment(flags=2)]
    must_fail("fragment_flags", "5.12", "a fragment's unknown flag", growing(stretches(1), flags))
    must_fail("fragment_frames", "5.12", "a file of no frames",
              growing(stretches(1), [Fragment(frames=0)]))
    must_fail("fragment_bounds", "4.3", "bounds the wrong way round",
              growing(stretches(1), [Fragment(bounds=(1, 0, 0, 0, 0, 0))]))
    must_fail("fragment_part", "5.3", "a part beyond the frames of its fragment",
              growing(stretches(1), [Fragment(frames=9)]))
    itself = len(growing([])) + len(File(stretches(1)).body())
    must_fail("fragment_previous", "5.12", "previous is the fragment itself",
              growing(stretches(1), [Fragment(previous=itself)]))
    must_fail("fragment_previous_is_none", "5.12", "previous is another record",
              growing(stretches(2), [Fragment(), Fragment(previous=len(growing([])))]))
    must_fail("fragment_chunk", "5.12", "two chunks in one file",
              growing(stretches(3), [Fragment(), Fragment(), Fragment(chunk=7.0)]))
    must_fail("fragment_in_the_way", "5.12", "a fragment of the chain is damaged: its stretch is lost",
              with_byte(whole, len(growing(stretches(2))) - 30))
    eleven = growing(stretches(11))
    must_fail("fragment_damaged", "5.12", "one of many: ten of eleven stretches are read",
              with_byte(eleven, len(growing(stretches(10))) - 30))
    must_fail("fragment_header_damaged", "5.12", "its record header: 13 of 14 stretches are read",
              with_byte(growing(stretches(14)), growing(stretches(12)).rindex(b"FRAG") + 1))


def broken_rules():
    """One for each must that the others do not break."""
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
                  plain(head_last=twice if tag == b"INDX" else twice + twice))
    must_fail("private_names_cut", "3.5", "a count of 2, one name",
              plain(head_last=record(b"PRIV", b"\2\0\0\0\1\xc0" + text("a"), 0)))
    must_fail("private_name_empty", "3.5", "no name", plain(head_last=private((0, 0xC001, ""))))
    must_fail("private_name_not_utf8", "3.5", "a name of \\xff",
              plain(head_last=private((0, 0xC001, b"\xff"))))
    must_fail("two_privs", "2.3", "PRIV twice", plain(head_last=private() + private()))
    must_fail("private_critical", "3.4", "a private record that is critical",
              plain(head_last=record(b"liGT", text("org.example.lights"))))
    must_fail("window_critical", "3.4", "WNDW with flags 1",
              plain(head_last=record(b"WNDW", struct.pack("<IIQQ", 0, 99, 1, 2))))
    must_fail("window_short", "4.5", "WNDW of 23 bytes", plain(head_last=record(b"WNDW", bytes(23), 0)))
    must_fail("bounds_inverted", "4.3", "the least above the greatest", plain(meta=Meta(
        profile=0, least=(1, 0, 0), greatest=(0, 0, 0))))
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
              struct.pack("<dd", 0, 30) + b"\0\1\0" + b"\x80\x08" + b"\1\1" * 257))
    must_fail("further_record_of_content_1", "5.3", "layer 256 among the further records",
              File([Part([one(-1, 0, further=[(256, b"")])])], Meta(profile=0)))
    must_fail("tables_1025", "6.2", "1025 tables",
              plain(layouts=struct.pack("<H", 1025) + bytes(1025) + struct.pack("<H", 0)))
    must_fail("layouts_65535", "6.2", "65535 layouts",
              plain(layouts=struct.pack("<HH", 0, 65535)))
    alike = float_streams(3, 3, 1)
    for s in alike:
        s.v = [[0x01010101, 0x02020202, 0x03030303] for _ in s.v]
        s.coder, s.tables = RANS, [0] * (4 * len(s.v))
    must_fail("group_of_260_planes", "A.1", "more than 256", plain(degree=3, body=Body(
        alike, 3, tables=[{1: 1024, 2: 1024, 3: 2048}], group=b"")))
    must_fail("body_of_no_records", "3.3", "five bytes behind the last segment", plain(tail=b"bytes"))
    must_fail("fragment_skips_its_own", "5.3", "records that do not lie before their fragment",
              growing([Part([], 0, 10, skip=1 << 20)], keep_skips=True))
    must_fail("fragment_after_a_closed_one", "5.12", "of those that the index is read from",
              growing(stretches(3), [Fragment(), Fragment(flags=1), Fragment()]))
    vector("closed_fragment_before_others", "5.12", "one that the index is not read from",
           growing(stretches(3), [Fragment(flags=1), Fragment(), Fragment()]), reported=[313])
    vector("fragment_flags_before_others", "5.12", "an unknown flag of one that is not read",
           growing(stretches(3), [Fragment(flags=2), Fragment(), Fragment()]), reported=[113])
    between = stretches(2)
    between[1].after = record(b"NOTE", b"", 0)
    vector("record_before_a_fragment", "5.12", "an unknown record behind the segments of a stretch",
           growing(between), reported=[313])
    for tag in (b"NEWS", b"FRAG", b"IMPO"):
        vector(f"critical_{tag.decode().lower()}_in_the_body", "3.4", "a critical record behind the segments",
               plain(tail=record(tag, bytes(12))), reported=[113])
    late = float_streams(1, 0, 3, 0, 5)
    late[1].v[0] = [bits_of(25.0)]
    vector("seen_outside_its_segment", "5.8", "a primitive of moment 25 in [0, 5)",
           File([Part([Segment(0, 0, [Body(late, 1)])])], Meta(profile=0)), reported=[504])


def broken_header():
    good = plain().bytes()
    must_fail("short", "2.2", "39 bytes", good[:39])
    must_fail("magic", "2.1", "another first byte", with_byte(good, 0))
    must_fail("text_transfer", "2.1", "line ends translated", good[:4] + b"\n" + good[6:])
    must_fail("header_checksum", "2.2", "a flipped bit", with_byte(good, 9))
    must_fail("major_version", "2.5", "major version 1", plain(major=1))
    must_fail("minor_version", "2.5", "minor version 4, an experiment", plain(minor=4))
    must_fail("header_flags", "2.4", "an unknown critical flag", plain(flags=2))
    must_fail("truncated", "2.6", "the last byte is missing", good[:-1])
    must_fail("truncated_head", "2.6", "the last byte of the head is missing",
              good[:good.index(b"SEGM") - 1])
    tail = record(b"IMPO", struct.pack("<6f", *[1] * 6), 0)
    three = File([Part([Segment(0, 2 * i, [Body(float_streams(2, 0, i, 5 * i, 5), 2)])
                        for i in range(3)])], Meta(profile=0), tail=tail).bytes()
    second = three.index(b"SEGM", three.index(b"SEGM") + 4)
    must_fail("truncated_between_segments", "2.6", "one of three segments is there", three[:second])
    must_fail("truncated_in_a_segment", "2.6", "one of three segments is there", three[:second + 60])
    must_fail("truncated_behind_the_segments", "2.6", "IMPO is cut, all segments are there",
              three[:-1])
    must_fail("bytes_after_the_end", "2.6", "one more", good + b"\0")
    must_fail("head_beyond_the_file", "2.3", "head_bytes too great", plain(head_bytes=1 << 20))
    must_fail("head_cuts_a_record", "3.3", "head_bytes one too small", plain(head_bytes=-1))


def broken_head():
    good = plain().bytes()
    must_fail("record_header_checksum", "3.1", "META's, a flipped bit", with_byte(good, 50))
    must_fail("meta_checksum", "3.1", "META's payload, a flipped bit", with_byte(good, 90))
    must_fail("index_checksum", "3.1", "INDX's payload, a flipped bit",
           with_byte(good, good.index(b"INDX") + 34))
    must_fail("meta_not_critical", "3.2", "flags 0", plain(record_flags={b"META": 0}))
    must_fail("unknown_critical", "3.4", "a critical record of an unknown tag",
           plain(head_last=record(b"NEWS", b"")))
    must_fail("unknown_record_flag", "3.4", "INDX with flags 3", plain(record_flags={b"INDX": 3}))
    must_fail("two_metas", "2.3", "META twice", plain(head_last=record(b"META", Meta().payload())))
    must_fail("no_index", "2.3", "META alone", plain(order=(b"META",)))
    must_fail("index_before_meta", "2.3", "INDX first", plain(order=(b"INDX", b"META")))
    for name, about, meta in (
            ("no_frames", "a duration of 0", Meta(frames=0)),
            ("time_base", "a denominator of 0", Meta(time_base=(1, 0))),
            ("degree_4", "harmonics of degree 4", Meta(degree=4)),
            ("convention", "axes 1", Meta(conventions=(0, 1, 0, 0)))):
        must_fail(name, "4.2", about, plain(meta=meta))
    for name, about, meta in (
            ("bounds_not_finite", "a bound that is no number", Meta(least=(float("nan"), 0, 0))),
            ("near_plane", "a near plane below 0", Meta(near=-1.0)),
            ("not_a_rotation", "a start camera that mirrors",
             Meta(size=(4, 4), lens=(1, 1, 0, 0), rotation=(-1, 0, 0, 0, 1, 0, 0, 0, 1))),
            ("not_utf8", "a generator that is not UTF-8", Meta(generator=b"\xff"))):
        must_fail(name, "4.3", about, plain(meta=meta))
    must_fail("window_outside", "4.5", "a window beyond its capture",
           plain(head_last=record(b"WNDW", struct.pack("<IIQQ", 71, 100, 1, 2), 0)))


def broken_index():
    def one(level, slot, **more):
        return Segment(level, slot, [Body(float_streams(1, 0, 3), 1)], **more)

    def of(segments, **part):
        return File([Part(segments, **part)])

    must_fail("chunk", "5.2", "a chunk of 0", plain(chunk=0.0))
    must_fail("chunk_too_fine", "5.2", "a chunk of 5 + 2^-21 ticks", plain(chunk=5 + 2.0 ** -21))
    must_fail("chunk_too_long", "5.2", "a chunk of 2^33 ticks", plain(chunk=2.0 ** 33))
    must_fail("chunk_infinite", "5.2", "a chunk without end", plain(chunk=float("inf")))
    must_fail("index_cut", "5.2", "the index ends in its counts", plain(index=struct.pack("<d", 5.0)))
    must_fail("number_too_long", "1.8", "0 in two bytes",
           plain(index=struct.pack("<d", 5.0) + b"\x80\x00\x00\x00"))
    must_fail("number_too_great", "1.8", "a number of 70 bits",
           plain(index=struct.pack("<d", 5.0) + b"\xff" * 9 + b"\x7f\x00\x00"))
    must_fail("total", "5.2", "a wrong total", plain(total=4))
    must_fail("out_of_order", "5.6", "a later segment first", of([one(0, 2), one(1, 0)]))
    must_fail("longer_one_second", "5.6", "of two that begin together the shorter first",
           of([one(0, 0), one(1, 0)]))
    must_fail("outside_the_timeline", "5.4", "a slot beyond the end", of([one(0, 12)]))
    must_fail("outside_its_part", "5.4", "a slot before its part", of([one(0, 0)], begin=10.0))
    must_fail("part_inverted", "5.3", "a part that ends before it begins", of([one(-1, 0)], begin=30.0,
                                                                        end=29.0))
    must_fail("persistent_slot", "5.3", "slot 1 of level -1", of([one(-1, 0, raw_place=32)]))
    must_fail("record_beyond_the_end", "5.3", "a skip past the end", of([one(-1, 0)], skip=1 << 20))
    must_fail("no_primitives", "5.3", "a tier of 0 primitives", of([one(-1, 0, counts=[0])]))
    must_fail("too_many_primitives", "5.5", "more than 16 a byte", of([one(-1, 0, counts=[1 << 31])]))
    must_fail("harmonics_of_degree_0", "5.7", "apart, where there are none",
           of([Segment(-1, 0, [Body(float_streams(1, 0, 3), 1)], [Body([], 1)])]))
    must_fail("expansion", "5.5", "6 million primitives in 12 kB of frames, 2 GB once decoded",
              expansion())
    # 3 primitives of 80 bytes of floats and of planes.
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
    must_fail("limit_of_primitives", "conformance 1.5", "3 primitives, the limit is 2", plain(),
           {"max_primitives": 2})
    must_fail("limit_of_memory", "conformance 1.5", "240 bytes of floats, the limit is 239", plain(),
           {"max_memory": 239})


def expansion():
    """What frames of one value could make of 12 kB before a record's primitives were bounded."""
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


def broken_segment():
    def three():
        return File([Part([Segment(0, 2 * i, [Body(float_streams(2, 0, i, 5 * i, 5), 2)])
                           for i in range(3)])], Meta(profile=0))

    good = three().bytes()
    second = good.index(b"SEGM", good.index(b"SEGM") + 4)
    must_fail("damage_to_one_segment", "3.1", "a flipped bit in the second of three; the others play",
           with_byte(good, second + 100))
    for name, clause, flags in (("segment_not_critical", "3.2", 0), ("segment_flags", "3.4", 3)):
        file = plain()
        file.parts[0].segments[0].flags = flags
        must_fail(name, clause, f"SEGM with flags {flags}", file)
    file = plain()
    file.parts[0].segments[0].says = (0, 3)
    must_fail("another_segment", "6.1", "the record says another place than the index", file)
    streams = float_streams(3, 0, 1)
    must_fail("layout_not_there", "6.1", "layout 0, no LAYT", plain(body=Body(streams, 3, layout=0)))
    must_fail("two_own_layouts", "6.1", "two layouts in a record",
           plain(body=Body(streams, 3, own_layouts=2)))
    must_fail("bytes_after_the_streams", "6.1", "one byte more",
           plain(body=Body(streams, 3, after=b"\0")))
    must_fail("planes_checksum", "6.1", "a wrong checksum of the planes",
           plain(body=Body(streams, 3, planes_sum=0)))
    must_fail("attribute_missing", "6.4", "no radius",
           plain(body=Body(streams[:3] + streams[4:], 3)))
    must_fail("attributes_out_of_order", "6.4", "time before position",
           plain(body=Body([streams[1], streams[0]] + streams[2:], 3)))
    must_fail("unknown_attribute", "6.3", "attribute 13",
           plain(body=Body(streams + [Stream(13, 0, 0, [[0, 0, 0]])], 3)))
    must_fail("harmonics_nowhere", "5.7", "left out and not apart",
           plain(body=Body(float_streams(3, 1, 1, which="base"), 3), degree=1))
    both = Segment(-1, 0, [Body(float_streams(3, 1, 1), 3)],
                   [Body(float_streams(3, 1, 1, which="rest"), 3)])
    must_fail("harmonics_twice", "5.7", "in both records", File([Part([both])], Meta(degree=1)))


def broken_streams():
    for name, clause, about, fields in (
            ("unknown_mapping", "6.3", "mapping 8", dict(mapping=8)),
            ("unknown_prediction", "6.3", "prediction 4", dict(prediction=4)),
            ("unknown_coder", "6.3", "coder 3", dict(coder=3)),
            ("row_too_short", "6.3", "a row that ends in its fields", dict(length=12)),
            ("row_without_a_kind", "6.3", "a row of five bytes", dict(length=5)),
            ("row_beyond_the_layout", "6.1", "a row longer than what is left", dict(length=65535)),
            ("multiplier_of_floats", "7.5.1", "mapping 0 with m = 3", dict(m=3)),
            ("multiplier_0", "7.5", "m = 0", dict(mapping=1, m=0)),
            ("multiplier_2", "7.5", "m = 2", dict(mapping=1, m=2)),
            ("step_too_small", "7.5", "e = -101", dict(mapping=1, e=-101)),
            ("step_too_great", "7.5", "e = 101", dict(mapping=1, e=101)),
            ("origin_too_small", "7.5", "an origin of 2^-101", dict(mapping=1, origin=(2.0 ** -101,))),
            ("origin_too_great", "7.5", "an origin of 2^101", dict(mapping=1, origin=(-2.0 ** 101,))),
            ("origin_not_a_number", "7.5", "an origin that is no number",
             dict(mapping=1, origin=(0.0, float("nan")))),
            ("draco_elsewhere", "7.2.1", "an opacity that is coded as only positions may be",
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
            ("truncated_opacity", "7.5", "mapping 2 of an opacity", dict(mapping=2))):
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
            ("zstd_skippable_behind", "7.2", "a skippable frame behind the frame",
             zstd_frame(b"123456789012") + struct.pack("<II", 0x184D2A50, 0)),
            ("zstd_legacy", "7.2.2", "a frame of format 0.7",
             b"\x27" + zstd_frame(b"123456789012")[1:]),
            ("zstd_without_size", "7.2.2", "a frame that does not state its content's size",
             framed(b"123456789012", window=0x50, size=None)),
            ("zstd_dictionary", "7.2.2", "a frame that needs dictionary 1",
             framed(b"123456789012", dictionary=1)),
            ("zstd_reserved_bit", "7.2.2", "a reserved bit in a frame's header",
             framed(b"123456789012", reserved=8))):
        must_fail(name, clause, about, changed(8, stored=stored))
    must_fail("zstd_size", "7.2.2", "a frame that states another size", changed(
        8, stored=zstd_frame(b"1234567", size=13)))
    must_fail("zstd_two_frames", "7.2", "a frame behind the frame", changed(
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
    must_fail("truncated_infinite", "7.5.3", "the bits of infinity",
           replaced(Stream(3, 2, 23, [[0, 0, 128]], origin=(1.0,))))
    must_fail("truncated_above_2_to_100", "7.5.3", "the least float above 2^100",
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
    sound = group([bytes([0, 1, 2])], [good.tables[0]], 3)
    words, state = struct.unpack_from("<II", sound)
    must_fail("group_cut", "A.6", "the last word is missing", plain(body=opacity(sound[:-2])))
    must_fail("group_without_sizes", "A.6", "three bytes", plain(body=opacity(sound[:3])))
    must_fail("state_too_low", "A.4", "a state of 65535",
           plain(body=opacity(struct.pack("<II", words, 65535) + sound[8:])))
    must_fail("word_left", "A.5", "a word more than is read",
           plain(body=opacity(struct.pack("<II", words + 1, state) + sound[8:] + b"\0\0")))
    must_fail("last_state", "A.5", "a block that ends elsewhere",
           plain(body=opacity(struct.pack("<II", words, state + 4096) + sound[8:])))
    must_fail("table_sum", "A.2", "frequencies beyond 4096",
           plain(body=Patched(good, table, bytes([2]) + b"\xff" * 6)))
    must_fail("table_padding", "A.2", "a bit behind a table", plain(
        body=Patched(good, table, with_byte(table, len(table) - 1, 128))))
    streams = float_streams(3, 0, 1)
    streams.append(Stream(0x8001, 0, 0, [[0, 0, 0]], 0, RANS, (8,)))
    must_fail("optional_rans", "6.5", "an optional stream that is rANS",
           plain(body=own_body(streams, 3)))
    row = good.streams[7].row()
    must_fail("table_not_there", "6.3", "table 1 of 1",
              plain(body=Patched(good, row, row[:-2] + b"\1\0")))


for make in (sound_lossless, sound_coded, sound_container, sound_growing, broken_growing, broken_rules,
             broken_header, broken_head, broken_index,
             broken_segment, broken_streams, broken_rans):
    make()


def write_all(folder):
    os.makedirs(folder, exist_ok=True)
    for v in VECTORS:
        with open(os.path.join(folder, v.name + ".stgs"), "wb") as file:
            file.write(v.data)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    if sys.argv[1] != "--update":
        write_all(sys.argv[1])
        return
    sys.path.insert(0, os.path.join(HERE, "../../spec/reference_decoder"))
    from container import Limits
    from decode import describe
    write_all(os.path.join(HERE, "vectors"))
    entries = []
    for v in VECTORS:
        lines, refused = describe(v.data, Limits(**v.limits))
        entry = {"name": v.name, "clause": v.clause, "about": v.about, "bytes": len(v.data),
                 "file": f"{checksum(v.data):016x}"}
        if v.reported:
            entry["reported"] = v.reported
        if v.limits:
            entry["limits"] = v.limits
        decoded = "".join(line + "\n" for line in lines if "refused" not in line)
        entry["decoded"] = f"{checksum(decoded.encode()):016x}"
        if v.fails:
            entry["refused"] = [line.split("refused")[0].strip() or "file" for line in lines
                                if "refused" in line]
        if set(refused) != ({v.clause} if v.fails else set()):
            print(f"{v.name}, {v.clause}: {lines}")
        entries.append(entry)
    with open(os.path.join(HERE, "manifest.json"), "w", encoding="utf-8") as file:
        json.dump({"format": "0.5", "vectors": entries}, file, indent=1)
        file.write("\n")
    print(f"{len(entries)} vectors, {sum(v.fails for v in VECTORS)} must fail, "
          f"{sum(len(v.data) for v in VECTORS)} bytes")


if __name__ == "__main__":
    main()
