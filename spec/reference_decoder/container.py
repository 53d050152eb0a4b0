# SPDX-License-Identifier: Apache-2.0
"""Clauses 2, 3 and 5: header, records, heads, growing files, IMPO."""
import math
from dataclasses import dataclass, field, replace
from operator import le

import layouts
from copies import HEADER, MAGIC, repaired_head
from fields import RECORD, Fields, Refused, checksum, need, record_at
from index import read_index
from metadata import read_meta, read_private_names, read_window

CRITICAL = (b"META", b"LAYT", b"INDX", b"FRAG", b"SEGM")  # 3.2


@dataclass
class Limits:  # conformance.md 1.5
    max_primitives: int = 200_000_000
    max_memory: int = 16 << 30


@dataclass
class File:
    data: bytes
    head_bytes: int = 0
    frames: int = 0
    degree: int = 0
    profile: int = 0
    layouts: object = field(default_factory=layouts.Layouts)
    tiers: list = field(default_factory=list)
    entries: int = 0         # of the index: parts, tiers, further records
    limits: Limits = None
    body_at: int = 0         # end of the last record that the index lists
    end: int = 0             # end of the complete content
    growing: bool = False
    minor: int = 0
    chunk: float = None
    damage: list = field(default_factory=list)  # Refused: errors after which reading continues


def read_header(data):
    need(len(data) >= HEADER, "2.2", "too short for a header")
    need(data[:8] == MAGIC, "2.1", "wrong magic bytes")
    fields = Fields(data[8:HEADER], "2.2")
    major, minor, flags = fields.u16(), fields.u16(), fields.u32()
    file_bytes, head_bytes = fields.u64(), fields.u64()
    need(fields.u64() == checksum(data[:32]), "2.2", "the header's checksum")
    need(major == 1, "2.5", f"version {major}.{minor}", unsupported=True)
    need(flags & 0xFFFE == 0, "2.4", f"flags {flags:#x}", unsupported=True)
    growing = flags & 1 == 1
    need(file_bytes == 0 or not growing, "2.6", "a growing file that states its size")
    need(growing or HEADER <= head_bytes <= file_bytes, "2.3", f"a head of {head_bytes} bytes")
    need(head_bytes >= HEADER, "2.3", f"a head of {head_bytes} bytes")
    need(head_bytes <= len(data), "2.6", "shorter than its head")
    return head_bytes, len(data) if growing else file_bytes, growing, minor


def known(tag, flags, tags):
    """Returns whether a record is one of these critical ones; refuses records that must not be
    skipped (3.2, 3.4)."""
    if tag in tags and flags == 1:
        return True
    need(flags & 1 == 0, "3.4", f"critical record {tag}, flags {flags}", unsupported=True)
    need(tag not in CRITICAL or flags != 0, "3.2", f"record {tag} is not marked critical")
    return False


def read_aside(file, tag, payload, payload_sum, have):
    """Reads WNDW or PRIV; reports its errors and ignores it then (3.4)."""
    try:
        need(checksum(payload) == payload_sum, "3.1", f"the checksum of {tag}")
        need(tag not in have, "2.3", f"a second {tag}")
        if tag == b"PRIV":
            read_private_names(payload)
        else:
            read_window(payload)
        have[tag] = payload
    except Refused as error:
        file.damage.append(error)


