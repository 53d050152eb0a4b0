# SPDX-License-Identifier: Apache-2.0
"""What readers of growing files follow instead of a damaged FRAG record, and how long they search (9.4, 9.5,
conformance.md 1.5)."""
import struct

from vector_file import Meta, copy_record, header
from vector_growing import Fragment, Recording, growing, recording
from vector_list import flipped, must_fail, must_report, plain, vector
from vector_records import checksum, record
from vectors_growing import fragment_sizes, recorded, recorded_run

DAMAGE = 60   # an offset within the payload of a FRAG record


def searches():
    instead()
    heads()
    lengths()
    searches_in_vain()


def instead():
    """9.5."""
    made = Recording()
    last = made.add(Fragment([recorded_run(0)], links=[], earlier=[]))
    linked = made.add(Fragment([recorded_run(1)], links=[last.link()], earlier=[]))
    last = made.add(Fragment([recorded_run(2)], links=[], earlier=[]))
    earlier = made.add(Fragment([recorded_run(3)], links=[last.link()], earlier=[]))
    made.add(Fragment([recorded_run(4)], links=[linked.link()], earlier=[earlier.link()]))
    last = damaged = made.add(Fragment([recorded_run(5)], links=[], earlier=[]))
    for _ in range(7):
        last = made.add(Fragment([], links=[last.link(times=(0.0, 60.0))], earlier=[]))
    must_fail("fragment_instead_seven_deep", "9.5", "the record at the end of seven links is damaged: two links follow the one "
              "before, of which the second are not followed", flipped(made.out, damaged.at + DAMAGE))
    made = Recording()
    first = made.add(Fragment([recorded_run(0)], links=[], earlier=[]))
    followed = made.add(Fragment([recorded_run(1)], links=[], earlier=[first.link()]))
    damaged = made.add(Fragment([recorded_run(2)], links=[], earlier=[]))
    made.add(Fragment([], links=[followed.link(), damaged.link()], earlier=[]))
    must_fail("fragment_instead_followed", "9.5", "the record before the damaged one was followed: its earlier links are "
              "followed now", flipped(made.out, damaged.at + DAMAGE))
    made = Recording()
    around = made.add(Fragment([recorded_run(0)], extra=bytes(50)))
    made.add(Fragment([recorded_run(1)], links=[around.link(offset=around.at + around.size, size=10)], earlier=[]))
    must_fail("fragment_instead_around", "9.5", "a link leads into a FRAG record, which begins before and is followed instead",
              made.out)


def heads():
    """10.2, step 3: heads of FRAG records."""
    made = recording(recorded(2))
    finished = header(2, 0, 0, len(made.out), len(made.head)) + made.out[32:]
    must_report("head_of_a_finished_file_in_a_fragment", "10.2", "the header is intact and not that of a recording, META is "
                "damaged: the head in the last FRAG record is used", flipped(finished, DAMAGE))
    complete = plain(copy=copy_record).bytes()
    live = header(2, 0, 1, 0, struct.unpack_from("<I", complete, 24)[0]) + complete[32:]
    must_report("growing_head_in_a_copy", "10.2", "the header is intact and that of a recording, META is damaged: the head in "
                "COPY is used", flipped(live, DAMAGE))
    head = growing([])
    for name, clause, about, stated in (
            ("version", "2.2", "of version 3", (3, 0, 1, 0)), ("flags", "2.2", "with an unknown flag", (2, 0, 5, 0)),
            ("size", "2.1", "that states file_bytes", (2, 0, 1, 1))):
        data = growing([*recorded(1), Fragment([recorded_run(1)], head=header(*stated, len(head)) + head[32:])])
        must_fail(f"growing_head_in_fragment_{name}", "10.2", f"the head is damaged, the last FRAG record contains one {about}: "
                  "it is used, and refused", flipped(data, 0), clause_of=clause)
    must_fail("growing_of_no_frames", "4.2", "META states a duration of 0 in a recording",
              growing(recorded(1), meta=Meta(profile=0, frames=0)))


