# SPDX-License-Identifier: Apache-2.0
"""Writes growing files (5.12) for the vectors."""
import struct
from dataclasses import dataclass, replace

from vector_file import VERSION, File, Meta, checksum, record


@dataclass
class Fragment:
    """Fields of a FRAG record; None: the value that a writer would write."""
    frames: int = None
    flags: int = 0
    previous: int = None
    before: int = None
    offset: int = None
    head: int = None
    bounds: tuple = (-10.0, -10.0, -10.0, 10.0, 10.0, 10.0)
    length: int = 0          # added to the length at the end of the payload
    chunk: float = 5.0


def growing(parts, fragments=None, closed=None, tail=b"", file_bytes=0, last_records=b"", flags=1,
            keep_skips=False, meta=None, copy=None):
    """Returns a recording of these parts with a FRAG record after each, and a closing one with the
    fields of `closed`. `copy` makes the COPY record of a head."""
    meta = meta or Meta(profile=0, frames=1)
    head = record(b"META", meta.payload()) + last_records
    version = (VERSION[0], 1) if copy else VERSION
    out = b"\x89STG\r\n\x1a\n" + struct.pack("<HHIQQ", *version, flags, file_bytes, 40 + len(head))
    out += struct.pack("<Q", checksum(out)) + head
    offsets, sizes, head_sum = [], [], checksum(out)
    copied = copy(out) if copy else b""
    out += copied
    for i, part in enumerate(parts, 1):
        out += File([part]).body()
        first = i & (i - 1)  # lists as many parts as the greatest power of two that divides i
        fields = fragments[i - 1] if fragments else Fragment()
        offsets.append(len(out))
        out += fragment(parts[first:i], part.end, fields,
                        (sizes[first - 1:] if first else [len(copied)] + sizes),
                        len(out), head_sum, offsets[first - 1] if first else 0, ([0] + offsets)[-2],
                        keep_skips)
        sizes.append(len(out) - offsets[-1])
    if closed:
        out += fragment(parts, parts[-1].end, closed, [len(copied)] + sizes, len(out), head_sum, 0, offsets[-1])
    return out + tail


def fragment(parts, end, fields, skips, offset, head_sum, previous, before, keep_skips=False):
    listed = parts if keep_skips else [replace(part, skip=skip + len(part.before)) for part, skip in zip(parts, skips)]
    payload = struct.pack("<II6f", int(end) if fields.frames is None else fields.frames, fields.flags,
                          *fields.bounds)
    for own, value in ((fields.offset, offset), (fields.head, head_sum), (fields.previous, previous),
                       (fields.before, before)):
        payload += struct.pack("<Q", value if own is None else own)
    payload += File(listed, chunk=fields.chunk).index_payload()
    return record(b"FRAG", payload + struct.pack("<Q", len(payload) + 8 + fields.length))
