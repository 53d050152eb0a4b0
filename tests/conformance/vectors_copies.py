# SPDX-License-Identifier: Apache-2.0
"""Copies of the head, and what they stand in for (3.6)."""
import struct

from vector_file import Body, Part, Segment, checksum, record, zstd_frame
from vector_growing import Fragment, growing
from vector_list import framed, must_fail, plain, private, vector, with_byte
from vector_scenes import float_streams
from vectors_growing import stretches

META = 72  # where its payload begins, if it is the first record


def sealed(header):
    return header[:32] + struct.pack("<Q", checksum(header[:32]))


def head_of(data):
    return data[:struct.unpack_from("<Q", data, 24)[0]]


def copy(head, store=bytes, flags=0, length=0):
    """The COPY record of a head, whose records `store` packs."""
    payload = head[:40] + store(head[40:])
    return record(b"COPY", payload + struct.pack("<Q", len(payload) + 8 + length), flags)


def copied(file, behind=b"", of=bytes, **how):
    """A file of 1.1 with a copy, and a record behind it; the copy is that of what `of` makes of the head."""
    data = file.bytes()
    size = len(data) + len(copy(head_of(data), **how)) + len(behind)
    data = sealed(data[:10] + struct.pack("<HIQ", 1, 0, size) + data[24:32]) + data[40:]
    return data + copy(of(head_of(data)), **how) + behind


def sound_copies():
    vector("copied", "3.6", "a copy of the head", copied(plain(degree=1)))
    vector("copied_in_a_frame", "3.6", "a copy of the head in a Zstandard frame",
           copied(plain(), store=zstd_frame))
    vector("growing_copied", "3.6", "a recording with a copy of its head",
           growing(stretches(3), copy=copy))
    one = growing(stretches(1), copy=copy)
    vector("growing_copy_header", "5.12", "the header of the copy is damaged: what the fragment lists leads to it",
           with_byte(one, one.index(b"COPY") + 9), reported=(110,))
    two = Part([Segment(-1, 0, [Body(float_streams(2, 0, 10, 1, 8), 2)]),
                Segment(0, 0, [Body(float_streams(1, 0, 11, 2, 1), 1)])], 0, 10)
    segments = growing([two], copy=copy)
    must_fail("growing_first_header", "3.1", "the header of a stretch's first record is damaged: its second leads to it",
              with_byte(segments, segments.index(b"SEGM") + 9))
    vector("growing_copied_empty", "5.12", "a recording of nothing but a head and its copy",
           growing([], copy=copy))
    vector("copy_of_another_head", "3.6", "a copy that is of another head than this one, which is sound",
           copied(plain(), of=lambda head: with_byte(head, 12)))
    vector("copy_before_another_record", "3.6", "a copy that is not the last record",
           copied(plain(), behind=record(b"NOTE", b"late", 0)))


def damaged_heads():
    whole = copied(plain(degree=1, head_last=private()))
    zeros = bytes(len(head_of(whole)))
    for name, about, data in (
            ("head_magic", "a bit of the first bytes", with_byte(whole, 3)),
            ("head_version", "a bit of the version", with_byte(whole, 8, 2)),
            ("head_size", "a bit of head_bytes", with_byte(whole, 26)),
            ("head_checksum", "a bit of the header's checksum", with_byte(whole, 39)),
            ("head_record", "a bit of a record header", with_byte(whole, 49)),
            ("head_metadata", "a bit of META", with_byte(whole, META + 8)),
            ("head_index", "a bit of INDX", with_byte(whole, whole.index(b"INDX") + 40)),
            ("head_aside", "a bit of a record that is not critical", with_byte(whole, whole.index(b"PRIV") + 32)),
            ("head_of_zeros", "all of the head is zeros", zeros + whole[len(zeros):]),
            ("head_framed", "a bit of META, the copy in a frame",
             with_byte(copied(plain(), store=zstd_frame), META))):
        must_fail(name, "3.6", about, data)
    recording = growing(stretches(3), copy=copy)
    closed = growing(stretches(2), closed=Fragment(flags=1), copy=copy)
    noted = growing(stretches(1), copy=copy, head_last=record(b"NOTE", b"", 0) * 63)
    for name, about, data in (
            ("growing_head_magic", "a bit of the first bytes", with_byte(recording, 0)),
            ("growing_head_flags", "the bit that says that it grows", with_byte(recording, 12)),
            ("growing_head_size", "a bit of head_bytes", with_byte(recording, 24)),
            ("growing_head_metadata", "a bit of META", with_byte(recording, META + 8)),
            ("growing_closed_head", "a bit of a closed recording's META", with_byte(closed, META)),
            ("growing_head_of_64_records", "a bit of the first bytes, 64 records before the copy",
             with_byte(noted, 0))):
        must_fail(name, "3.6", about, data)


def broken_copies():
    def damaged(**how):
        return with_byte(copied(plain(), **how), META)

    whole = copied(plain())
    at = whole.index(b"COPY")
    for name, about, data in (
            ("copy_damaged_too", "both are damaged", with_byte(damaged(), at + 90)),
            ("copy_critical", "a critical record is none", damaged(flags=1)),
            ("copy_length", "its last bytes lead elsewhere", damaged(length=1)),
            ("copy_header", "its header is another",
             damaged(of=lambda head: sealed(with_byte(head[:40], 14)) + head[40:])),
            ("copy_of_damage", "it stands for a damaged head", damaged(of=lambda head: with_byte(head, META))),
            ("copy_window", "its frame asks for too large a window",
             damaged(store=lambda rest: framed(rest, window=200))),
            ("copy_elsewhere", "it is not the last record", damaged(behind=record(b"NOTE", b"late", 0)))):
        must_fail(name, "3.1", about, data)
    must_fail("copy_of_another_size", "2.1", "it states another size of the file",
              with_byte(whole[:at] + record(b"NOTE", b"", 0) + whole[at:], 0))
    must_fail("growing_head_of_65_records", "2.1", "too many records before the copy", with_byte(
        growing(stretches(1), copy=copy, head_last=record(b"NOTE", b"", 0) * 64), 0))
    must_fail("copy_beyond_the_limit", "2.1", "a copy of more memory than the limit is none",
              with_byte(whole, 0), {"max_memory": 200})
    must_fail("copy_beyond_the_file", "2.1", "it states a head that is larger than the file", with_byte(
        copied(plain(), of=lambda head: sealed(head[:24] + struct.pack("<Q", 1 << 40)) + head[40:]), 0))
    must_fail("growing_copy_length", "3.1", "its last bytes are not its length", with_byte(
        growing(stretches(1), copy=lambda head: copy(head, length=1)), META))