def lengths():
    """FRAG records longer than the limit on memory."""
    long = growing([*recorded(1), Fragment([recorded_run(1)], extra=bytes(3000))])
    size = fragment_sizes(long)[1]
    damaged = flipped(long, long.rindex(b"FRAG") + DAMAGE)
    for name, about, data in (("last_fragment", "the last FRAG record", long),
                              ("damaged_fragment", "a damaged FRAG record at the end", damaged),
                              ("fragment_with_a_head", "the last FRAG record, whose head is needed", flipped(long, 0)),
                              ("fragment_before_a_byte", "the last FRAG record, and a byte", long + b"x"),
                              ("damaged_fragment_and_byte", "a damaged FRAG record, and a byte", damaged + b"x")):
        must_fail(f"limit_of_a_{name}", "conformance 1.5", f"{about}, more than the limit", data, {"max_memory": size - 1})
    must_report("limit_of_a_damaged_fragment_kept", "conformance 1.5", "a damaged FRAG record at the end, at the limit", damaged,
                {"max_memory": size}, clause_of="9.4")
    vector("fragment_in_the_head", "9.4", "a recording without fragments, whose head contains the header of a FRAG record of "
           "3 kB: no search examines it", growing([], last_records=noted(3000)) + bytes(4000), {"max_memory": 2999})
    data = growing([], last_records=noted(3000)) + bytes(4000)
    vector("fragment_in_the_head_located", "9.4", "the same, and the last 8 bytes of the file locate that header", data + struct.pack(
        "<Q", len(data) + 8 - 24 - data.index(b"FRAG")), {"max_memory": 2999})
    made = Recording()
    first = made.add(recorded(1)[0])
    made.add(Fragment([recorded_run(1)], links=[], earlier=[first.link()] * 1100))
    for name, more in (("_kept", 0), ("", -1)):
        (must_fail if more else vector)(f"limit_of_earlier_links{name}", "conformance 1.5", "1,104 entries, of which 1,100 are "
                                        f"earlier links, limit {80 * 512 + more}", made.out, {"max_memory": 80 * 512 + more},
                                        **({} if more else {"validator": [313]}))
    made = Recording()
    first = made.add(recorded(1)[0])
    made.add(Fragment([], links=[], earlier=[first.link()] * 1100))
    lost = [made.add(Fragment([recorded_run(i)], links=[], earlier=[])) for i in (1, 2)]
    made.add(Fragment([], links=[f.link() for f in lost], earlier=[]))
    data = flipped(flipped(made.out, lost[0].at + DAMAGE), lost[1].at + DAMAGE)
    must_fail("earlier_links_used_twice", "9.5", "two damaged records, 1,100 earlier links instead of each: they count once", data,
              {"max_memory": 80 * 512})
    made = Recording()
    first = made.add(recorded(1)[0])
    middle = made.add(Fragment([], links=[first.link()] * 1100, earlier=[]))
    made.add(Fragment([], links=[middle.link()], earlier=[]))
    must_fail("limit_of_linked_entries", "conformance 1.5", "a linked FRAG record of more entries than the limit", made.out,
              {"max_memory": 75 * 512})
    must_fail("limit_of_stated_primitives_growing", "conformance 1.5", "the last FRAG record states 4 primitives", growing(
        [Fragment([recorded_run(0)], total=4)]), {"max_primitives": 3})


def record_like(length):
    """Returns the header of a FRAG record with a right checksum and a wrong one of its payload."""
    head = b"FRAG" + struct.pack("<IQI", 1, length, 1)
    return head + struct.pack("<I", checksum(head))


def searches_in_vain():
    """The limit on what all searches together examine in vain: the size of the file."""
    for name, more in (("kept", 0), ("", 1)):
        data = growing(recorded(1))
        end = len(data) + 2000  # two records in 2000 bytes, the first of which contains the second
        outer = 2000 - 24
        data += record_like(outer) + record_like(end - outer + more) + bytes(2000 - 48)
        must_report(f"limit_of_bytes_in_vain_{name}".rstrip("_"), "conformance 1.5", f"the search for the last fragment examines "
                    f"{end + more} bytes in vain in a file of {end}", data, clause_of="9.4")
    for name, more in (("kept", 0), ("", 1)):
        must_fail(f"limit_of_two_searches_{name}".rstrip("_"), "9.5", "two searches examine in vain together "
                  + ("a byte more than" if more else "as many bytes as") + " the file has", two_searches(more), reports=True)
    for name, more in (("kept", 0), ("", 1)):
        must_fail(f"limit_of_three_searches_{name}".rstrip("_"), "9.5", "a record that two searches examine counts once; " + (
            "the third search has no result" if more else "the third search is within the limit"), three_searches(more))


def noted(length):
    """Returns a record that contains the header of a FRAG record."""
    return record(b"NOTE", record_like(length) + bytes(30), 0)


def two_searches(more):
    """A recording with a header of a FRAG record before its second fragment, which is damaged, and one at its end."""
    size, tail = 0, 1500
    for _ in range(3):
        made = Recording()
        made.add(recorded(1)[0])
        made.out += noted(max(0, size - tail + more))
        lost = made.add(Fragment([recorded_run(1)], links=[], earlier=[]))
        made.add(Fragment([recorded_run(2)], links=[lost.link()], earlier=[]))
        data = flipped(made.out, lost.at + DAMAGE) + record_like(tail) + bytes(tail)
        size = len(data)
    return data


def three_searches(more):
    """A recording of which three fragments are damaged: the search for the second examines the first, too."""
    size, passed = 0, 0
    for _ in range(3):
        made = Recording()
        made.add(recorded(1)[0])
        third = made.add(Fragment([recorded_run(1)], links=[], earlier=[]))
        made.add(Fragment([recorded_run(2)], links=[], earlier=[]))
        made.out += noted(max(0, size - passed + more))
        lost = [made.add(Fragment([recorded_run(i)], links=[], earlier=[], extra=bytes(2500))) for i in (3, 4)] + [third]
        made.add(Fragment([recorded_run(5)], links=[], earlier=[f.link() for f in lost]))
        data = made.out + bytes(2000)
        for f in lost:
            data = flipped(data, f.at + DAMAGE)
        size, passed = len(data), lost[0].size
    return data
