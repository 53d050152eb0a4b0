# SPDX-License-Identifier: Apache-2.0
"""Heads and importance that break a rule (2 to 4, 11.9)."""
import struct

from vector_file import Meta
from vector_list import flipped, must_fail, must_report, plain, private
from vector_records import record, text
from vectors_container import WINDOW, bounds

NAN, INFINITE = float("nan"), float("inf")


def broken_head():
    tags_and_flags()
    twice()
    metadata()
    camera()
    asides()
    importance()


def tags_and_flags():
    for tag in (b"META", b"LAYT", b"INDX"):
        layouts = struct.pack("<HH", 0, 0) if tag == b"LAYT" else None
        for flags in (0, 2):
            must_fail(f"{tag.decode().lower()}_flags_{flags}", "3.3", f"{tag.decode()} with flags {flags}",
                      plain(record_flags={tag: flags}, layouts=layouts))
        must_fail(f"{tag.decode().lower()}_flags_3", "3.4", f"{tag.decode()} with flags 3",
                  plain(record_flags={tag: 3}, layouts=layouts))
    must_fail("meta_flags_3_damaged", "10.2", "META with flags 3 and a damaged payload", flipped(
        plain(record_flags={b"META": 3}).bytes(), 60), clause_of="3.1")
    must_fail("unknown_flags_3", "3.4", "a record of an unknown tag with flags 3", plain(last_records=record(b"NEWS", b"", 3)))
    must_fail("unknown_flag_31", "3.4", "INDX with flag bit 31", plain(record_flags={b"INDX": 1 << 31 | 1}))
    for tag in (b"SEGM", b"FRAG", b"PAGE"):
        for flags, clause in ((0, "3.3"), (1, "3.4")):
            must_fail(f"{tag.decode().lower()}_in_the_head_{flags}", clause, f"{tag.decode()} with flags {flags} in the head",
                      plain(last_records=record(tag, bytes(12), flags)))
    must_fail("critical_unknown_damaged", "10.2", "a damaged payload of an unknown critical record, without a copy",
              flipped(plain(first_records=record(b"NEWS", b"hello")).bytes(), 32 + 24), clause_of="3.1")
    for tag, about in ((b"NEWS", "of an unknown tag"), (b"liGT", "of a private tag"), (b"WNDW", "WNDW"),
                       (b"PRIV", "PRIV"), (b"COPY", "COPY")):
        must_fail(f"critical_{tag.decode()}".lower(), "3.4", f"a critical record, {about}", plain(
            last_records=record(tag, text("org.example.lights"))))


def twice():
    for tag in (b"META", b"LAYT", b"INDX"):
        payload = {b"META": Meta(profile=0).payload(), b"LAYT": struct.pack("<HH", 0, 0), b"INDX": b"\0\0\0\0"}[tag]
        layouts = struct.pack("<HH", 0, 0) if tag == b"LAYT" else None
        must_fail(f"two_{tag.decode().lower()}", "2.3", f"{tag.decode()} twice",
                  plain(last_records=record(tag, payload), layouts=layouts))
    for name, first, second in (("wndw", record(b"WNDW", WINDOW, 0), record(b"WNDW", bytes(24), 0)),
                                ("priv", private((0, 0xC001, "a")), private((0, 0xC001, "b"))),
                                ("errb", bounds((1, 1.0, 0.5)), bounds((1, 2.0, 0.5))),
                                ("step", record(b"STEP", b"1", 0), record(b"STEP", b"2", 0))):
        must_report(f"two_{name}", "2.3", f"{name.upper()} twice: the second is ignored", plain(last_records=first + second))
    must_fail("no_index", "2.3", "META alone", plain(order=(b"META",)))
    must_fail("no_metadata", "2.3", "INDX alone", plain(order=(b"INDX",)))
    must_fail("index_before_meta", "2.3", "INDX first", plain(order=(b"INDX", b"META")))


