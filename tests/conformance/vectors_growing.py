# SPDX-License-Identifier: Apache-2.0
"""Growing files (9)."""
import struct

from vector_file import Meta, Run, Segment
from vector_growing import Fragment, Recording, growing, recording
from vector_list import flipped, further, must_fail, must_report, private, separate_sh, vector
from vector_records import Body, number, record
from vector_scenes import float_streams


def recorded(count, n=1):
    """Returns fragments that add a part of 10 ticks each, with rows of a shared layout."""
    return [Fragment([recorded_run(i, n)]) for i in range(count)]


def recorded_run(i, n=1, **more):
    body = Body(float_streams(n, 0, 10 + i, 1, 8), n)
    return Run([Segment(-1, 0, [body])], 10 * i, 10 * i + 10, part=i, **more)


def short_run(i):
    """Returns a run with a record of a layout that LAYT has."""
    body = Body(float_streams(1, 0, 10 + i, 1, 8), 1, layout=0)
    return Run([Segment(-1, 0, [body])], 10 * i, 10 * i + 10, part=i)


def layt():
    return record(b"LAYT", struct.pack("<HH", 0, 1) + b"\x09" + b"".join(s.row() for s in float_streams(1, 0, 1)))


def many(count):
    return recording([Fragment([short_run(i)]) for i in range(count)], last_records=layt())


def valid_growing():
    vector("growing_empty", "9.4", "a recording before its first fragment", growing([]))
    vector("growing", "9.1", "three fragments", growing(recorded(3)))
    vector("growing_17", "9.3", "17 fragments: the 16th links to 15 others", many(17).out)
    vector("growing_34", "9.3", "34 fragments, with earlier links", many(34).out)
    vector("growing_lasting", "9.2", "content that lasts longer than the recording is stored once",
           growing([Fragment([Run(recorded_run(0).segments, 0, 1 << 20)], frames=10), *recorded(3)[1:]]))
    vector("growing_newer_flags", "9.2", "flags of 16 and above are ignored",
           growing([*recorded(1), Fragment([recorded_run(1)], flags=0xFFFF0000)]))
    vector("growing_newer_file_flags", "2.2", "a growing file with unknown flags of 16 and above",
           growing(recorded(2), flags=0xFFFF0001))
    importance = record(b"IMPO", struct.pack("<f", 1), 0)
    vector("growing_importance", "9.1", "IMPO in a recording, which is not read", growing(
        [*recorded(1), Fragment([], importance)]), validator=[313])
    vector("growing_longer", "9.2", "additions after the node", growing([*recorded(1), Fragment([recorded_run(1)], extra=b"later")]))
    vector("growing_closed", "9.2", "a closed recording", growing([*recorded(2), Fragment([], flags=1)]))
    vector("growing_closed_newer", "9.2", "a closed recording whose last fragment has unknown flags of 16 and above",
           growing([*recorded(2), Fragment([], flags=0xFFFF0001)]))
    vector("growing_one_frame", "9.2", "a duration of one frame, and a first fragment without records",
           growing([Fragment([], frames=1)]))
    vector("growing_bounds", "9.2", "the bounds and the total of the last fragment",
           growing([*recorded(1), Fragment([recorded_run(1)], bounds=(-1, 0, 1, -1, 2, 3), total=99)]), validator=[306])
    vector("growing_window", "4.5", "WNDW is within its capture: the duration is that of the last fragment",
           growing(recorded(3), last_records=record(b"WNDW", struct.pack("<IIQQ", 70, 100, 1, 2), 0)))
    must_report("growing_window_outside", "4.5", "WNDW is outside its capture because of the last fragment",
                growing(recorded(3), last_records=record(b"WNDW", struct.pack("<IIQQ", 71, 100, 1, 2), 0)))
    complete, shorter = growing(recorded(3)), growing(recorded(2))
    for name, size in (("record", len(shorter) + 100), ("header", len(shorter) + 7), ("fragment", len(complete) - 1)):
        vector(f"growing_cut_in_a_{name}", "9.4", "read up to the last complete fragment", complete[:size])
    vector("growing_note", "9.4", "an unknown record before each fragment's own", growing(
        [Fragment([recorded_run(i)], record(b"NOTE", bytes([i] * 9), 0)) for i in range(2)]), validator=[313])
    first = growing(recorded(2))
    third = growing(recorded(3))
    third = third[third.rindex(b"FRAG"):]
    vector("foreign_fragment", "9.4", "another file's FRAG record within an unknown record",
           first + record(b"NOTE", third, 0))
    layer = 200 << 8
    runs = [recorded_run(0), Run([Segment(0, 2, [], further=[further(layer, 5, 9.5, level=0, slot=2)])], 10, 20, part=1)]
    runs[0].segments[0].further = [further(layer, 0, 10)]
    vector("growing_further_records", "5.7", "audio in every fragment, including one without primitives",
           growing([Fragment([run]) for run in runs], last_records=private((2, 200, "org.example.sound"))))
    nested()
    last_fragments()


