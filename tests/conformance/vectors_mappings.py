# SPDX-License-Identifier: Apache-2.0
"""Valid streams: predictions and mappings (8)."""
from vector_file import File, Meta, Run, Segment
from vector_list import coded, plain, replaced, vector
from vector_records import BYTES, RANS, Stream, bits_of
from vector_scenes import coded_streams, deltas, float_streams, own_body, zigzags

NEGATIVE = 1 << 32


def valid_streams():
    predictions()
    linear()
    lives()
    rotations()
    colours()
    times()
    values_of_floats()
    many = coded_streams(6, 1, 44, shaped=True)
    for s, m in zip(many, (3, 7, 5, 13, 9, 5, 3, 15, 11, 1, 255)):
        s.m = m
    many[2].e = many[3].e = 17
    vector("multipliers", "8.5", "m of 3 to 255 in mappings 1, 2, 3, 5, 6 and 7, in a slot",
           File([Run([Segment(2, 1, [own_body(many, 6)])])], Meta(degree=1)), floats=True)
    vector("coded_degree_3", "8.5", "mapping 5 for all SH", coded(7, 3, 21), floats=True)


def predictions():
    vector("zigzag", "8.3", "prediction 1: 0, 1, 2, and the greatest of 24 bits",
           replaced(Stream(8, 1, -20, [[0, 1, 2, (1 << 25) - 2, (1 << 25) - 3]], 1), n=5))
    vector("delta", "8.3", "prediction 2 of three components",
           replaced(Stream(6, 1, -22, [[11, 4, 3, 20, 0, 1], [0] * 6, [(1 << 25) - 2, 3, 1, 2, 1, 0]], 2), n=6))
    for name, about, v, low, bits, key in (
            ("morton", "no low bits", [[0, 5, 1000]], 0, (8, 8), 12345),
            ("morton_low_1", "1 low bit", [[0, 5, 1000], [1, 0, 1], [0, 1, 1], [1, 1, 0]], 1, (8, 8), 7),
            ("morton_low_4", "4 low bits", [[0, 5, 1000], [1, 2, 15], [3, 0, 7], [9, 8, 0]], 4, (8, 8), 7),
            ("morton_low_8", "8 low bits", [[0, 5, 1000], [1, 200, 255], [3, 0, 7], [9, 8, 0]], 8, (8, 8), 7),
            ("morton_low_9", "9 low bits", [[0, 5, 1000], [1, 200, 511], [3, 256, 7], [9, 8, 0]], 9, (4, 8), 7),
            ("morton_low_14", "14 low bits and the last key",
             [[1, 0, 5], [1, (1 << 14) - 1, 255], [256, 511, 7], [9, 8192, 0]], 14, (3,), (1 << 30) - 7)):
        coders = (BYTES, RANS) if low in (0, 8) and bits == (8, 8) else (RANS,)
        for coder in coders:
            vector(name + "_bytes" * (coder == BYTES), "8.4", f"prediction 3, {about}",
                   replaced(Stream(1, 1, -10, v, 3, coder, bits, (1.0, 2.0, 3.0), low=low), first_key=key,
                            n=3))
    wide = Stream(1, 1, -10, [[0, 0, 0]] * 4, 3, RANS, (8,), low=4,
                  digits=[bytes([1, 2, 3]), bytes([255, 0, 16]), bytes(3), bytes([17, 18, 19])])
    vector("morton_wide_low", "8.4", "low components above 2^low are added", replaced(wide))


def linear():
    limits = Stream(8, 1, -24, [[(1 << 24) - 1, NEGATIVE - (1 << 24) + 1, 0]], 0)
    vector("integers_of_24_bits", "8.5", "the minimum and the maximum", replaced(limits))
    limits = Stream(8, 1, -24, [[65793, NEGATIVE - 65793, 0]], m=255)
    vector("multiplied_integers_of_24_bits", "8.5", "the minimum and the maximum for m = 255", replaced(limits),
           floats=True)
    for name, e in (("least_step", -100), ("greatest_step", 100)):
        vector(name, "8.5", f"e = {e} and an origin of -2^{e}",
               replaced(Stream(8, 1, e, [[(1 << 24) - 1, NEGATIVE - 1, 0]], origin=(-2.0 ** e,))))
    vector("origin_per_component", "8.5", "the origin of SH is that of component c mod 3",
           replaced(Stream(11, 1, -4, [[c, c + 1] for c in range(9)], origin=(1.0, 2.0, 4.0)),
                    n=2, degree=1), floats=True)
    vector("origin_of_two", "8.5", "the omitted number of an origin is 0",
           replaced(Stream(6, 1, -4, [[1, 2, 3]] * 3, origin=(-1.0, -2.0))), floats=True)
    vector("negative_zero_origin", "8.5", "an origin of -0", replaced(Stream(8, 1, -4, [[0, 1, 2]], origin=(-0.0,))))