def metadata():
    good = Meta(profile=0).payload()
    for name, size in (("numbers", 131), ("generator", 138), ("title", 146), ("audio", len(good) - 9), ("end", len(good) - 1),
                       ("nothing", 0)):
        meta = Meta(profile=0)
        meta.payload = lambda size=size: good[:size]
        must_fail(f"meta_short_{name}", "4.2", f"META ends after {size} bytes", plain(meta=meta))
    longer = Meta(profile=0)
    longer.payload = lambda: good[:132] + struct.pack("<I", 1 << 31) + good[136:]
    must_fail("meta_long_text", "4.2", "a text of 2^31 bytes", plain(meta=longer))
    for name, conventions in (("kernel_2", (2, 0, 0)), ("kernel_127", (127, 0, 0)), ("axes_1", (0, 1, 0)),
                              ("axes_128", (0, 128, 0)), ("sh_1", (0, 0, 1)), ("sh_127", (0, 0, 127))):
        must_fail(name, "4.2", f"kernel, axes and SH are {conventions}", plain(meta=Meta(profile=0, conventions=conventions)))
    for name, about, more in (
            ("no_frames", "a duration of 0", dict(frames=0)), ("numerator_0", "a numerator of 0", dict(time_base=(0, 1))),
            ("denominator_0", "a denominator of 0", dict(time_base=(1, 0))), ("degree_4", "SH degree 4", dict(degree=4)),
            ("near_below_0", "a near plane below 0", dict(near=-1.0)),
            ("metres_below_0", "a unit of -1 m", dict(metres=-1))):
        must_fail(name, "4.2", about, plain(meta=Meta(profile=0, **more)))
    zero = (0.0, 0.0, 0.0)
    for name, more in (("background", dict(background=(0, 0, INFINITE))), ("minimum", dict(minimum=(NAN, 0, 0))),
                       ("minimum_infinite", dict(minimum=(-INFINITE, 0, 0))), ("maximum", dict(maximum=(200, 200, INFINITE))),
                       ("near", dict(near=NAN)), ("near_infinite", dict(near=INFINITE)), ("metres", dict(metres=NAN)),
                       ("metres_infinite", dict(metres=INFINITE)), ("up", dict(up=(NAN, 0, 0))),
                       ("floor", dict(floor=(0, -INFINITE, 0))), ("rotation", dict(rotation=(NAN, *[0] * 8))),
                       ("translation", dict(translation=(0, 0, INFINITE))), ("lens", dict(lens=(1, 1, 0, NAN)))):
        must_fail(f"not_finite_{name}", "4.3", f"{name.split('_')[0]} is not finite", plain(meta=Meta(profile=0, **more)))
    for axis in range(3):
        low, high = list(zero), list(zero)
        low[axis], high[axis] = 1.0, 0.5
        must_fail(f"bounds_inverted_{'xyz'[axis]}", "4.3", "a minimum above its maximum", plain(meta=Meta(
            profile=0, minimum=low, maximum=high)))
    for name, length in (("long", 1.00101), ("short", 0.99899), ("tiny", 2.0 ** -140)):
        must_fail(f"up_too_{name}", "4.3", f"an up vector of length {length}", plain(meta=Meta(profile=0, up=(0, length, 0))))
    for name, value in (("far", 2.0 ** 33), ("far_before", -2.0 ** 32 - 2), ("never", NAN)):
        must_fail(f"audio_too_{name}", "4.3", f"audio begins at {value}", plain(meta=Meta(profile=0, audio_begin=value)))
    for name, about, more in (
            ("surrogate", "U+D800", dict(generator=b"\xed\xa0\x80")), ("cut", "a character that is cut off", dict(audio=b"a\xe2\x82")),
            ("long_form", "'/' in two bytes", dict(title=b"\xc0\xaf")), ("beyond", "U+110000", dict(title=b"\xf4\x90\x80\x80")),
            ("byte", "\\xff", dict(generator=b"\xff"))):
        must_fail(f"text_{name}", "1.4", f"a text that is not UTF-8: {about}", plain(meta=Meta(profile=0, **more)))


