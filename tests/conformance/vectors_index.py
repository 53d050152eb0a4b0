# SPDX-License-Identifier: Apache-2.0
"""Valid indices: levels, parts, nodes, further records (5)."""
import struct

from vector_file import File, Link, Meta, Node, PageCopy, Run, Segment, copy_record
from vector_list import flipped, further, must_fail, must_report, private, vector
from vector_records import Body, record
from vector_scenes import coded_streams, float_streams, own_body

SOUND = private((2, 200, "org.example.sound"))


def small(level=-1, slot=0, n=1, seed=3, start=0.0, span=30.0, **more):
    return Segment(level, slot, [Body(float_streams(n, 0, seed, start, span), n)], **more)


def run_at(begin, end=None, part=0, seed=3, **more):
    """Returns a run of one persistent segment of a part."""
    end = begin + 10 if end is None else end
    return Run([small(seed=seed, start=0, span=min(end - begin, 30.0))], begin, end, part=part, **more)


def valid_index():
    two = [Segment(-1, 0, [Body(float_streams(2, 0, 3), 2)]), small(1, 0, 1, 4, 0, 10), small(0, 0, 2, 5, 0, 5),
           small(0, 1, 1, 6, 2.5, 5), small(0, 4, 1, 7, 10, 5)]
    vector("levels", "5.4", "a persistent segment, levels 0 and 1, omitted slots", File([Run(two)], Meta(profile=0)))
    high = [small(30, 0), small(29, 0), small(1, 0), small(0, 0, span=5.0), small(1, 1, start=5.0, span=10.0),
            small(0, 2, start=5.0, span=5.0), small(0, 11, start=27.5, span=2.5)]
    vector("levels_to_30", "5.4", "segments that are cut at the end of their part; order of those that begin together",
           File([Run(high)], Meta(profile=0)))
    fine = [small(0, 1, start=0.0, span=2.0 ** -19), small(0, 3, start=0.0, span=2.0 ** -19)]
    vector("chunk_of_2_to_minus_20", "5.3", "the shortest chunk: intervals in units of 2^-21 ticks",
           File([Run(fine, chunk=2.0 ** -20)], Meta(profile=0)), validator=[504, 504])
    vector("chunk_of_2_to_32", "5.3", "the longest chunk", File([Run([small(0, 0)], chunk=2.0 ** 32)], Meta(profile=0)))
    vector("slot_of_32_bits", "5.3", "slot 2^32 - 1", File([Run(
        [small(0, (1 << 32) - 1, start=16383.0, span=2.0)], 0, 2.0 ** 20, chunk=2.0 ** -17)], Meta(profile=0)),
           validator=[504])
    parts()
    pages()
    copies_of_pages()
    further_records()
    vector("totals", "5.1", "1024 attribute totals", File(
        [Run([small()])], Meta(profile=0), totals=tuple((i + 64512, 1 << i % 64) for i in range(1024))))
    vector("tiers_256", "5.3", "256 tiers of one primitive", File([Run([many_tiers()])], Meta(profile=0), layouts=shared()))
    vector("no_segments", "5.2", "a file without segments", File(Node(), Meta(profile=0)))
    gap = [small(0, 0, span=5.0), small(0, 4, start=10.0, span=5.0)]
    runs = [Run(gap[:1]), Run(gap[1:])]
    vector("runs_with_a_gap", "5.3", "two runs of one part, an unknown record between them",
           File(runs, Meta(profile=0), body=[runs[0], record(b"NOTE", b"hello", 0), runs[1]]))
    vector("total_wrong", "5.1", "INDX states 4 primitives instead of 1", File([Run([small()])], Meta(profile=0), total=4),
           validator=[306])


def shared():
    return struct.pack("<HH", 0, 1) + b"\x09" + b"".join(s.row() for s in float_streams(1, 0, 1))


def many_tiers():
    return Segment(-1, 0, [Body(float_streams(1, 0, i), 1, layout=0) for i in range(256)])


