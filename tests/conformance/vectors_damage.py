# SPDX-License-Identifier: Apache-2.0
"""Headers, damaged heads and their copies, truncated files, damaged records (2, 3, 10)."""
import struct

from vector_file import File, Meta, Run, Segment, copy_record, header
from vector_growing import Fragment, Recording, growing
from vector_list import flipped, must_fail, must_report, plain, private, separate_sh, vector
from vector_records import Body, record
from vector_scenes import float_streams
from vectors_growing import recorded, recorded_run

META = 56  # offset of its payload, if it is the first record


def head_of(data):
    return data[:struct.unpack_from("<I", data, 24)[0]]


def with_head_bytes(head, head_bytes):
    """Returns a head whose header states another head_bytes."""
    return header(2, 0, 0, struct.unpack_from("<Q", head, 16)[0], head_bytes) + head[32:]


def fragment_in_its_head():
    """Returns 32 bytes 0 and a FRAG record without segments."""
    made = Recording()
    made.out = bytes(32)
    made.add(Fragment([], frames=1))
    return made.out


def damage():
    headers()
    heads_from_copies()
    heads_from_fragments()
    unusable_copies()
    truncated()
    records()


def headers():
    good = plain().bytes()
    must_fail("short", "2.1", "31 bytes", good[:31])
    must_fail("empty", "2.1", "no bytes", b"")
    must_fail("magic", "2.1", "another first byte", flipped(good, 0))
    must_fail("text_transfer", "2.1", "translated line ends", good[:4] + b"\n" + good[6:])
    must_fail("header_checksum", "2.1", "a flipped bit", flipped(good, 9))
    must_fail("header_checksum_itself", "2.1", "a flipped bit of the checksum", flipped(good, 31))
    must_fail("major_version_1", "2.2", "version 1.1", plain(major=1, minor=1))
    must_fail("major_version_3", "2.2", "version 3.0 with a copy of the head, and a damaged record",
              flipped(plain(major=3, copy=copy_record).bytes(), META))
    for bit in (2, 15):
        must_fail(f"header_flag_{bit}", "2.2", f"flag {bit}", plain(flags=1 << bit))
    must_fail("head_beyond_the_file", "2.1", "head_bytes too large", plain(head_bytes=1 << 20))
    must_fail("head_of_31_bytes", "2.1", "head_bytes below the size of a header", header(2, 0, 0, 32, 31))
    must_fail("growing_head_of_31_bytes", "2.1", "head_bytes below the size of a header, in a growing file",
              header(2, 0, 1, 0, 31))
    must_fail("head_of_no_records", "2.3", "a header alone", header(2, 0, 0, 32, 32))
    must_fail("growing_head_of_no_records", "2.3", "the header of a recording alone", header(2, 0, 1, 0, 32))
    must_fail("fragment_in_its_head", "10.2", "a FRAG record that begins before the end of the head that it contains",
              fragment_in_its_head(), clause_of="2.1")
    must_fail("head_cuts_a_record", "10.2", "head_bytes one too small", plain(head_bytes=-1), clause_of="3.2")
    must_fail("head_ends_in_a_header", "10.2", "23 bytes after the last record of the head",
              plain(last_records=bytes(23)), clause_of="3.2")
    must_fail("file_of_no_size", "2.1", "file_bytes is 0 in a finished file", plain(file_bytes=-len(good)))


def heads_from_copies():
    complete = plain(degree=1, last_records=private(), copy=copy_record).bytes()
    for name, about, at in (("magic", "a flipped bit of the magic", 3), ("version", "a flipped bit of the version", 9),
                            ("flags", "a flipped growing flag", 12), ("file_bytes", "a flipped bit of file_bytes", 16),
                            ("size", "a flipped bit of head_bytes", 26),
                            ("checksum", "a flipped bit of the header's checksum", 28),
                            ("record", "a flipped bit of a record header", 41), ("tag", "a flipped bit of a tag", 32),
                            ("metadata", "a flipped bit of META", META + 8),
                            ("index", "a flipped bit of INDX", complete.index(b"INDX") + 40),
                            ("aside", "a flipped bit of a record that is not critical", complete.index(b"PRIV") + 24)):
        must_report(f"head_{name}", "10.2", about + "; the copy of the head is used", flipped(complete, at))
    zeros = bytes(len(head_of(complete)))
    must_report("head_of_zeros", "10.2", "a head of zeros; its copy is used", zeros + complete[len(zeros):])
    changed = plain(meta=Meta(profile=0, title="changed"), copy=lambda head: copy_record(head_of(plain(
        copy=lambda _: bytes(24 + len(head) + 8)).bytes())))
    vector("copy_of_another_head", "10.2", "a copy of another head, which is not used", changed)