def camera():
    good = dict(profile=0, size=(4, 4), lens=(1, 1, 0, 0))
    identity = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    for name, about, more in (
            ("no_width", "a width of 0", dict(size=(0, 4))), ("no_height", "a height of 0", dict(size=(4, 0))),
            ("wide", "a width of 32769", dict(size=(32769, 4))), ("high", "a height of 32769", dict(size=(4, 32769))),
            ("fx", "fx = 0", dict(lens=(0, 1, 0, 0))), ("fy", "fy = 0", dict(lens=(1, 0, 0, 0))),
            ("fx_below_0", "fx < 0", dict(lens=(-1, 1, 0, 0))), ("fy_below_0", "fy < 0", dict(lens=(1, -1, 0, 0))),
            ("mirrors", "det R < 0", dict(rotation=(-1, 0, 0, 0, 1, 0, 0, 0, 1))),
            ("mirrors_turned", "det R < 0", dict(rotation=(0.36, 0.48, -0.8, 0.8, -0.6, 0.0, 0.48, 0.64, 0.6))),
            ("mirrors_cyclically", "det R < 0", dict(rotation=(0, 0, -1, 1, 0, 0, 0, 1, 0))),
            ("mirrors_back", "det R < 0", dict(rotation=(0, -1, 0, 0, 0, 1, 1, 0, 0))),
            ("mirrors_axis_2", "det R < 0", dict(rotation=(1, 0, 0, 0, 0, 1, 0, 1, 0))),
            ("mirrors_axis_3", "det R < 0", dict(rotation=(0, 0, 1, 0, 1, 0, 1, 0, 0))),
            ("mirrors_permuted", "det R < 0", dict(rotation=(0, 1, 0, 1, 0, 0, 0, 0, 1))),
            ("mirrors_small", "det R = -0.9994", dict(rotation=(-0.9998, 0, 0, 0, 0.9998, 0, 0, 0, 0.9998))),
            ("of_zeros", "R = 0", dict(rotation=(0,) * 9))):
        must_fail(f"camera_{name}", "4.3", about, plain(meta=Meta(**{**good, **more})))
    for i in range(9):
        for sign in (1, -1):
            skewed = list(identity)
            skewed[i] += sign * (0.00052 if i % 4 == 0 else 0.00102)
            must_fail(f"camera_skewed_{i}_{'up' if sign > 0 else 'down'}", "4.3", "R R' differs from the identity by more "
                      "than 0.001", plain(meta=Meta(**good, rotation=tuple(skewed))))


def asides():
    must_report("window_short", "4.5", "WNDW of 23 bytes", plain(last_records=record(b"WNDW", bytes(23), 0)))
    must_report("window_outside", "4.5", "a training window outside its capture",
                plain(last_records=record(b"WNDW", struct.pack("<IIQQ", 71, 100, 1, 2), 0)))
    must_report("private_names_cut", "3.5", "a count of 2, one name",
                plain(last_records=record(b"PRIV", b"\2\0\0\0\1\xc0" + text("a"), 0)))
    must_report("private_name_empty", "3.5", "no name", plain(last_records=private((0, 0xC001, ""))))
    must_report("private_name_empty_of_another_kind", "3.5", "no name of an unknown kind", plain(last_records=private((7, 1, ""))))
    must_report("private_name_not_utf8", "1.4", "a name of \\xff", plain(last_records=private((0, 0xC001, b"\xff"))))
    must_report("private_and_window_short", "3.5", "PRIV, WNDW and ERRB are too short", plain(last_records=b"".join(
        record(tag, b"\1", 0) for tag in (b"PRIV", b"WNDW", b"ERRB"))))
    must_report("error_bounds_cut", "4.7", "a count of 2, one entry", plain(
        last_records=record(b"ERRB", struct.pack("<HHff", 2, 1, 0.5, 0.25), 0)))
    for name, entry in (("greatest", (1, -0.5, 0.25)), ("mean", (1, 0.5, -0.25)), ("infinite", (1, INFINITE, 0.25)),
                        ("mean_infinite", (1, 0.5, INFINITE)), ("nan", (1, NAN, 0.25)), ("mean_nan", (1, 0.5, NAN))):
        must_report(f"error_bounds_{name}", "4.7", f"an entry of {entry}", plain(last_records=bounds((2, 1.0, 0.5), entry)))


def importance():
    for name, count in (("short", 2), ("long", 4)):
        must_fail(f"importance_{name}", "11.9", f"{count} values for 3 primitives",
                  plain(tail=record(b"IMPO", struct.pack(f"<{count}f", *[1] * count), 0)))
    for name, value in (("below_0", -1.0), ("nan", NAN), ("infinite", INFINITE)):
        must_fail(f"importance_{name}", "11.9", f"an importance of {value}",
                  plain(tail=record(b"IMPO", struct.pack("<3f", 1, 1, value), 0)))
    values = record(b"IMPO", struct.pack("<3f", 1, 2, 3), 0)
    note = record(b"NOTE", b"hello", 0)
    for name, about, tail, clause in (
            ("damaged", "a flipped bit in IMPO", flipped(values, 25), "3.1"),
            ("header_damaged", "a flipped bit in IMPO's header", flipped(values, 8), "3.1"),
            ("behind_damage", "a flipped bit in the header of a record before IMPO", flipped(note, 21) + values, "3.1"),
            ("behind_bytes", "five bytes after the last segment", b"bytes", "3.2"),
            ("behind_a_long_record", "a record that extends past the file", note[:-1], "3.2")):
        must_fail(f"importance_{name}", "11.9", about, plain(tail=tail), clause_of=clause)
