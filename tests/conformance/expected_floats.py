# SPDX-License-Identifier: Apache-2.0
"""The floats that the manifest states (spec/conformance.md 3.4), and primitives that are visible outside their
segment (5.8)."""
import math


def expected_floats(out):
    """Returns the numbers of each attribute of a file's tiers, one primitive after the other."""
    from layouts import NAMES  # of spec/reference_decoder
    from streams import floats
    tiers = []
    for (part, level, slot, tier), streams in out.streams.items():
        numbers = {NAMES[a]: [v for primitive in zip(*floats(s)) for v in primitive]
                   for a, s in sorted(streams.items()) if s.row.mapping not in (0, 8)}
        origins = {NAMES[a]: max(map(abs, s.row.origin)) for a, s in sorted(streams.items())
                   if s.row.mapping not in (0, 8)}
        tiers.append({"tier": [part, level, slot, tier], "floats": numbers, "origins": origins})
    return tiers


def is_outside(out):
    """Returns whether a primitive of the file is visible outside its segment's interval (5.8)."""
    lengths, intervals = {}, {}
    for words in (line.split() for line in out.lines):
        if words[0] == "part":
            lengths[int(words[1])] = (int(words[3]) - int(words[2])) / 2.0 ** 20
        elif words[0] == "segment":
            intervals[tuple(map(int, words[1:4]))] = int(words[4]) / 2.0 ** 21, int(words[5]) / 2.0 ** 21
    return any(is_visible_outside(streams, lengths[place[0]], *intervals[place[:3]])
               for place, streams in out.streams.items())


def is_visible_outside(streams, length, start, stop):
    from streams import floats
    for t, sigma, radius, logit in zip(*(floats(streams[a])[0] for a in (2, 3, 4, 8))):
        visible = math.log(255) - (math.log1p(math.exp(-logit)) if logit > -700 else -logit)  # ln(255 O)
        if visible < 0:
            continue
        support = radius + sigma * math.sqrt(visible)
        first, last = max(0.0, t - support), min(length, t + support)
        if first <= last and (first < start - 0.01 or last > stop + 0.01):
            return True
    return False
