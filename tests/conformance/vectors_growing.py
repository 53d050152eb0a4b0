# SPDX-License-Identifier: Apache-2.0
"""Growing files, valid and invalid (5.12)."""
import struct

from vector_file import Body, File, Meta, Part, Segment, checksum, record, text
from vector_growing import Fragment, fragment, growing
from vector_list import separate_sh, must_fail, further_header, private, vector, flipped
from vector_scenes import float_streams


def recorded_parts(count):
    return [Part([Segment(-1, 0, [Body(float_streams(2, 0, 10 + i, 1, 8), 2)])],
                 10 * i, 10 * i + 10) for i in range(count)]


def valid_growing():
    vector("growing_empty", "5.12", "a recording before its first fragment", growing([]))
    vector("growing", "5.12", "three fragments, whose index is in two of them", growing(recorded_parts(3)))
    vector("growing_eight", "5.12", "eight fragments, listed by the last one", growing(recorded_parts(8)))
    vector("growing_lasting", "5.12", "content that lasts longer than the recording is stored once",
           growing([Part(recorded_parts(1)[0].segments, 0, 1 << 20), *recorded_parts(3)[1:]],
                   [Fragment(frames=10), Fragment(), Fragment()]))
    streams = float_streams(2, 0, 10, 1, 8)
    layt = struct.pack("<HH", 0, 1) + b"\x09" + b"".join(s.row() for s in streams)
    vector("growing_with_layouts", "2.3", "LAYT in the head of a recording", growing(
        [Part([Segment(-1, 0, [Body(streams, 2, layout=0)])], 0, 10)], last_records=record(b"LAYT", layt)))
    vector("growing_newer_flags", "5.12", "fragment flags of 16 and above are ignored",
           growing(recorded_parts(2), [Fragment(), Fragment(flags=0x10000)]))
    vector("growing_closed", "5.12", "a closed recording",
           growing(recorded_parts(3), closed=Fragment(flags=1)))
    complete, shorter = growing(recorded_parts(3)), growing(recorded_parts(2))
    for name, size in (("growing_cut_in_a_record", len(shorter) + 100),
                       ("growing_cut_in_a_header", len(shorter) + 7),
                       ("growing_cut_in_a_fragment", len(complete) - 1)):
        vector(name, "5.12", "truncated: read up to the last complete fragment", complete[:size])

    # A record whose payload contains a FRAG record that is valid except for its location.
    shorter, part = growing(recorded_parts(2)), recorded_parts(3)[2]
    third = complete[complete.rindex(b"FRAG"):]
    at = len(shorter) + 32 + 8
    for name, about, fields in (
            ("forged_fragment", "a FRAG record within an unknown record is not used", {}),
            ("forged_fragment_of_segments", "as before, with segments listed before it",
             {"skip": len(shorter) - shorter.rindex(b"FRAG")})):
        forged = forged_fragment(shorter, at, part, **fields)
        vector(name, "5.12", about, shorter + record(b"NOTE", b"8 bytes." + forged, 0))
    vector("foreign_fragment", "5.12", "another file's FRAG record within an unknown record",
           shorter + record(b"NOTE", third, 0))
    noted = recorded_parts(3)
    for i, part in enumerate(noted):
        part.before = record(b"POSE", bytes([i] * 9), 0)
    vector("growing_with_further_records", "5.12", "a record of another tag before each fragment's",
           growing(noted) + record(b"POSE", b"\3" * 9, 0))
    timed = recorded_parts(3)
    audio = struct.pack("<dd", 5, 9.5) + text("audio/opus") + b"sound"
    early = struct.pack("<dd", 0, 10) + text("audio/opus") + b"more"
    layer = 200 << 8
    timed[0].segments[0].further = [(layer, further_header(layer) + early)]
    timed[1].segments.append(Segment(0, 2, [], further=[(layer, further_header(layer, 0, 2) + audio)]))
    timed[2].segments = [Segment(-1, 0, [], further=[(layer, further_header(layer) + early)])]
    vector("growing_timed_data", "5.13", "audio in every fragment, including one without primitives",
           growing(timed, last_records=private((2, 200, "org.example.sound"))))
    vector("growing_cut_before_a_stretch", "5.12", "truncated after such a record",
           growing(noted)[:len(growing(noted[:2])) + 41 + 5])


def forged_fragment(shorter, at, part, skip=None):
    """Returns a FRAG record for byte `at` after the recording `shorter`. It lists no records, after
    `skip` bytes."""
    before = shorter.rindex(b"FRAG")
    head_bytes = struct.unpack_from("<Q", shorter, 24)[0]
    empty = Part([], part.begin, part.end)
    return fragment([empty], part.end, Fragment(), [at - before if skip is None else skip], at,
                    checksum(shorter[:head_bytes]), before, before)


def broken_growing():
    complete = growing(recorded_parts(3))
    must_fail("growing_states_its_size", "2.6", "file_bytes in a growing file",
              growing(recorded_parts(1), file_bytes=1))
    must_fail("growing_cut_head", "2.6", "shorter than its head", growing([])[:-1])
    must_fail("growing_with_index", "3.4", "INDX in the head of a growing file",
              growing(recorded_parts(1), last_records=record(b"INDX", File([]).index_payload())))
    must_fail("growing_after_the_end", "5.12", "bytes after a closed fragment",
              growing(recorded_parts(1), closed=Fragment(flags=1), tail=b"x"))
    flags = [Fragment(flags=2)]
    must_fail("fragment_flags", "5.12", "an unknown flag of a fragment", growing(recorded_parts(1), flags))
    must_fail("fragment_frames", "5.12", "a duration of 0 frames",
              growing(recorded_parts(1), [Fragment(frames=0)]))
    must_fail("fragment_bounds", "4.3", "inverted bounds",
              growing(recorded_parts(1), [Fragment(bounds=(1, 0, 0, 0, 0, 0))]))
    itself = len(growing([])) + len(File(recorded_parts(1)).body())
    must_fail("fragment_previous", "5.12", "previous is the fragment itself",
              growing(recorded_parts(1), [Fragment(previous=itself)]))
    must_fail("fragment_previous_is_none", "5.12", "previous is the offset of another record",
              growing(recorded_parts(2), [Fragment(), Fragment(previous=len(growing([])))]))
    must_fail("fragment_chunk", "5.12", "two chunk lengths in one file",
              growing(recorded_parts(3), [Fragment(), Fragment(), Fragment(chunk=7.0)]))
    part = Part([separate_sh(start=1, span=8)], 0, 10)
    live = growing([part], meta=Meta(profile=0, frames=1, degree=1))
    must_fail("growing_harmonics_damaged", "3.1", "damaged SH in a recording: its primitives are decoded",
              flipped(live, live.rindex(b"SEGM") + 100))
    must_fail("fragment_in_the_way", "5.12", "a FRAG record of the chain is damaged: the part that it lists is lost",
              flipped(complete, len(growing(recorded_parts(2))) - 30))
    eleven = growing(recorded_parts(11))
    must_fail("fragment_damaged", "5.12", "one of many: ten of eleven parts are read",
              flipped(eleven, len(growing(recorded_parts(10))) - 30))
    must_fail("fragment_header_damaged", "5.12", "its record header: 13 of 14 parts are read",
              flipped(growing(recorded_parts(14)), growing(recorded_parts(12)).rindex(b"FRAG") + 1))