def fragment_sizes(data):
    """Returns the sizes of the payloads of a recording's FRAG records."""
    return [struct.unpack_from("<Q", data, i + 8)[0] for i in range(len(data)) if data.startswith(b"FRAG", i)]


def nested():
    """Links in nodes and earlier links, with explicit shapes."""
    made = Recording()
    written = [made.add(f) for f in recorded(2)]
    node = [written[0].link()]
    made.add(Fragment([recorded_run(2)], links=node, earlier=[written[1].link()]))
    vector("growing_links", "9.2", "a link in the node, and an earlier link", made.out)
    deep = Recording()
    last = None
    for i in range(9):
        last = deep.add(Fragment([recorded_run(i)] if i % 4 == 0 else [], links=[last.link(times=(0.0, 90.0))] if last else [], earlier=[]))
    vector("growing_eight_deep", "5.2", "eight links that follow each other", deep.out)
    deep.add(Fragment([], links=[last.link(times=(0.0, 90.0))], earlier=[]))
    must_fail("growing_nine_deep", "5.2", "nine links that follow each other: the last is not followed", deep.out)
    for i in (8, 9):  # the last link is an earlier one
        deep = Recording()
        last = None
        for k in range(i):
            last = deep.add(Fragment([recorded_run(0)] if k == 0 else [],
                                     links=[last.link(times=(0.0, 10.0))] if last else [], earlier=[]))
        deep.add(Fragment([], links=[], earlier=[last.link(times=(0.0, 10.0))]))
        (vector if i == 8 else must_fail)(f"growing_{i}_deep_earlier", "5.2", f"an earlier link, and {i - 1} links that follow "
                                          "it", deep.out)
    earlier = Recording()
    written = [earlier.add(f) for f in recorded(2)]
    hidden = earlier.add(Fragment([recorded_run(2)], earlier=[written[0].link(), written[1].link()]))
    earlier.add(Fragment([recorded_run(3)], links=[], earlier=[hidden.link()]))
    vector("growing_earlier_not_followed", "9.3", "a link does not lead to the earlier links of a fragment", earlier.out,
           validator=[313])


