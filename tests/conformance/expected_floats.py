# SPDX-License-Identifier: Apache-2.0
"""The floats that the manifest states (spec/conformance.md 3.4)."""


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