def parts():
    first = Run([Segment(-1, 0, [Body(float_streams(2, 0, 3, 0, 15), 2)])], 0, 14.5)
    second = Run([Segment(-1, 0, [own_body(coded_streams(3, 0, 3), 3)]),
                  Segment(0, 0, [own_body(coded_streams(2, 0, 4), 2)])], 14.5, 30, part=1)
    vector("parts", "5.3", "two parts", File([first, second], Meta()))
    shown = [Run([Segment(-1, 0, [Body(float_streams(2, 0, 3, 0, 20), 2)])], -5, 15.5, cut=(0, 12.25)),
             Run([Segment(0, 3, [own_body(coded_streams(2, 0, 4), 2)])], 2.5, 1000, cut=(12.25, 40), part=7)]
    vector("parts_cut", "5.4", "parts that begin before the timeline or end after it, each displayed partially",
           File(shown, Meta()))
    joined = [Run([Segment(0, 2, [own_body(coded_streams(3, 0, 3), 3)])], 0, 15),
              Run([Segment(-1, 0, [Body(float_streams(2, 0, 3, 0, 15), 2)]), Segment(1, 2, [own_body(coded_streams(2, 0, 4), 2)]),
                   Segment(1, 3, [Body(float_streams(1, 0, 5, 7.5, 5), 1)])], 15, 30, (15, 29), 2.5 + 2.0 ** -20,
                  (1 << 32) - 1)]
    vector("parts_of_two_chunks", "5.3", "intervals and order use the part's own chunk; the greatest part",
           File(joined, Meta()))
    longest = Run([Segment(-1, 0, [Body(float_streams(2, 0, 3, 2.0 ** 31, 20), 2)])], -2.0 ** 31, 2.0 ** 31)
    vector("part_of_2_to_32", "5.3", "the longest part", File([longest], Meta(profile=0)))
    far = Run([Segment(11, 1023, [own_body(coded_streams(2, 0, 4), 2)])], 0.0, 2.0 ** 32, chunk=2.0 ** 12)
    vector("part_to_2_to_32", "5.3", "a part that ends at 2^32", File([far], Meta(frames=(1 << 32) - 1)))
    # The end of the displayed interval against the end of the timeline (5.4).
    for name, last in (("before", 29.0), ("at", 30.0), ("after", 31.0)):
        segments = [small(), small(0, 0, span=5.0), small(0, 11, start=27.5, span=5.0), small(0, 12, start=30.0, span=5.0)]
        vector(f"displayed_{name}_the_end", "5.4", f"a part that is displayed until {last} of 30 frames",
               File([Run(segments, 0, 40, (0, last))], Meta(profile=0)))
    edges = [small(0, 1, start=2.5, span=5.0), small(0, 3, start=7.5, span=5.0), small(0, 4, start=10.0, span=5.0),
             small(0, 5, start=12.5, span=5.0), small(0, 7, start=17.5, span=5.0), small(0, 8, start=20.0, span=5.0)]
    vector("needed_at_edges", "5.4", "segments that touch the displayed interval, or are never needed",
           File([Run(edges, 0, 30, (12.5, 20))], Meta(profile=0)))
    vector("displayed_after_the_timeline", "5.4", "a part that is displayed after the last frame",
           File([run_at(40, 50), run_at(30, 50, 1), run_at(-5, 10, 2)], Meta(profile=0)))


def tree(copied=False, extra=b""):
    """Returns a root with a run and two pages, one of which links to another."""
    leaf = Node([run_at(20, part=2, seed=6)], extra=extra)
    middle = Node([run_at(10, part=1, seed=5)], [Link(leaf, copied=copied)])
    other = Node([run_at(20, part=3, seed=7)])
    return Node([run_at(0, seed=4)], [Link(middle, copied=copied), Link(other, copied=copied)]), [middle, leaf, other]


def with_copies(root, nodes):
    """Returns the items of a body with the copies of pages at its end."""
    items = list(root.runs)
    for node in nodes:
        items += [node, *node.runs]
    return items + [PageCopy(node) for node in nodes]