def last_fragments():
    """Which fragment is the last one (9.4)."""
    for name, about, more in (
            ("offset", "another offset", dict(offset=1)), ("flags", "flags 0 of the record", dict(record_flags=0)),
            ("head", "another head", dict(head=bytes(40))), ("length", "another length at its end", dict(length=1)),
            ("frames", "0 frames", dict(frames=0)), ("bounds", "inverted bounds", dict(bounds=(1, 0, 0, 0, 0, 0))),
            ("nan", "bounds that are not numbers", dict(bounds=(float("nan"), 0, 0, 0, 0, 0))),
            ("links", "a link to a later record", dict(earlier=[struct.pack("<dd", 0, 1) + b"\xff\x7f\0\1"])),
            ("record_flags", "flags 3 of the record", dict(record_flags=3))):
        fragments = [*recorded(2), Fragment([recorded_run(2)], **more)]
        (vector if name == "offset" else must_report)(f"fragment_invalid_{name}", "9.4", f"the last FRAG record states {about}: the one before is the last "
               "fragment", growing(fragments))
    run = recorded_run(2)
    run.shift = 1000
    must_report("fragment_invalid_run", "9.4", "a run of the last FRAG record extends past it: the one before is the last "
           "fragment", growing([*recorded(2), Fragment([run])]))
    must_fail("fragment_flags", "9.2", "an unknown flag of the last fragment",
              growing([*recorded(1), Fragment([recorded_run(1)], flags=2)]))
    must_fail("fragment_flags_15", "9.2", "flag 15 of the last fragment",
              growing([*recorded(1), Fragment([recorded_run(1)], flags=0x8000)]))
    vector("fragment_flags_before", "9.2", "an unknown flag of an earlier fragment",
           growing([Fragment([recorded_run(0)], flags=2), *recorded(2)[1:]]), validator=[113])
    vector("fragment_closed_before", "9.2", "an earlier fragment is marked closed",
           growing([Fragment([recorded_run(0)], flags=1), *recorded(2)[1:]]), validator=[313])
    must_report("growing_after_the_end", "9.4", "bytes after a closed fragment",
                growing([*recorded(1), Fragment([], flags=1)], b"x"))
    vector("growing_more_frames_before", "9.2", "20 frames, then 15", growing(
        [*recorded(2), Fragment([recorded_run(2)], frames=15)]), validator=[313])
    must_report("fragment_of_seven_bytes_less", "9.2", "the size at the end of the last FRAG record begins in its node: the one "
           "before is the last fragment", overlapping_size(), clause_of="9.4")
    data = growing(recorded(3))
    first = data.index(b"FRAG")
    tail = record(b"NOTE", struct.pack("<Q", len(data) + 32 - 24 - first), 0)
    vector("fragment_located_by_other_bytes", "9.4", "the last 8 bytes of an unknown record locate the first FRAG record, "
           "which does not end with the file", data + tail)
    vector("fragment_like_bytes", "9.4", "bytes after the last fragment that look like a record of 2^64 - 1 bytes",
           data + record(b"NOTE", b"FRAG\1\0\0\0" + b"\xff" * 16, 0))
    # A valid fragment within the last one: the one that ends with the file is the last (9.4).
    probe = recording(recorded(1))
    probe.add(Fragment([recorded_run(1)], extra=b"12345678"))
    within = probe.out.rindex(b"12345678") - 8
    data = fragment_within(within)
    vector("fragment_within_a_fragment", "9.4", "a valid FRAG record within the additions of the last one", data)
    must_fail("limit_of_a_fragment_around", "conformance 1.5", "the last FRAG record exceeds the limit, the valid one within its "
              "additions does not", data, {"max_memory": int.from_bytes(data[-8:], "little") - 1})
    data = growing(recorded(2))
    last = data.rindex(b"FRAG")
    for name, at in (("tag", last), ("length", last + 8), ("header_checksum", last + 20), ("payload", last + 24 + 12)):
        must_report(f"fragment_last_{name}_flipped", "9.4", f"a flipped bit of the last FRAG record: {name.replace('_', ' of the ')}",
                    flipped(data, at))
    must_report("fragment_only_flipped", "9.4", "a flipped bit of the only FRAG record", flipped(growing(recorded(1)), -20))
    for size, about in ((39, "too few"), (40, "enough")):
        cut = data[:last] + data[last:last + 24 + size - 8] + struct.pack("<Q", size)
        (vector if size < 40 else must_report)(
            f"fragment_last_of_{size}_bytes", "9.4",
            f"a damaged FRAG record, by its last 8 bytes, of {size} bytes: {about}", flipped(cut, last))
    empty = growing([Fragment([])])
    must_report("fragment_first_tag_flipped", "9.4", "a flipped bit of the tag of a FRAG record with which the body begins",
                flipped(empty, empty.rindex(b"FRAG")))
    must_report("fragment_tag", "9.4", "a record of another tag with the payload of a FRAG record at the end", data[:last] + record(
        b"FRAX", data[last + 24:]))