def heads_from_fragments():
    recording = growing(recorded(3))
    closed = growing([*recorded(2), Fragment([], flags=1)])
    for name, about, data, at in (
            ("magic", "a flipped bit of the magic", recording, 0), ("flags", "a flipped growing flag", recording, 12),
            ("size", "a flipped bit of head_bytes", recording, 24),
            ("metadata", "a flipped bit of META", recording, META + 8),
            ("closed", "a flipped bit of a closed recording's META", closed, META)):
        must_report(f"growing_head_{name}", "10.2", about + "; the head in the last FRAG record is used", flipped(data, at))
    must_report("growing_head_and_tail", "10.2", "a damaged head, and an unfinished record at the end",
                flipped(recording, 3) + recording[-100:])
    must_report("growing_head_and_fragment", "10.2", "the head and the last FRAG record are damaged: the one before "
                "is used", flipped(flipped(recording, META), len(recording) - 20))
    must_fail("growing_head_and_all_fragments", "10.2", "the head and the only FRAG record are damaged",
              flipped(flipped(growing(recorded(1)), META), len(growing(recorded(1))) - 20), clause_of="3.1")
    must_fail("growing_head_without_fragments", "10.2", "a damaged head of a recording without fragments",
              flipped(growing([]), META), clause_of="3.1")
    head = growing([])
    for name, about, other in (("damaged", "a damaged head", flipped(head, META)),
                               ("finished", "the head of a finished file", head_of(plain().bytes())),
                               ("longer", "a head and a byte", head + b"\0"),
                               ("other_and_longer", "another head and a byte", growing([], meta=Meta(title="other")) + b"\0"),
                               ("shorter", "a part of a head", head[:-1]), ("none", "no head", b"")):
        data = growing([*recorded(1), Fragment([recorded_run(1)], head=other)])
        must_report(f"growing_head_in_fragment_{name}", "10.2", f"the head is damaged, the last FRAG record contains {about}:"
                    " the one before is used", flipped(data, 0))


def unusable_copies():
    def damaged(**how):
        return flipped(plain(copy=lambda head: copy_record(head, **how)).bytes(), META)

    complete = plain(copy=copy_record).bytes()
    at = complete.index(b"COPY")
    for name, about, data in (
            ("damaged_too", "head and copy are damaged", flipped(damaged(), at + 90)),
            ("header_damaged", "the record header of the copy is damaged", flipped(damaged(), at + 5)),
            ("critical", "a critical COPY record is not used", damaged(flags=1)),
            ("flagged", "a COPY record with flag bit 1 is not used", damaged(flags=2)),
            ("length", "its last bytes state another length", damaged(length=1)),
            ("length_beyond", "its last bytes state more bytes than the file has", damaged(length=1 << 62)),
            ("of_damage", "it contains a damaged head", flipped(plain(
                copy=lambda head: copy_record(flipped(head, META))).bytes(), META)),
            ("of_a_longer_head", "it contains a byte more than the head", flipped(plain(
                copy=lambda head: copy_record(head + b"\0")).bytes(), META)),
            ("of_a_shorter_head", "its header states more bytes than it contains", flipped(plain(
                copy=lambda head: copy_record(with_head_bytes(head, len(head) + 1))).bytes(), META)),
            ("of_a_growing_head", "it contains the head of a recording", flipped(plain(
                copy=lambda head: copy_record(growing([]))).bytes(), META)),
            ("elsewhere", "it is not the last record", flipped(complete + record(b"NOTE", b"late", 0), META))):
        must_fail(f"copy_{name}", "10.2", about, data, clause_of="3.1")
    tagged = flipped(complete, META)
    tagged = tagged[:at] + record(b"COPE", tagged[at + 24:], 0)
    must_fail("copy_tag", "10.2", "the last record has another tag", tagged, clause_of="3.1")
    must_fail("copy_of_another_size", "10.2", "it states another size of the file",
              flipped(complete[:at] + record(b"NOTE", b"", 0) + complete[at:], 0), clause_of="2.1")
    must_fail("copy_of_a_later_version", "10.2", "the copy is of version 3: it is used, and refused", flipped(plain(
        copy=lambda head: copy_record(header(3, 0, 0, struct.unpack_from("<Q", head, 16)[0], len(head)) + head[32:])
    ).bytes(), 0), clause_of="2.2")
    must_fail("copy_with_unknown_flags", "10.2", "the copy has an unknown flag: it is used, and refused", flipped(plain(
        copy=lambda head: copy_record(header(2, 0, 4, struct.unpack_from("<Q", head, 16)[0], len(head)) + head[32:])
    ).bytes(), 0), clause_of="2.2")
    aside = record(b"NOTE", b"hello", 0)
    for name, about, records in (("unknown", "an unknown record", aside), ("private", "PRIV", private()),
                                 ("first", "the first of two records", aside + aside)):
        good = plain(last_records=records).bytes()
        must_report(f"aside_damaged_{name}", "3.4", f"a flipped bit in the payload of {about}, without a copy of the head",
                    flipped(good, head_of(good).rindex(records[:4]) - 29 * (name == "first") + 24), clause_of="3.1")
    good = plain(first_records=aside).bytes()
    must_fail("aside_header_damaged", "10.2", "a flipped bit in the header of an unknown record, without a copy",
              flipped(good, 33), clause_of="3.1")
    both = flipped(flipped(good, 32 + 24), good.index(b"META") + 30)
    must_fail("aside_and_metadata_damaged", "10.2", "an unknown record and META are damaged", both, clause_of="3.1")