def pages():
    root, _ = tree()
    vector("pages", "5.2", "three PAGE records, one of which links to another", File(root, Meta(profile=0)))
    root, _ = tree(extra=b"later")
    vector("pages_longer", "5.1", "a PAGE record with additions", File(root, Meta(profile=0)))
    node = Node([run_at(20, part=9)])
    for i in range(8):
        node = Node([run_at(20 - i, part=i)] if i % 3 == 0 else [], [Link(node)])
    vector("pages_eight_deep", "5.2", "eight links that follow each other", File(node, Meta(profile=0)))
    must_fail("pages_nine_deep", "5.2", "nine links that follow each other: the last is not followed",
              File(Node([], [Link(node)]), Meta(profile=0)))
    root, nodes = tree()
    root.links.append(Link(nodes[1], (0.0, 30.0)))
    vector("page_linked_twice", "5.2", "a PAGE record is linked to twice, and read once", File(root, Meta(profile=0), body=
           with_copies(root, nodes)), validator=[316])
    root, nodes = tree()
    nodes[0].links[0].times = (20.0, 20.0)
    vector("link_of_one_time", "5.2", "a link with from = to", File(root, Meta(profile=0)), validator=[316])
    root, nodes = tree()
    nodes[2].runs = []
    vector("page_of_nothing", "5.2", "a node without links and runs", File(root, Meta(profile=0)))


def copies_of_pages():
    def made(copied=True):
        root, nodes = tree(copied)
        file = File(root, Meta(profile=0), body=with_copies(root, nodes), copy=copy_record)
        return file.bytes()

    good = made()
    records = [i for i in range(len(good)) if good.startswith(b"PAGE", i)]
    vector("page_copies", "5.2", "copies of all PAGE records before COPY", good)
    for name, about, at in (("payload", "a flipped bit in a page's payload", records[0] + 40),
                            ("header", "a flipped bit in a page's record header", records[0] + 9),
                            ("tag", "a flipped bit in a page's tag", records[0]),
                            ("leaf", "a flipped bit in the page that another links to", records[1] + 30)):
        must_report(f"page_copy_used_{name}", "5.2", about + "; its copy is used", flipped(good, at))
    must_fail("page_and_copy_damaged", "10.1", "a page and its copy are damaged: the others are read",
              flipped(flipped(good, records[0] + 40), records[3] + 40), clause_of="3.1")
    must_fail("page_copy_header_damaged", "10.1", "a page and the header of its copy are damaged",
              flipped(flipped(good, records[2] + 40), records[5] + 1), clause_of="3.1")
    vector("page_copy_damaged", "5.2", "a copy alone is damaged, which a reader need not notice",
           flipped(good, records[4] + 40), validator=[112])
    alone = made(False)
    for name, at in (("payload", 40), ("tag", 0), ("flags", 4), ("length", 8)):
        must_fail(f"page_damaged_{name}", "10.1", f"a flipped bit in the {name} of a page without a copy: its own links "
                  "are lost, too", flipped(alone, [i for i in range(len(alone)) if alone.startswith(b"PAGE", i)][0] + at),
                  clause_of="3.1")


def further_records():
    layer = 200 << 8
    alone = [small(), Segment(0, 2, [], further=[further(layer, 5, 9.5, level=0, slot=2)])]
    vector("further_alone", "5.7", "a segment of no primitives", File([Run(alone)], Meta(profile=0), last_records=SOUND))
    several = small(0, 2, start=5, span=5.0, further=[
        further(layer, 5, 10, "", b"", 0, 2), further(layer + 1, 10, 10, "org.example.pose", b"1", 0, 2),
        further(255 << 8 | 255, 5, 5, "a/b", b"2", 0, 2)])
    vector("further_several", "5.7", "three further records of one segment, without bytes or length; the last layer",
           File([Run([several])], Meta(profile=0), last_records=private((2, 200, "a"), (2, 255, "b"))))
    reserved = small(further=[(512, b""), (4 << 8, b"any"), (191 << 8 | 255, b"thing"), further(192 << 8, 0, 30)])
    vector("further_reserved", "5.5", "contents 2, 4 and 191 are ignored; content 192", File(
        [Run([reserved])], Meta(profile=0), last_records=private((2, 192, "a"))))
    damaged = File([Run([small(further=[(512, b"payload"), further(layer, 0, 30)])])], Meta(profile=0),
                   last_records=SOUND).bytes()
    vector("further_reserved_damaged", "5.5", "a record of content 2 is damaged, and ignored",
           flipped(damaged, damaged.index(b"payload")), validator=[112])
