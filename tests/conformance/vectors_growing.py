# SPDX-License-Identifier: Apache-2.0
"""Files that grow, sound and broken (5.12)."""
import struct

from vector_file import Body, File, Meta, Part, Segment, checksum, record, text
from vector_growing import Fragment, fragment, growing
from vector_list import apart, must_fail, place, private, vector, with_byte
from vector_scenes import float_streams


def stretches(count):
    return [Part([Segment(-1, 0, [Body(float_streams(2, 0, 10 + i, 1, 8), 2)])],
                 10 * i, 10 * i + 10) for i in range(count)]


def sound_growing():
    vector("growing_empty", "5.12", "a recording before its first stretch", growing([]))
    vector("growing", "5.12", "three stretches, found in two fragments", growing(stretches(3)))
    vector("growing_eight", "5.12", "eight stretches in one fragment", growing(stretches(8)))
    vector("growing_lasting", "5.12", "what lasts longer than what is recorded is stored once",
           growing([Part(stretches(1)[0].segments, 0, 1 << 20), *stretches(3)[1:]],
                   [Fragment(frames=10), Fragment(), Fragment()]))
    streams = float_streams(2, 0, 10, 1, 8)
    layt = struct.pack("<HH", 0, 1) + b"\x09" + b"".join(s.row() for s in streams)
    vector("growing_with_layouts", "2.3", "LAYT in the head of a recording", growing(
        [Part([Segment(-1, 0, [Body(streams, 2, layout=0)])], 0, 10)], head_last=record(b"LAYT", layt)))
    vector("growing_newer_flags", "5.12", "fragment flags of 16 and above are ignored",
           growing(stretches(2), [Fragment(), Fragment(flags=0x10000)]))
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
    timed = stretches(3)
    sound = struct.pack("<dd", 5, 9.5) + text("audio/opus") + b"sound"
    early = struct.pack("<dd", 0, 10) + text("audio/opus") + b"more"
    layer = 200 << 8
    timed[0].segments[0].further = [(layer, place(layer) + early)]
    timed[1].segments.append(Segment(0, 2, [], further=[(layer, place(layer, 0, 2) + sound)]))
    timed[2].segments = [Segment(-1, 0, [], further=[(layer, place(layer) + early)])]
    vector("growing_timed_data", "5.13", "sound in every stretch, where nothing is seen too",
           growing(timed, head_last=private((2, 200, "org.example.sound"))))
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
    itself = len(growing([])) + len(File(stretches(1)).body())
    must_fail("fragment_previous", "5.12", "previous is the fragment itself",
              growing(stretches(1), [Fragment(previous=itself)]))
    must_fail("fragment_previous_is_none", "5.12", "previous is another record",
              growing(stretches(2), [Fragment(), Fragment(previous=len(growing([])))]))
    must_fail("fragment_chunk", "5.12", "two chunks in one file",
              growing(stretches(3), [Fragment(), Fragment(), Fragment(chunk=7.0)]))
    part = Part([apart(start=1, span=8)], 0, 10)
    live = growing([part], meta=Meta(profile=0, frames=1, degree=1))
    must_fail("growing_harmonics_damaged", "3.1", "the primitives of a recording are there without them",
              with_byte(live, live.rindex(b"SEGM") + 100))
    must_fail("fragment_in_the_way", "5.12", "a fragment of the chain is damaged: its stretch is lost",
              with_byte(whole, len(growing(stretches(2))) - 30))
    eleven = growing(stretches(11))
    must_fail("fragment_damaged", "5.12", "one of many: ten of eleven stretches are read",
              with_byte(eleven, len(growing(stretches(10))) - 30))
    must_fail("fragment_header_damaged", "5.12", "its record header: 13 of 14 stretches are read",
              with_byte(growing(stretches(14)), growing(stretches(12)).rindex(b"FRAG") + 1))