def read_head(file, limits):
    need(file.head_bytes <= limits.max_memory, "conformance 1.5", f"a head of {file.head_bytes} bytes",
         unsupported=True)
    have = {}
    at = HEADER
    while at < file.head_bytes:
        tag, flags, payload, payload_sum = record_at(file.data, at, file.head_bytes)
        at += RECORD + len(payload)
        tags = (b"META", b"LAYT") if file.growing else (b"META", b"LAYT", b"INDX")
        if tag in (b"WNDW", b"PRIV") and flags == 0:
            read_aside(file, tag, payload, payload_sum, have)
            continue
        if not known(tag, flags, tags):
            continue
        need(checksum(payload) == payload_sum, "3.1", f"the checksum of {tag}")
        need(tag not in have, "2.3", f"a second {tag}")
        need(tag != b"INDX" or b"META" in have, "2.3", "INDX before META")
        have[tag] = payload
        if tag == b"META":
            read_meta(file, payload)
    need(b"META" in have and (file.growing or b"INDX" in have), "2.3", "no META or INDX")
    if b"LAYT" in have:
        file.layouts = layouts.read_layouts(Fields(have[b"LAYT"], "6.2"), limits.max_memory)
    if file.growing:
        read_fragments(file)
    if b"WNDW" in have:
        first, capture_frames = read_window(have[b"WNDW"])
        if first + file.frames > capture_frames:
            file.damage.append(Refused("4.5", "the training window is not within its capture"))
    if not file.growing:
        if len(file.data) != file.end:
            file.damage.append(Refused("2.6", f"{len(file.data)} bytes, not {file.end}"))
        read_index(file, Fields(have[b"INDX"], "5.2"), file.head_bytes)
    check_limits(file, limits)


class Fragment:
    """The FRAG record at `at`, if it is valid; it must end at or before `end` (5.12)."""

    def __init__(self, file, at, end):
        need(at >= file.head_bytes, "5.12", f"a fragment at byte {at}")
        tag, flags, payload, payload_sum = record_at(file.data, at, end)
        need((tag, flags) == (b"FRAG", 1) and len(payload) >= 72, "5.12", f"no FRAG record at byte {at}")
        need(checksum(payload) == payload_sum, "5.12", f"the checksum of the fragment at byte {at}")
        self.at, self.end = at, at + RECORD + len(payload)
        self.index = Fields(payload[:-8], "5.12")
        self.frames, self.flags = self.index.u32(), self.index.u32()
        self.bounds = [self.index.f32() for _ in range(6)]
        own, head = self.index.u64(), self.index.u64()
        self.previous, self.before = self.index.u64(), self.index.u64()
        need(own == at and head == checksum(file.data[:file.head_bytes]), "5.12",
             f"the fragment at byte {at} belongs to another offset or file")


def reachable_fragment(file, at, end):
    """Returns the FRAG record at `at` if it is reachable (5.12), otherwise None."""
    try:
        found = Fragment(file, at, end)
        at = file.head_bytes
        if found.before != 0:
            need(found.before >= file.head_bytes, "5.12", "a FRAG record in the head")
            tag, flags, payload, _ = record_at(file.data, found.before, found.at)
            need((tag, flags) == (b"FRAG", 1) and len(payload) >= 72, "5.12", "not a FRAG record")
            at = found.before + RECORD + len(payload)
        first = at
        while at != found.at:
            try:
                tag, flags, payload, _ = record_at(file.data, at, found.at)
            except Refused:
                return found if file.minor >= 1 and lists_a_record(file, found, first) else None
            if (tag, flags) == (b"SEGM", 1):
                break
            at += RECORD + len(payload)
        return found
    except Refused:
        return None


def lists_a_record(file, found, first):
    """Returns whether one of the records of content 0 that a FRAG record lists, at or after `first`,
    has a valid header."""
    listed = replace(file, tiers=[], chunk=None)
    read_index(listed, Fields(found.index.data[found.index.at:], "5.12"), found.previous or file.head_bytes, found.at)
    for tier in listed.tiers:
        try:
            tag, flags, _, _ = record_at(file.data, tier.base.offset, found.at)
            if tier.base.offset >= first and (tag, flags) == (b"SEGM", 1):
                return True
        except Refused:
            pass
    return False


def last_before(file, end):
    """Returns the reachable FRAG record that begins last of those that end at or before `end`, or
    None."""
    at = end
    while (at := file.data.rfind(b"FRAG", file.head_bytes, at)) >= 0:
        found = reachable_fragment(file, at, end)
        if found:
            return found
        at += 3  # finds tags that begin before this one
    return None


