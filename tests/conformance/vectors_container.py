# SPDX-License-Identifier: Apache-2.0
"""Valid containers: head, index, parts, further records, private numbers (2 to 5)."""
import struct

from vector_file import Body, File, Meta, Part, Segment, Stream, bits_of, record, text
from vector_list import further_header, plain, private, vector, flipped
from vector_scenes import coded_streams, float_streams, own_body


def valid_container():
    note = record(b"NOTE", b"hello", 0)
    later = plain(degree=1, minor=9, flags=0x10000, first_records=note, last_records=record(b"INDX", b"", 2),
                  tail=note + record(b"SEGM", b"????????", 2), index_extra=b"later",
                  meta=Meta(profile=0, degree=1, extra=b"later"))
    vector("newer_minor", "2.5", "minor version 9, unknown flags, records and fields", later)
    vector("newer_profile", "4.2", "profile 9, which is only informative", plain(meta=Meta(profile=9)))
    vector("shown_as_0", "4.2", "kernel, colour and SH numbers that may be displayed as 0",
           plain(meta=Meta(profile=0, conventions=(128, 0, 200, 255))))
    vector("metres_and_up", "4.3", "the length of a unit, the up direction, the floor",
           plain(meta=Meta(profile=0, metres=0.25, up=(0.0, -0.6, 0.8), floor=(0.0, 1.5, 0.0))))
    vector("sound_beside", "4.6", "audio that begins before the timeline", plain(
        meta=Meta(profile=0, audio="../sound/st\u00fcck%20eins.opus", audio_begin=-2.5)))
    with_camera = Meta(profile=0, size=(640, 480), lens=(500.0, 500.0, 320.0, 240.0),
                rotation=(0, 0, 1, 0, 1, 0, -1, 0, 0))
    vector("start_camera", "4.3", "a start camera", plain(meta=with_camera))
    window = struct.pack("<IIQQ", 5, 100, 1, 2)
    vector("window", "4.5", "WNDW", plain(last_records=record(b"WNDW", window + b"later", 0)))
    vector("importance", "5.11", "IMPO after an unknown record", plain(
        tail=note + record(b"IMPO", struct.pack("<3f", 0.5, 0, 3), 0)))
    parts = [Part([Segment(-1, 0, [Body(float_streams(2, 0, 3, 0, 15), 2)])], 0, 14.5),
             Part([Segment(-1, 0, [own_body(coded_streams(3, 0, 3, segment_time=False), 3)]),
                   Segment(0, 0, [own_body(coded_streams(2, 0, 4), 2)])], 14.5, 30, note)]
    vector("parts", "5.10", "two parts, a record between them", File(parts, Meta()))
    far = 1 << 20
    late = [Segment(-1, 0, [own_body(coded_streams(3, 0, 3), 3)]),
            Segment(0, 11, [own_body(coded_streams(2, 0, 4), 2)])]
    vector("late_part", "7.5.8", "mapping 7 in a part from tick 2^20 on that ends within its segment",
           File([Part(late, far, far + 30)], Meta(frames=far + 30)))
    shown = [Part([Segment(-1, 0, [Body(float_streams(2, 0, 3, 0, 20), 2)])], -5, 15.5, cut=(0, 12.25)),
             Part([Segment(0, 3, [own_body(coded_streams(2, 0, 4), 2)])], 2.5, 1000, cut=(12.25, 40))]
    vector("parts_cut", "5.10", "parts that begin before the timeline or end after it, each displayed partially",
           File(shown, Meta()))
    joined = [Part([Segment(0, 2, [own_body(coded_streams(3, 0, 3), 3)])], 0, 15),
              Part([Segment(-1, 0, [Body(float_streams(2, 0, 3, 0, 15), 2)]),
                    Segment(1, 2, [own_body(coded_streams(2, 0, 4), 2)]),
                    Segment(1, 3, [Body(float_streams(1, 0, 5, 7.5, 5), 1)])], 15, 30, cut=(15, 29),
                   chunk=2.5 + 2.0 ** -20)]
    vector("parts_of_two_chunks", "5.3", "joined clips with two chunk lengths: intervals, order and times use the part's own",
           File(joined, Meta()))
    longest = Part([Segment(-1, 0, [Body(float_streams(2, 0, 3, 2.0 ** 31, 20), 2)])], -2.0 ** 31, 2.0 ** 31)
    before = Part([Segment(-1, 0, [Body(float_streams(1, 0, 4), 1)])], -30, 0)
    vector("part_of_2_to_32", "5.3", "the longest part; one that is never displayed",
           File([longest, before], Meta(profile=0)))
    alone = [Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)]),
             Segment(0, 2, [], further=[(200 << 8, further_header(200 << 8, 0, 2) + struct.pack("<dd", 5, 9.5) +
                                         text("audio/opus") + b"sound")])]
    audio_names = private((2, 200, "org.example.sound"))
    vector("timed_data_alone", "5.13", "a segment of no primitives",
           File([Part(alone)], Meta(profile=0), last_records=audio_names))
    for name, about, first, last in (("timed_data_early", "it begins before its segment", 4.5, 9),
                                     ("timed_data_late", "it ends after its segment", 5, 10.5),
                                     ("timed_data_backwards", "it ends before it begins", 8, 7)):
        payload = further_header(200 << 8, 0, 2) + struct.pack("<dd", first, last) + text("audio/opus")
        wrong = Segment(0, 2, [], further=[(200 << 8, payload)])
        vector(name, "5.13", about, File([Part([wrong])], Meta(profile=0), last_records=audio_names),
               reported=[315])
    wrong = Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)],
                    further=[(513, further_header(513)), (512, further_header(512))])
    vector("further_records_out_of_order", "5.13", "layer 513 before layer 512",
           File([Part([wrong])], Meta(profile=0)), reported=[303])
    further = Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)],
                      further=[(512, further_header(512) + b"new"), (0xBF07, further_header(0xBF07))])
    vector("further_records", "5.7", "contents 2 and 191, ignored", File([Part([further])], Meta(
        profile=0)))
    audio = struct.pack("<dd", 0.0, 12.5) + text("audio/opus") + bytes(range(40))
    lights = text("org.example.lights")
    names = private((0, 0xC005, "org.example.heat"), (1, 0xC001, "org.example.rig"),
                    (2, 200, "org.example.sound"), (9, 1, "later"))
    streams = float_streams(2, 0, 3)
    streams.insert(4, Stream(0xC005, 0, 0, [[1, 2]], stored=b"warm"))
    timed = Segment(-1, 0, [Body(streams, 2)], further=[(200 << 8, further_header(200 << 8) + audio)])
    vector("private_numbers", "3.5", "an attribute, a profile, a content of timed data, records",
           File([Part([timed])], Meta(profile=0xC001), first_records=record(b"liGT", lights + b"?", 0),
                last_records=names + record(b"priv", lights, 0), tail=record(b"zzzz", lights, 0)))
    unnamed = File([Part([timed])], Meta(profile=0xC001))
    vector("private_numbers_unnamed", "3.5", "the same numbers without PRIV", unnamed,
           reported=[117] * 3)
    for name, field in (("head_last", "last_records"), ("tail", "tail")):
        vector(f"private_record_unnamed_{name}", "3.5", "a private record without a name",
               plain(**{field: record(b"liGT", b"\0\0\0\0", 0)}), reported=[117])
    wrong = Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)], further=[(512, further_header(513))])
    vector("further_record_of_another_layer", "5.13", "it states another layer than the index",
           File([Part([wrong])], Meta(profile=0)), reported=[400])
    vector("unknown_record_damaged", "3.1", "a record of the head that readers skip",
           plain(first_records=flipped(record(b"NOTE", b"hello", 0), 34)), reported=[112])
    vector("empty", "5.2", "no primitives, no parts", File([]))
    vector("attribute_totals", "5.2", "totals of an unknown attribute, and two of one attribute",
           plain(totals=((1, 36), (0x8001, 1 << 40), (1, 2))))
    moved = [Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)]),
             Segment(30, 0, [Body(float_streams(1, 0, 3), 1)])]
    late = float_streams(1, 0, 3)
    for attribute, value in ((2, 204802.5), (3, 0.25), (4, 1.8496), (8, 0.0)):
        late[attribute - 1].v[0] = [bits_of(value)]
    vector("support_near_its_end", "5.8", "visible until a tenth of a tick before its interval ends, late in the file",
           File([Part([Segment(0, 81920, [Body(late, 1)])], 0, 300000)], Meta(profile=0, frames=300000)))
    vector("level_30", "5.4", "the level with the longest segments", File([Part(moved)]))
