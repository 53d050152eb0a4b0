# SPDX-License-Identifier: Apache-2.0
"""Opens a file: the head, all nodes of the index (5.2, 9.3), ends (5.9), and IMPO (11.9)."""
import math
import struct
from dataclasses import dataclass, field

import ends
import growing
import layouts
import metadata
from fields import LIMIT, RECORD, Fields, Refused, check_available, check_payload, need, need_memory, record_header
from head import head_records, open_head
from index import Entries, may_be_needed, read_node

DEPTH = 8  # 5.2


@dataclass
class Limits:  # conformance.md 1.5
    max_primitives: int = 200_000_000
    max_memory: int = 4 << 30


@dataclass
class File:
    data: bytes
    limits: Limits
    end: int = 0                 # of the file, as it states or as the last fragment shows
    head: bytes = b""
    flags: int = 0               # of the header
    state: str = "finished"      # or "growing", "closed"
    frames: int = 0
    bounds: list = None
    total: int = 0               # primitives, as the file states
    meta: metadata.Meta = None
    layouts: object = field(default_factory=layouts.Layouts)
    window: tuple = None
    private: list = field(default_factory=list)
    error_bounds: list = field(default_factory=list)
    step: bytes = None
    nodes: list = field(default_factory=list)
    links: list = field(default_factory=list)
    ends: list = field(default_factory=list)      # of ends.Ends
    reports: list = field(default_factory=list)   # Refused: errors after which reading continues
    lost: list = field(default_factory=list)      # (tag, offset, Refused) of nodes
    seen: set = field(default_factory=set)        # offsets of linked records
    used_earlier: set = field(default_factory=set)  # offsets of fragments whose earlier links were followed
    node_bytes: int = 0
    complete_bytes: int = 0      # of nodes whose bytes are all there
    record_bytes: int = 0        # of the payloads of listed records whose bytes are all there
    entries: Entries = None
    listed: int = 0              # primitives of all nodes that were read

    def runs(self):
        return [run for node in self.nodes for run in node.runs]


def open_file(data, limits):
    reports = []

    def fragment_head():
        found = growing.Fragments(data, None, limits.max_memory).last()
        return found.head if found else b""

    header, head = open_head(data, limits.max_memory, fragment_head, reports)
    file = File(data, limits, header.file_bytes, head, header.flags, reports=reports, entries=Entries(limits.max_memory))
    have = head_records(head, header.growing(), reports)
    file.meta = metadata.read_meta(have[b"META"])
    file.frames, file.bounds = file.meta.frames, file.meta.bounds
    metadata.check_shown(file.meta, reports)
    if b"LAYT" in have:
        file.layouts = layouts.read_shared(have[b"LAYT"], limits.max_memory)
    if header.growing():
        read_growing(file)
    else:
        if len(data) != file.end:
            reports.append(Refused("2.4", 106, f"{len(data)} bytes instead of {file.end}"))
        read_index(file, have[b"INDX"])
    read_all_ends(file)
    read_aside(file, have)
    return file


def read_aside(file, have):
    """Reads the records of the head that are not critical; errors are reported (3.4)."""
    try:
        file.private = metadata.read_private_names(have.get(b"PRIV", b"\0\0"))
    except Refused as error:
        file.reports.append(error)
    try:
        if b"WNDW" in have:
            file.window = metadata.read_window(have[b"WNDW"], file.frames)
    except Refused as error:
        file.reports.append(error)
    try:
        file.error_bounds = metadata.read_error_bounds(have.get(b"ERRB", b"\0\0"))
    except Refused as error:
        file.reports.append(error)
    file.step = have.get(b"STEP")


def read_index(file, payload):  # 5.1
    fields = Fields(payload, "5.1", 300)
    file.total = fields.number()
    totals = fields.number()
    need(totals <= 1024, "5.1", 300, f"{totals} attribute totals")
    for _ in range(totals):
        need(fields.number() <= 65535, "5.1", 300, "an attribute above 65535")
        fields.number()
    check_primitives(file, file.total)
    node = read_node(fields, 0, (len(file.head), file.end), file.limits.max_memory)
    add_node(file, node)
    for link in node.links:
        follow_page(file, link, 1)


def add_node(file, node):
    file.nodes.append(node)
    file.links += node.links
    file.entries.take(node.entries())
    file.listed += sum(tier.n for run in node.runs for s in run.segments for tier in s.tiers)
    check_primitives(file, file.listed)
    file.record_bytes += sum(r.bytes for r in node.records() if r.offset + RECORD + r.bytes <= len(file.data))
    need_memory(file.record_bytes, len(file.data), f"{file.record_bytes} bytes of records that overlap")


def check_primitives(file, count):  # conformance.md 1.5
    need(count <= file.limits.max_primitives, "conformance 1.5", 307, f"{count} primitives")


def count_bytes(file, at, size):  # conformance.md 1.5
    file.node_bytes += size
    need_memory(file.node_bytes, file.limits.max_memory, f"{file.node_bytes} bytes of nodes")
    count_complete(file, size if at + RECORD + size <= len(file.data) else 0)


def count_complete(file, size):
    file.complete_bytes += size
    need_memory(file.complete_bytes, len(file.data), f"{file.complete_bytes} bytes of nodes that overlap")