def truncated():
    good = plain().bytes()
    must_fail("truncated", "2.4", "the last byte is missing", good[:-1], reports=True)
    must_fail("truncated_head", "2.4", "the last byte of the head is missing", good[:good.index(b"SEGM") - 1])
    must_fail("truncated_after_the_head", "2.4", "the body is missing", good[:good.index(b"SEGM")], reports=True)
    tail = record(b"IMPO", struct.pack("<6f", *[1] * 6), 0)
    three = File([Run([Segment(0, 2 * i, [Body(float_streams(2, 0, i, 5 * i, 5), 2)]) for i in range(3)])],
                 Meta(profile=0), tail=tail).bytes()
    second = three.index(b"SEGM", three.index(b"SEGM") + 4)
    for name, about, size in (("between_segments", "one of three segments is available", second),
                              ("in_a_record_header", "one of three segments is available", second + 23),
                              ("in_a_segment", "one of three segments is available", second + 60),
                              ("behind_the_segments", "IMPO is cut off, all segments are available", len(three) - 1),
                              ("before_importance", "IMPO is missing", len(three) - len(tail)),
                              ("in_importance_header", "IMPO's header is cut off", len(three) - len(tail) + 10)):
        must_fail(f"truncated_{name}", "2.4", about, three[:size], reports=True)
    must_report("bytes_after_the_end", "2.4", "one additional byte", good + b"\0")
    copied = plain(copy=copy_record).bytes()
    must_report("record_after_the_end", "2.4", "an additional IMPO record, which is not read",
                copied + record(b"IMPO", struct.pack("<3f", 1, 2, 3), 0))
    part = Run([separate_sh(start=1, span=8)], 0, 10)
    data = File([part], Meta(profile=0, degree=1)).bytes()
    must_fail("truncated_sh", "2.4", "the record of content 1 is cut off: its primitives are decoded", data[:-5], reports=True)


def records():
    good = File([Run([Segment(0, 2 * i, [Body(float_streams(2, 0, i, 5 * i, 5), 2)]) for i in range(3)])],
                Meta(profile=0)).bytes()
    second = good.index(b"SEGM", good.index(b"SEGM") + 4)
    for name, at in (("payload", 100), ("last_byte", 0), ("header", 9), ("checksum", 16), ("header_checksum", 20)):
        at = at or good.index(b"SEGM", second + 4) - 1 - second
        must_fail(f"segment_damaged_{name}", "10.1", f"a flipped bit in the {name.replace('_', ' ')} of the second of three "
                  "segments; the others are decoded", flipped(good, second + at), clause_of="3.1")
    first, second = separate_sh(), separate_sh(2, 2)
    first.tiers += second.tiers
    first.sh += second.sh
    complete = File([Run([first])], Meta(profile=0, degree=1)).bytes()
    found = [i for i in range(len(complete)) if complete.startswith(b"SEGM", i)]
    must_fail("sh_damaged", "10.1", "a flipped bit in the SH of the first of two tiers",
              flipped(complete, found[2] + 100), clause_of="3.1")
    must_fail("primitives_damaged", "10.1", "a flipped bit in the first of two tiers",
              flipped(complete, found[0] + 300), clause_of="3.1")
    must_fail("truncated_both_sh", "2.4", "the file ends within the SH of the first of two tiers", complete[:found[2] + 100],
              reports=True)
