# SPDX-License-Identifier: Apache-2.0
"""Valid heads, and records of the head that are not critical (2 to 4), importance (11.9)."""
import struct

from vector_file import File, Meta, Run, Segment, copy_record
from vector_list import further, must_report, plain, private, separate_sh, vector
from vector_records import Body, record, text
from vector_scenes import float_streams

NOTE = record(b"NOTE", b"hello", 0)
WINDOW = struct.pack("<IIQQ", 5, 100, 1 << 63, 2)


def bounds(*entries):  # 4.7
    return record(b"ERRB", struct.pack("<H", len(entries)) + b"".join(struct.pack("<Hff", *e) for e in entries), 0)


def valid_container():
    headers()
    metadata()
    asides()
    importance()


def headers():
    later = plain(degree=1, minor=9, flags=0xFFFF0000, first_records=NOTE,
                  last_records=record(b"PLUS", b"", 0) + record(b"WNDW", b"", 2),
                  tail=NOTE + record(b"SEGM", b"????????", 2), index_extra=b"later",
                  meta=Meta(profile=0, degree=1, extra=b"later"))
    vector("newer_minor", "2.2", "minor version 9, unknown flags, records and fields", later, validator=[116])
    vector("newer_profile", "4.2", "profile 9, which is only informative", plain(meta=Meta(profile=9)))
    vector("lossless_in_quantised", "11.1", "floats in a quantised file", plain(meta=Meta(profile=1)))
    vector("near_lossless", "11.1", "profile 3 with error bounds", plain(
        meta=Meta(profile=3), last_records=bounds((1, 0.5, 0.25), (8, 0.0, 0.0))))
    vector("unknown_records_of_one_tag", "3.4", "two unknown records of one tag in the head",
           plain(last_records=NOTE + NOTE))
    vector("copied", "10.2", "a copy of the head", plain(degree=1, copy=copy_record))


def metadata():
    vector("band_limited", "4.2", "kernel 1", plain(meta=Meta(profile=0, conventions=(1, 0, 0))))
    for name, conventions in (("shown_as_0", (128, 0, 255)), ("kernel_shown_as_0", (255, 0, 0)),
                              ("sh_shown_as_0", (0, 0, 128))):
        must_report(name, "4.2", f"kernel, axes and SH are {conventions}, displayed as 0",
                    plain(meta=Meta(profile=0, conventions=conventions)))
    for colour in ((9, 8), (12, 1), (1, 13)):
        vector(f"colour_{colour[0]}_{colour[1]}", "4.4", f"primaries {colour[0]}, transfer function {colour[1]}",
               plain(meta=Meta(profile=0, colour=colour, background=(0.5, 1.0, -0.25))))
    for colour in ((2, 13), (1, 2), (255, 0)):
        must_report(f"colour_{colour[0]}_{colour[1]}", "4.4", "unknown code points, displayed as 1 and 13",
                    plain(meta=Meta(profile=0, colour=colour)))
    vector("metres_and_up", "4.2", "the length of a unit, the up direction, the floor, a title, the near plane",
           plain(meta=Meta(profile=0, metres=0.25, up=(0.0, -0.6, 0.8), floor=(0.0, 1.5, 0.0), title="Stück 1",
                           near=0.0, time_base=(1001, 30000))))
    for name, length in (("up_long", 1.00099), ("up_short", 0.99901)):
        vector(name, "4.3", f"an up vector of length {length}", plain(meta=Meta(profile=0, up=(0, length, 0))))
    vector("audio", "4.6", "audio that begins before the timeline", plain(
        meta=Meta(profile=0, audio="../sound/st\u00fcck%20eins.opus", audio_begin=-2.5)))
    vector("audio_far", "4.3", "audio that begins at -2^32", plain(
        meta=Meta(profile=0, audio="a.opus", audio_begin=-2.0 ** 32)))
    vector("texts_of_all_lengths", "1.4", "UTF-8 of one to four bytes a character, and U+0000", plain(
        meta=Meta(profile=0, title="a\0\u00fc\u20ac\U0010ffff", generator="")))
    camera = dict(profile=0, size=(640, 480), lens=(500.0, 501.0, 320.0, 240.0), translation=(1, 2, 3),
                  rotation=(0, 0, 1, 0, 1, 0, -1, 0, 0))
    vector("start_camera", "4.2", "a start camera", plain(meta=Meta(**camera)))
    turned = Meta(**{**camera, "size": (32768, 1), "rotation": (0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6),
                     "lens": (2.0 ** -20, 2.0 ** -20, -5, 0)})
    vector("start_camera_turned", "4.3", "rotated about all axes, the greatest width, the least height", plain(meta=turned))
    for i, rotation in enumerate(((0, 1, 0, 0, 0, 1, 1, 0, 0), (0, 0, 1, 1, 0, 0, 0, 1, 0), (0, -1, 0, 1, 0, 0, 0, 0, 1),
                                  (1, 0, 0, 0, 0, -1, 0, 1, 0), (0, 0, -1, 0, 1, 0, 1, 0, 0))):
        vector(f"start_camera_turned_{i}", "4.3", "the axes of the camera are others of the world",
               plain(meta=Meta(**{**camera, "rotation": rotation})))
    loose = Meta(**{**camera, "rotation": (1.00049, 0, 0, 0.0009, 1, 0, 0, 0, 1)})
    vector("start_camera_loose", "4.3", "R R' differs by less than 0.001 from the identity", plain(meta=loose))
    point = Meta(profile=0, minimum=(1, 2, 3), maximum=(1, 2, 3), time_base=(1, 1), frames=1)
    vector("bounds_of_a_point", "4.3", "each minimum is its maximum", plain(meta=point))