def last_fragment(file):
    data = file.data
    if len(data) >= file.head_bytes + RECORD + 8:
        at = len(data) - RECORD - int.from_bytes(data[-8:], "little")
        found = reachable_fragment(file, at, len(data)) if at >= file.head_bytes else None
        if found:
            return found
    return last_before(file, len(data))


def read_fragments(file):  # 5.12
    last = last_fragment(file)
    file.end = file.body_at = file.head_bytes
    if last is None:
        return
    file.end = last.end
    need(last.flags & 0xFFFE == 0, "5.12", f"a fragment's flags {last.flags}", unsupported=True)
    need(last.frames > 0, "5.12", "a file of no frames")
    need(all(map(math.isfinite, last.bounds)) and all(map(le, last.bounds[:3], last.bounds[3:])),
         "4.3", "the bounds")
    if last.flags & 1 == 1 and file.end < len(file.data):
        file.damage.append(Refused("5.12", "bytes after a closed fragment"))
    file.frames = last.frames
    chain = [last]
    while chain[0].previous != 0:
        at = chain[0].previous
        need(file.head_bytes <= at < chain[0].at, "5.12", f"a fragment follows one at byte {at}")
        try:
            found = Fragment(file, at, chain[0].at)
        except Refused:
            file.damage.append(Refused("5.12", f"the fragment at byte {at} is damaged"))
            found = last_before(file, at)
            if found is None:
                break
        chain.insert(0, found)
    size = sum(len(found.index.data) + 8 for found in chain)
    need(size <= file.limits.max_memory, "conformance 1.5", f"{size} bytes of index", unsupported=True)
    for found in chain:
        need(found.flags & 0xFFFE == 0, "5.12", f"a fragment's flags {found.flags}", unsupported=True)
        need(found.flags & 1 == 0 or found is last, "5.12", "a fragment follows a closed one")
        read_index(file, found.index, found.previous or file.head_bytes, found.at)


def check_limits(file, limits):
    total = sum(tier.n for tier in file.tiers)
    need(total <= limits.max_primitives, "conformance 1.5", f"{total} primitives", unsupported=True)
    need(512 * (file.entries - 1024) <= limits.max_memory, "conformance 1.5",
         f"{file.entries} entries of the index", unsupported=True)
    for tier in file.tiers:
        need(floats_bytes(file, tier) <= limits.max_memory, "conformance 1.5",
             f"{tier.n} primitives in a segment", unsupported=True)


def floats_bytes(file, tier):
    return 4 * (17 + 3 * (file.degree + 1) ** 2) * tier.n


def present(file, at, size):  # 2.6
    need(min(at + size, file.end) <= len(file.data), "2.6", "bytes missing from a truncated file")


def read_importance(file):
    """Returns the payload of the first IMPO record after the last SEGM record, or None (5.11)."""
    at = file.body_at
    while at < file.end:
        present(file, at, RECORD)
        length = int.from_bytes(file.data[at + 8:at + 16], "little")
        tag, flags, payload, payload_sum = record_at(file.data, at, file.end)
        at += RECORD + length
        if tag != b"IMPO" or flags != 0:
            continue
        present(file, at - length, length)
        need(checksum(payload) == payload_sum, "3.1", "the checksum of IMPO")
        need(len(payload) == 4 * sum(tier.n for tier in file.tiers), "5.11", "the size of IMPO")
        fields = Fields(payload, "5.11")
        for _ in range(len(payload) // 4):
            value = fields.f32()
            need(math.isfinite(value) and value >= 0, "5.11", f"an importance of {value}")
        return payload
    return None


def open_file(data, limits):
    head = repaired_head(data, limits)
    file = File(data if head is None else head + data[len(head):], limits=limits)
    if head is not None:
        file.damage.append(Refused("3.6", "the head is damaged and was read from its copy"))
    file.head_bytes, file.end, file.growing, file.minor = read_header(file.data)
    read_head(file, limits)
    return file