def lives():
    vector("truncated_to_2_to_100", "8.5", "the maximum float of mapping 2",
           replaced(Stream(3, 2, 23, [[0, 0, 100]], origin=(1.0,))))
    vector("truncated_from_2_to_minus_100", "8.5", "the minimum origin, and e = 0",
           replaced(Stream(4, 2, 0, [[0, 1, (1 << 24) - 1]], origin=(2.0 ** -100, 2.0 ** -100))), floats=True)
    vector("truncated_multiplied", "8.5", "mapping 2 with m = 3 and another origin[1]",
           replaced(Stream(3, 2, 19, [[1, 2, 9]], origin=(0.5, 0.375), m=3)), floats=True)
    spans = float_streams(8, 0, 1)
    spans[2].v = [[bits_of(v) for v in (2.0 ** -40, 2.0 ** -127, 2.0 ** 60, 1.0, 1.999, 2.0, 0.3, 3.0)]]
    spans[3].v = [[bits_of(v) for v in (0.0, 2.0 ** -130, -0.0, 1.0, 4.0, 4.1, 0.6, 0.0)]]
    for name, e in (("least_displacements", -100), ("displacements", -7), ("greatest_displacements", 100)):
        streams = [Stream(5, 3, e, [[1, 2, NEGATIVE - 3, 4, 5, 6, 7, 8]] * 3, m=3) if s.attribute == 5 else s
                   for s in spans]
        vector(name, "8.6", f"e = {e} with short and long lifespans", plain(body=own_body(streams, 8)),
               floats=name == "displacements")
    signs = float_streams(3, 0, 1)
    signs[2] = Stream(3, 0, 20, [[0x3E8, 0x3F8, 0x408]], origin=(1.0, 64.0))
    signs[3] = Stream(4, 0, 0, [[0x80000000, 0, 0x80000000]], origin=(1.0, 64.0))
    signs[4] = Stream(5, 3, -3, [[1, 2, 3]] * 3)
    vector("displacement_of_floats", "8.6", "sigma with mapping 0 and e = 20, a radius of -0, origins that mapping 0 ignores",
           plain(body=own_body(signs, 3), meta=Meta()))
    for end in (30.0, 32.0, 0.75, 31.9375, 2.0 ** -20):
        streams = [Stream(5, 3, -3, [[1, 2, 3]] * 3) if s.attribute == 5 else s for s in float_streams(3, 0, 1)]
        streams[2].v = [[bits_of(v) for v in (64.0, 8.0, 1.0)]]
        vector(f"displacement_in_{end:g}".replace(".", "_").replace("-", "m"), "8.6", f"a part of {end:g} ticks limits E",
               File([Run([Segment(-1, 0, [own_body(streams, 3)])], 0, end)]))
    streams = [Stream(5, 3, 0, [[1, 2, 3]] * 3) if s.attribute == 5 else s for s in float_streams(3, 0, 1)]
    streams[2].v = [[bits_of(v) for v in (2.0 ** 33, 2.0 ** 31, 2.0 ** 30)]]
    vector("displacement_in_2_to_32", "8.6", "E is at most 32",
           File([Run([Segment(-1, 0, [own_body(streams, 3)])], -2.0 ** 31, 2.0 ** 31)]))