def asides():
    vector("window", "4.5", "WNDW with additions", plain(last_records=record(b"WNDW", WINDOW + b"later", 0)))
    vector("window_to_the_end", "4.5", "a window that ends with its capture",
           plain(last_records=record(b"WNDW", struct.pack("<IIQQ", 70, 100, 1, 2), 0)))
    names = private((0, 0xC001, "org.example.heat"), (1, 0xC000, "org.example.profile"), (2, 192, "a"), (3, 5, "other"))
    vector("private_names", "3.5", "PRIV with an unknown kind, which is ignored", plain(last_records=names))
    longer = record(b"PRIV", struct.pack("<HHH", 1, 0, 0xC001) + text("a") + b"later", 0)
    vector("private_names_longer", "3.5", "PRIV with additions", plain(last_records=longer))
    vector("private_records", "3.5", "private records, skipped", plain(
        last_records=record(b"liGT", text("org.example.lights") + b"1", 0),
        tail=record(b"pose", text("org.example.poses"), 0)))
    vector("error_bounds", "4.7", "ERRB with a private attribute", plain(
        last_records=bounds((1, 0.5, 0.25), (9, 0.0, 0.0), (0xC001, 2.0, 1.0))))
    longer = record(b"ERRB", struct.pack("<HHff", 1, 7, 0.5, 0.25) + b"later", 0)
    vector("error_bounds_longer", "4.7", "ERRB with additions", plain(last_records=longer))
    vector("step", "11.9", "STEP before META", plain(first_records=record(b"STEP", b"opaque", 0)))
    vector("all_asides", "2.3", "WNDW, PRIV, STEP and ERRB in one head, of 4 records", plain(
        last_records=bounds() + private() + record(b"STEP", b"", 0) + record(b"WNDW", WINDOW, 0)))
    vector("flagged_asides", "3.4", "WNDW, PRIV, ERRB and an unknown record with flag bit 1, skipped", plain(
        last_records=b"".join(record(tag, b"", 2) for tag in (b"WNDW", b"PRIV", b"ERRB", b"NOTE"))))
    vector("body_tags_in_the_head", "3.4", "IMPO and COPY in the head, skipped", plain(
        last_records=record(b"IMPO", b"", 0) + record(b"COPY", b"", 0)))


def importance():
    values = record(b"IMPO", struct.pack("<3f", 0.5, 0, 3), 0)
    vector("importance", "11.9", "IMPO after an unknown record", plain(tail=NOTE + values))
    vector("importance_before_others", "11.9", "IMPO before an unknown record and COPY",
           plain(tail=values + NOTE, copy=copy_record))
    vector("importance_twice", "11.9", "the first of two IMPO records is used",
           plain(tail=values + record(b"IMPO", struct.pack("<3f", 1, 1, 1), 0)), validator=[114])
    vector("importance_flagged", "11.9", "an IMPO record with flag bit 1, skipped",
           plain(tail=record(b"IMPO", b"", 2) + values))
    parts = [Run([Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)])]), Run([Segment(0, 1, [
        Body(float_streams(1, 0, 3, 2.5, 5), 1)])])]
    vector("importance_of_runs", "11.9", "IMPO after the last run of the file, which INDX lists first",
           File(list(reversed(parts)), Meta(profile=0), body=[*parts, record(b"IMPO", struct.pack("<3f", 1, 2, 3), 0)]))
    wrong = record(b"IMPO", struct.pack("<3f", 9, 9, 9), 0)
    parts = [Run([Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)])]), Run([Segment(0, 1, [
        Body(float_streams(1, 0, 3, 2.5, 5), 1)])])]
    vector("importance_between_runs", "11.9", "an IMPO record before the last SEGM record is not used",
           File(list(reversed(parts)), Meta(profile=0), body=[parts[0], wrong, parts[1], values]))
    segment = separate_sh()
    segment.further = [further(200 << 8, 0, 30)]
    vector("importance_after_further_records", "11.9", "IMPO after a further record", File(
        [Run([segment])], Meta(profile=0, degree=1), tail=values, last_records=private((2, 200, "org.example.sound"))))
