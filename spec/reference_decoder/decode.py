#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Decodes .stgs files as stgs-format.md defines, favouring clarity over speed.

usage: decode.py [--max-primitives N] [--max-memory BYTES] [--floats] FILE...

Prints the lines of conformance.md 3.2 for each file, and a line for each part that is refused and for
each error that is reported; with --floats also the numbers of each attribute. Exit code 3: something
was refused.
"""
import hashlib
import struct
import sys

from container import Limits, open_file, read_importance
from ends import ends_of
from fields import Refused
from index import needed
from layouts import NAMES
from segment import decode_tier, little_endian, read_further
from streams import floats


class Description:
    """The lines of a file, its refused parts, and the reported errors."""

    def __init__(self):
        self.lines = []
        self.refused = []    # (part, Refused)
        self.reports = []    # Refused
        self.streams = {}    # (part, level, slot, tier): {attribute: Integers}

    def line(self, *words):
        self.lines.append(" ".join(str(word) for word in words))

    def refuse(self, part, error):
        self.refused.append((part, error))

    def text(self):
        return "".join(line + "\n" for line in self.lines)


def sha(data):
    return hashlib.sha256(data).hexdigest()


def f32(values):
    return " ".join(struct.pack(">f", v).hex() for v in values)


def f64(*values):
    return " ".join(struct.pack(">d", v).hex() for v in values)


def texted(data):
    return data.hex() or "-"


def describe(data, limits):
    """Returns the Description of a file (conformance.md 3.2)."""
    out = Description()
    try:
        file = open_file(data, limits)
    except Refused as error:
        out.refuse("file", error)
        return out
    out.reports = file.reports
    describe_scene(file, out)
    describe_index(file, out)
    for run, segment in segments_of(file):
        describe_segment(file, run, segment, out)
    try:
        importance = read_importance(file)
        if importance is not None:
            out.line("importance", sha(importance))
    except Refused as error:
        out.refuse("importance", error)
    return out


def describe_scene(file, out):
    m = file.meta
    out.line("file", file.state, file.frames, *m.time_base)
    out.line("scene", m.kernel, m.axes, m.sh, m.degree, m.profile, m.primaries, m.transfer)
    out.line("background", f32(m.background))
    out.line("bounds", f32(file.bounds))
    out.line("near", f32([m.near]))
    out.line("camera", *m.size, *[f32(m.pose)] * (m.size != (0, 0)))
    out.line("texts", texted(m.generator), texted(m.title))
    out.line("world", f32([m.metres] + m.up + m.floor))
    out.line("audio", texted(m.audio), f64(m.audio_begin))
    if file.window:
        out.line("window", *file.window)
    for kind, number, name in file.private:
        out.line("private", kind, number, texted(name))
    for attribute, greatest, rms in file.error_bounds:
        out.line("error", attribute, f32([greatest, rms]))
    if file.step is not None:
        out.line("step", sha(file.step))
    out.line("primitives", file.total)


def describe_index(file, out):
    for link in sorted({(v.offset, v.copy, v.bytes, f64(v.first, v.last)) for v in file.links}):
        out.line("link", *link)
    for tag, offset, error in file.lost:
        out.refuse(f"{tag} {offset}", error)
    for part in sorted({(r.part, r.begin, r.end, r.first, r.last, r.chunk) for r in file.runs()}):
        out.line("part", *part)


def segments_of(file):
    """Returns the segments with their runs, by part, level, slot and offset."""
    segments = [(run, s) for run in file.runs() for s in run.segments]
    return sorted(segments, key=lambda v: (v[0].part, v[1].level, v[1].slot, (v[1].tiers + v[1].further)[0].offset))


def describe_segment(file, run, segment, out):
    place = run.part, segment.level, segment.slot
    when = needed(run, segment, file.frames)
    out.line("segment", *place, segment.start, segment.stop,
             *(("never",) if when is None else (when[0], when[1], "closed" if when[2] else "open")))
    for tier, record in enumerate(segment.tiers):
        out.line("tier", *place, tier, record.offset, record.n)
        try:
            streams, error = decode_tier(file, run, segment, tier)
        except Refused as error:
            out.refuse(f"tier {place[0]} {place[1]} {place[2]} {tier}", error)
            continue
        out.streams[(*place, tier)] = streams
        for attribute, stream in streams.items():
            describe_stream(place, tier, attribute, stream, out)
        if error:
            out.refuse(f"sh {place[0]} {place[1]} {place[2]} {tier}", error)
        for primitive, time in sorted(ends_of(file, run, segment, tier).items()):
            out.line("end", *place, tier, primitive, time)
    for record in segment.further:
        describe_further(file, place, segment, record, out)


def describe_stream(place, tier, attribute, stream, out):
    row = stream.row
    numbers = [v for component in stream.q for v in component]
    words = [len(stream.q[0]), row.mapping, row.m, row.e, f32(row.origin), sha(little_endian(numbers))]
    if row.mapping in (3, 6):
        words.append(sha(little_endian(stream.exponents)))
    if row.mapping == 7:
        words.append(stream.first)
    out.line("attribute", *place, tier, NAMES[attribute], *words)


def describe_further(file, place, segment, record, out):
    if record.layer < 192 * 256:  # reserved contents are ignored (5.5)
        return
    try:
        begin, end, kind, data = read_further(file, segment, record)
        out.line("further", *place, record.layer, f64(begin, end), texted(kind), sha(data))
    except Refused as error:
        out.refuse(f"further {place[0]} {place[1]} {place[2]} {record.layer}", error)


def print_floats(out):
    for place, streams in out.streams.items():
        for attribute, stream in sorted(streams.items()):
            for c, component in enumerate(floats(stream)):
                print("  floats", *place, NAMES[attribute], c, *component)


def main(arguments):
    limits, with_floats, files = Limits(), False, []
    while arguments:
        argument = arguments.pop(0)
        if argument == "--floats":
            with_floats = True
        elif argument in ("--max-primitives", "--max-memory") and arguments:
            setattr(limits, argument[2:].replace("-", "_"), int(arguments.pop(0)))
        elif argument.startswith("-"):
            sys.exit(__doc__)
        else:
            files.append(argument)
    if not files:
        sys.exit(__doc__)
    any_refused = False
    for path in files:
        with open(path, "rb") as file:
            out = describe(file.read(), limits)
        print(f"{path}:")
        print("".join("  " + line + "\n" for line in out.lines), end="")
        for error in out.reports:
            print(f"  reported: {error}")
        for part, error in out.refused:
            print(f"  refused {part}: {error}")
        if with_floats:
            print_floats(out)
        any_refused = any_refused or bool(out.refused)
    sys.exit(3 if any_refused else 0)


if __name__ == "__main__":
    main(sys.argv[1:])