def rotations():
    vector("shaped_rotation", "8.8", "mapping 6", coded(40, shaped=True), floats=True)
    turned = Stream(7, 4, -9, [zigzags([100, -99, 0]), zigzags([1, 2, 3]), zigzags([3, -2, 1])], 1, m=5)
    vector("multiplied_rotation", "8.5", "mapping 4 with m = 5", replaced(turned), floats=True)
    full = Stream(7, 4, -14, [[(1 << 14) - 1, 0, NEGATIVE - 11585], [181, 0, 11585], [1, 0, 0]])
    vector("finest_rotation", "8.7", "e = -14, R from 1 to 2^28", replaced(full), floats=True)
    coarse = Stream(7, 4, -1, [[1, 0, NEGATIVE - 1], [1, 0, 1], [1, 0, 0]])
    vector("coarsest_rotation", "8.7", "e = -1", replaced(coarse))
    # Spans of exactly each T, and one step less: 8 m' Q 2^e' against T.
    for name, e, m, spans in (("shapes", -3, 1, (0, 1, 3, 4, 9, 10, 18, 19, 29, 30, 39, 40, 41)),
                              ("shapes_of_7", -6, 7, (0, 1, 2, 4, 5, 11, 12, 21, 22, 34, 35, 45, 46)),
                              ("shapes_of_large_steps", 5, 1, (0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2))):
        n = len(spans)
        scale = Stream(6, 1, e, [[5 + s for s in spans], [NEGATIVE - 3] * n, [5 + s // 2 for s in spans]],
                       origin=(-2.0,) * 3, m=m)
        scale.v[1] = [5] * n
        if name == "shapes":
            scale.v[0], scale.v[1] = [NEGATIVE - 7] * n, [(s - 7) % NEGATIVE for s in spans]
            scale.v[2] = [(s // 3 - 7) % NEGATIVE for s in spans]
        for exponent in (-9,) if name != "shapes" else (-9, -14, -1):
            turn = Stream(7, 6, exponent, [[0] * n, [1] + [0] * (n - 1), [0] * (n - 1) + [1]])
            vector(name + (f"_e{-exponent}" if exponent != -9 else ""), "8.8",
                   f"log-scales in steps of {m} * 2^{e}, rotations from 2^{exponent} on",
                   replaced(turn, scale, n=n), floats=exponent == -9)
    plain_origin = Stream(6, 1, -3, [[1, 2, 3]] * 3)
    vector("shaped_without_origin", "8.8", "mapping 6 with log-scales without an origin",
           replaced(Stream(7, 6, -9, [[1, 2, 3]] * 3), plain_origin))


def colours():
    limit = (1 << 22) - 1
    colour = Stream(9, 5, -24, [[limit, NEGATIVE - limit, 1], [limit, limit, 2], [NEGATIVE - limit, limit, 3]])
    vector("colour_of_24_bits", "8.5", "the maximum channels", replaced(colour), floats=True)


def times():
    vector("time_in_a_slot", "8.9", "mapping 7 counts from the beginning of its segment",
           coded(6, level=0, slot=2), floats=True)
    vector("time_in_a_level", "8.9", "level 2, slot 1", coded(6, level=2, slot=1), floats=True)
    rounded = [Stream(2, 7, -2, [[0, 5, 9]], 0, origin=(0.5,), m=3) if s.attribute == 2 else s
               for s in float_streams(3, 0, 1)]
    for name, chunk, slot in (("rounded", 5.0, 3), ("rounded_half", 4.5 + 2.0 ** -20, 5)):
        vector(f"time_{name}", "8.9", f"F of slot {slot} of chunk {chunk} in steps of 3/4, rounded down",
               File([Run([Segment(0, slot, [own_body(rounded, 3)])], chunk=chunk)]), floats=True)
    far = [Stream(2, 7, -20, [[0, NEGATIVE - 5, 9]], 0) if s.attribute == 2 else s for s in float_streams(3, 0, 1)]
    vector("time_of_33_bits", "8.9", "F above 2^32 in a part of 2^32 ticks",
           File([Run([Segment(20, 1023, [own_body(far, 3)])], -2.0 ** 31, 2.0 ** 31)]), floats=True)


def values_of_floats():
    kept = Stream(8, 0, 12, [[v << 4 for v in (0x3F8, 0xC01, 0x000)]], 0, bits=(8, 8, 8))
    vector("floats_of_20_bits", "8.5", "mapping 0 with e = 12", replaced(kept, meta=Meta()), floats=True)
    kept = Stream(8, 0, 20, [[0x3F8, 0xC01, 0x000]], 0, RANS, bits=(8, 4))
    vector("floats_of_12_bits", "8.5", "mapping 0 with e = 20", replaced(kept, meta=Meta()))
    kept = Stream(8, 0, 4, [[0xFC000001, 0x1, 0x80000000]])
    vector("floats_shifted_out", "8.5", "mapping 0: bits from 32 on are omitted", replaced(kept, meta=Meta()))
    signs = float_streams(3, 0, 1)
    signs[7].v = [[0x80000000, 1, 0x00800000]]
    signs[3].v = [[0x80000000, 0, 1]]
    signs[6].v = [[0, 0, bits_of(1.0)], [0, 0x80000000, 0], [0, 0, 0], [bits_of(1e-38), 1, 0]]
    vector("floats_at_limits", "8.5", "-0, subnormal numbers, a radius of -0, short quaternions",
           plain(body=own_body(signs, 3)))
    constant = coded_streams(3, 0, 3)
    constant[4] = Stream(5, 3, -20, [deltas([1, 2, 3])] * 3, 2, RANS)
    vector("constant_differences", "8.3", "prediction 2 of velocities", plain(body=own_body(constant, 3)))