def follow_page(file, link, depth):  # 5.2
    if link.offset in file.seen:
        return
    file.seen.add(link.offset)
    try:
        need(depth <= DEPTH, "5.2", 316, f"more than {DEPTH} links follow each other")
        count_bytes(file, link.offset, link.bytes)
        node = read_page(file, link)
    except Refused as error:
        if error.number == LIMIT:
            raise
        file.lost.append(("page", link.offset, error))
        return
    add_node(file, node)
    for further in node.links:
        follow_page(file, further, depth + 1)


def read_page(file, link):
    try:
        payload = page_payload(file, link.offset, link.bytes)
    except Refused as damage:
        try:  # 0, the beginning of the header, is no record
            payload = page_payload(file, link.copy, link.bytes)
        except Refused:
            raise damage from None
        file.reports.append(Refused("5.2", 118, f"the PAGE record at {link.offset} was read from its copy"))
        count_complete(file, link.bytes)
    return read_node(Fields(payload, "5.2", 300), link.offset, (len(file.head), file.end), file.limits.max_memory)


def page_payload(file, at, size):
    check_available(file.data, at, size)
    tag, flags, length, _ = record_header(file.data, at, file.end)
    need((tag, flags, length) == (b"PAGE", 1, size), "5.2", 317, f"no PAGE record of {size} bytes at {at}")
    return check_payload(file.data, at)


def read_growing(file):  # 9
    file.state = "growing"
    fragments = growing.Fragments(file.data, file.head, file.limits.max_memory)
    last = fragments.last()
    if (last is None or last.end < len(file.data)) and fragments.damaged():
        file.reports.append(Refused("9.4", 313, "a damaged FRAG record after the last fragment"))
    if last is None:  # before the first fragment
        file.end = len(file.head)
        return
    need(last.flags & 0xFFFE == 0, "9.2", 113, f"flags {last.flags:#x} of a fragment")
    file.end, file.frames, file.bounds, file.total = last.end, last.frames, last.bounds, last.total
    if last.flags & 1 == 1:
        file.state = "closed"
        if file.end < len(file.data):
            file.reports.append(Refused("9.4", 106, "bytes after a closed fragment"))
    check_primitives(file, file.total)
    use_fragment(file, fragments, last, 0)


def use_fragment(file, fragments, fragment, depth):
    """Uses the node of the last fragment, or of one that 9.5 names, and its earlier links (9.3)."""
    count_bytes(file, fragment.at, fragment.end - fragment.at - RECORD)
    use_node(file, fragments, fragment, depth)
    use_earlier(file, fragments, fragment, depth)


def use_node(file, fragments, fragment, depth):  # 9.3
    add_node(file, fragment.node)
    for link in fragment.node.links:
        follow_fragment(file, fragments, link, depth + 1)


def use_earlier(file, fragments, fragment, depth):  # 9.3, 9.5
    if fragment.at in file.used_earlier:
        return
    file.used_earlier.add(fragment.at)
    file.links += fragment.earlier
    file.entries.take(len(fragment.earlier))
    for link in fragment.earlier:
        follow_fragment(file, fragments, link, depth + 1)


def follow_fragment(file, fragments, link, depth):
    if link.offset in file.seen:
        return
    file.seen.add(link.offset)
    if depth > DEPTH:
        error = Refused("5.2", 316, f"more than {DEPTH} links follow each other")
        file.lost.append(("fragment", link.offset, error))
        return
    count_bytes(file, link.offset, link.bytes)
    try:
        fragment = fragments.read(link.offset, link.bytes)
    except Refused as error:
        if error.number == LIMIT:
            raise
        file.lost.append(("fragment", link.offset, Refused("9.5", 313, str(error))))
        follow_instead(file, fragments, link.offset, depth)
        return
    use_node(file, fragments, fragment, depth)


def follow_instead(file, fragments, offset, depth):  # 9.5
    found = fragments.last_before(offset)
    if found is None:
        return
    if found.at in file.seen:
        use_earlier(file, fragments, found, depth)
    else:
        file.seen.add(found.at)
        use_fragment(file, fragments, found, depth)


def read_all_ends(file):  # 5.9
    for run in file.runs():
        for segment in run.segments:
            for record in filter(ends.is_ends, segment.further):
                if not may_be_needed(run, segment):
                    continue
                count_bytes(file, record.offset, record.bytes)
                try:
                    file.ends.append(ends.read_ends(file, run, segment, record))
                except Refused as error:
                    file.reports.append(error)


def read_importance(file):
    """Returns the payload of the first IMPO record after the last SEGM record, or None (11.9)."""
    if file.state != "finished":
        return None
    at = len(file.head)
    for run in file.runs():
        for s in run.segments:
            for r in s.tiers + s.sh + s.further:
                at = max(at, r.offset + RECORD + r.bytes)
    while at < file.end:
        tag, flags, length, _ = record_header(file.data, at, file.end)
        if (tag, flags) == (b"IMPO", 0):
            check_available(file.data, at, length)
            need_memory(length, file.limits.max_memory, f"{length} bytes of importance")
            payload = check_payload(file.data, at)
            need(len(payload) == 4 * file.total, "11.9", 312, f"{len(payload)} bytes of importance")
            for value in struct.unpack(f"<{file.total}f", payload):
                need(0 <= value < math.inf, "11.9", 312, f"an importance of {value}")
            return payload
        at += RECORD + length
    return None
