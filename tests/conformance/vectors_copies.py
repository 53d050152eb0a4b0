# SPDX-License-Identifier: Apache-2.0
"""Copies of the head, and damaged heads (3.6)."""
import struct

from vector_file import Body, Part, Segment, checksum, record, zstd_frame
from vector_growing import Fragment, growing
from vector_list import framed, must_fail, plain, private, vector, flipped
from vector_scenes import float_streams
from vectors_growing import recorded_parts

META = 72  # offset of its payload, if it is the first record


def with_checksum(header):
    return header[:32] + struct.pack("<Q", checksum(header[:32]))


def head_of(data):
    return data[:struct.unpack_from("<Q", data, 24)[0]]


def copy(head, store=bytes, flags=0, length=0):
    """Returns the COPY record of a head, whose records `store` packs."""
    payload = head[:40] + store(head[40:])
    return record(b"COPY", payload + struct.pack("<Q", len(payload) + 8 + length), flags)


def copied(file, after=b"", of=bytes, **how):
    """Returns a file of version 1.1 with a copy of of(head), and the records `after` behind it."""
    data = file.bytes()
    size = len(data) + len(copy(head_of(data), **how)) + len(after)
    data = with_checksum(data[:10] + struct.pack("<HIQ", 1, 0, size) + data[24:32]) + data[40:]
    return data + copy(of(head_of(data)), **how) + after


def valid_copies():
    vector("copied", "3.6", "a copy of the head", copied(plain(degree=1)))
    vector("copied_in_a_frame", "3.6", "a copy of the head in a Zstandard frame",
           copied(plain(), store=zstd_frame))
    vector("growing_copied", "3.6", "a recording with a copy of its head",
           growing(recorded_parts(3), copy=copy))
    one = growing(recorded_parts(1), copy=copy)
    vector("growing_copy_header", "5.12", "the header of the copy is damaged: a listed record makes the fragment reachable",
           flipped(one, one.index(b"COPY") + 9), reported=(110,))
    two = Part([Segment(-1, 0, [Body(float_streams(2, 0, 10, 1, 8), 2)]),
                Segment(0, 0, [Body(float_streams(1, 0, 11, 2, 1), 1)])], 0, 10)
    segments = growing([two], copy=copy)
    must_fail("growing_first_header", "3.1", "the header of a fragment's first record is damaged: the second makes it reachable",
              flipped(segments, segments.index(b"SEGM") + 9))
    vector("growing_copied_empty", "5.12", "a recording that consists of a head and its copy",
           growing([], copy=copy))
    vector("copy_of_another_head", "3.6", "a copy of another head; the file's own is intact",
           copied(plain(), of=lambda head: flipped(head, 12)))
    vector("copy_before_another_record", "3.6", "a copy that is not the last record",
           copied(plain(), after=record(b"NOTE", b"late", 0)))


def damaged_heads():
    complete = copied(plain(degree=1, last_records=private()))
    zeros = bytes(len(head_of(complete)))
    for name, about, data in (
            ("head_magic", "a flipped bit of the magic", flipped(complete, 3)),
            ("head_version", "a flipped bit of the version", flipped(complete, 8, 2)),
            ("head_size", "a flipped bit of head_bytes", flipped(complete, 26)),
            ("head_checksum", "a flipped bit of the header's checksum", flipped(complete, 39)),
            ("head_record", "a flipped bit of a record header", flipped(complete, 49)),
            ("head_metadata", "a flipped bit of META", flipped(complete, META + 8)),
            ("head_index", "a flipped bit of INDX", flipped(complete, complete.index(b"INDX") + 40)),
            ("head_aside", "a flipped bit of a record that is not critical", flipped(complete, complete.index(b"PRIV") + 32)),
            ("head_of_zeros", "a head of zeros", zeros + complete[len(zeros):]),
            ("head_framed", "a flipped bit of META, the copy in a frame",
             flipped(copied(plain(), store=zstd_frame), META))):
        must_fail(name, "3.6", about, data)
    recording = growing(recorded_parts(3), copy=copy)
    closed = growing(recorded_parts(2), closed=Fragment(flags=1), copy=copy)
    noted = growing(recorded_parts(1), copy=copy, last_records=record(b"NOTE", b"", 0) * 63)
    for name, about, data in (
            ("growing_head_magic", "a flipped bit of the magic", flipped(recording, 0)),
            ("growing_head_flags", "a flipped growing flag", flipped(recording, 12)),
            ("growing_head_size", "a flipped bit of head_bytes", flipped(recording, 24)),
            ("growing_head_metadata", "a flipped bit of META", flipped(recording, META + 8)),
            ("growing_closed_head", "a flipped bit of a closed recording's META", flipped(closed, META)),
            ("growing_head_of_64_records", "a flipped bit of the magic, 64 records before the copy",
             flipped(noted, 0))):
        must_fail(name, "3.6", about, data)


def broken_copies():
    def damaged(**how):
        return flipped(copied(plain(), **how), META)

    complete = copied(plain())
    at = complete.index(b"COPY")
    for name, about, data in (
            ("copy_damaged_too", "head and copy are damaged", flipped(damaged(), at + 90)),
            ("copy_critical", "a critical COPY record is not used", damaged(flags=1)),
            ("copy_length", "its last bytes state another length", damaged(length=1)),
            ("copy_header", "its header differs from the file's",
             damaged(of=lambda head: with_checksum(flipped(head[:40], 14)) + head[40:])),
            ("copy_of_damage", "it contains a damaged head", damaged(of=lambda head: flipped(head, META))),
            ("copy_window", "its frame requires too large a window",
             damaged(store=lambda rest: framed(rest, window=200))),
            ("copy_elsewhere", "it is not the last record", damaged(after=record(b"NOTE", b"late", 0)))):
        must_fail(name, "3.1", about, data)
    must_fail("copy_of_another_size", "2.1", "it states another size of the file",
              flipped(complete[:at] + record(b"NOTE", b"", 0) + complete[at:], 0))
    must_fail("growing_head_of_65_records", "2.1", "too many records before the copy", flipped(
        growing(recorded_parts(1), copy=copy, last_records=record(b"NOTE", b"", 0) * 64), 0))
    must_fail("copy_beyond_the_limit", "2.1", "a copy that exceeds the memory limit is not used",
              flipped(complete, 0), {"max_memory": 200})
    must_fail("copy_beyond_the_file", "2.1", "it states a head that is larger than the file", flipped(
        copied(plain(), of=lambda head: with_checksum(head[:24] + struct.pack("<Q", 1 << 40)) + head[40:]), 0))
    must_fail("growing_copy_length", "3.1", "its last bytes are not its length", flipped(
        growing(recorded_parts(1), copy=lambda head: copy(head, length=1)), META))