def overlapping_size():
    """Returns a recording whose last FRAG record lacks the count of its runs: the first byte of its size, 0, takes its
    place."""
    for length in range(256):
        made = recording(recorded(1), meta=Meta(profile=0, frames=1, generator="g" * length))
        payload = struct.pack("<QII6f", len(made.out), 5, 0, *[0.0] * 6) + number(0)
        payload += struct.pack("<I", len(made.head)) + made.head + b"\0\0"
        if (len(payload) + 8) % 256 == 0:
            return made.out + record(b"FRAG", payload + struct.pack("<Q", len(payload) + 8))
    raise ValueError("no such length")


def fragment_within(at):
    """Returns a recording whose last FRAG record contains another one at `at`."""
    for guess in range(at - 64, at + 64):
        made = recording(recorded(1))
        payload = struct.pack("<QII6f", guess, 5, 0, *[0.0] * 6) + number(0) + struct.pack("<I", len(made.head))
        payload += made.head + b"\0\0\0"
        inner = record(b"FRAG", payload + struct.pack("<Q", len(payload) + 8))
        made.add(Fragment([recorded_run(1)], extra=inner))
        if made.out.rindex(inner) == guess:
            return made.out
    raise ValueError("no such offset")


def damaged_growing():
    """Fragments and records of a recording that are damaged (9.5, 10.1)."""
    part = Run([separate_sh(start=1, span=8)], 0, 10)
    live = growing([Fragment([part])], meta=Meta(profile=0, frames=1, degree=1))
    must_fail("growing_sh_damaged", "3.1", "damaged SH in a recording: its primitives are decoded",
              flipped(live, live.rindex(b"SEGM") + 100))
    made = many(34)
    for name, number_of, at in (("damaged", 20, 60), ("damaged_header", 20, 9), ("first_damaged", 1, 60),
                                ("with_links_damaged", 16, 60), ("with_links_damaged_header", 32, 2)):
        must_fail(f"fragment_{name}", "9.5", f"the FRAG record {number_of} of 34 is damaged: what it alone lists is lost",
                  flipped(made.out, made.offsets[number_of - 1] + at))
    for name, damaged in (("two_damaged", (16, 15)), ("two_in_turn", (32, 31)), ("all_before_damaged", (1, 2, 3)),
                          ("links_and_last_damaged", (33, 32))):
        out = made.out
        for i in damaged:
            out = flipped(out, made.offsets[i - 1] + 60)
        must_fail(f"fragments_{name}", "9.5", f"the FRAG records {damaged} of 34 are damaged", out)
    last = flipped(made.out, made.offsets[33] + 60)
    must_report("fragment_last_damaged", "9.4", "the last FRAG record is damaged: the one before is the last fragment", last)
    wrong = Recording()
    first = wrong.add(recorded(1)[0])
    wrong.add(Fragment([recorded_run(1)], earlier=[first.link(size=first.size - 1)]))
    must_fail("fragment_of_another_length", "9.5", "a link states another length", wrong.out)
    wrong = Recording()
    first = wrong.add(recorded(1)[0])
    wrong.add(Fragment([recorded_run(1)], earlier=[first.link(offset=len(wrong.head))]))
    must_fail("fragment_link_to_a_segment", "9.5", "a link leads to a SEGM record", wrong.out)
    wrong = Recording()
    first = wrong.add(recorded(1)[0])
    wrong.add(Fragment([recorded_run(1)], earlier=[first.link(), first.link()]))
    vector("fragment_linked_twice", "9.3", "two links to one FRAG record, which is read once", wrong.out, validator=[313])
    wrong = Recording()
    first = wrong.add(recorded(1)[0])
    wrong.add(Fragment([recorded_run(1)], earlier=[first.link(copy=len(wrong.head))]))
    must_report("fragment_link_with_a_copy", "9.3", "a link of the last FRAG record has a copy: the one before is the last "
           "fragment", wrong.out, clause_of="9.4")
    for name, about, more in (("states_its_size", "file_bytes in a growing file", dict(file_bytes=1)),):
        must_fail(f"growing_{name}", "2.1", about, growing(recorded(1), **more))
    must_fail("growing_cut_head", "2.4", "shorter than its head", growing([])[:-1])
    must_fail("growing_with_index", "3.4", "INDX in the head of a growing file",
              growing(recorded(1), last_records=record(b"INDX", b"\0\0\0\0")))
