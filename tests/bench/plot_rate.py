#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Draws PSNR over file size before and after the compaction, from results.csv, as an SVG file.

usage: plot_rate.py OUTPUT.svg

Points are the rows of benchmark `rate` on the test cameras of a capture: every number of primitives
and quality before (case ends with `_before`), every limit of the file after (`_sizeN`).
"""
import collections
import math
import sys

import bench_data

WIDTH, HEIGHT, MARGIN = 420, 320, 52
CAPTURES = (("basketball", "CMU Panoptic basketball"), ("workshop", "workshop"))
PANELS = (("psnr_db", "PSNR"), ("psnr_cc_db", "PSNR after colour map"),
          ("psnr_moving_db", "PSNR of moving pixels"))
SERIES = (("before", "#8a8a8a", "primitives x quality, before"), ("size", "#0b6fa4", "--target-size"))


def points(capture):
    """File size and metrics of each file of a capture as it was last measured, by series."""
    prefix = f"{capture}_best_test_"
    files = collections.defaultdict(dict)
    for row in bench_data.read_results():
        if row.benchmark == "rate" and row.case.startswith(prefix):
            files[row.case][row.metric] = float(row.value)
    series = {"before": [], "size": []}
    for case, metrics in files.items():
        name = case[len(prefix):]
        if name.startswith("n") and name.endswith("_before"):
            series["before"].append(metrics)
        elif name.startswith("size"):
            series["size"].append(metrics)
    return series


def frontier(found, metric):
    """The points that no smaller file exceeds, by size."""
    best, line = -math.inf, []
    for size, value in sorted((m["file_bytes"], m[metric]) for m in found):
        if value > best:
            best = value
            line.append((size, value))
    return line


def panel(series, metric, title, left, above):
    sizes = [m["file_bytes"] for found in series.values() for m in found]
    values = [m[metric] for found in series.values() for m in found]
    low, high = math.log2(min(sizes)) - 0.2, math.log2(max(sizes)) + 0.2
    bottom, top = math.floor(min(values)), math.ceil(max(values))

    def x(size):
        return left + MARGIN + (math.log2(size) - low) / (high - low) * (WIDTH - MARGIN - 12)

    def y(value):
        return above + 28 + (top - value) / (top - bottom) * (HEIGHT - 28 - MARGIN)

    out = [f'<text x="{left + WIDTH / 2:.0f}" y="{above + 16}" text-anchor="middle">{title}, dB</text>']
    for value in range(bottom, top + 1):
        out.append(f'<path d="M{x(2 ** low):.1f} {y(value):.1f}H{x(2 ** high):.1f}" stroke="#ddd"/>'
                   f'<text x="{x(2 ** low) - 6:.1f}" y="{y(value) + 4:.1f}" '
                   f'text-anchor="end">{value}</text>')
    for size in (62500, 125000, 250000, 500000, 1000000, 2000000):
        if low <= math.log2(size) <= high:
            text = f"{size / 1e6:g} MB" if size >= 1e6 else f"{size / 1e3:g} kB"
            out.append(f'<path d="M{x(size):.1f} {y(bottom):.1f}V{y(top):.1f}" stroke="#ddd"/>'
                       f'<text x="{x(size):.1f}" y="{y(bottom) + 18:.1f}" '
                       f'text-anchor="middle">{text}</text>')
    for k, (name, colour, label) in enumerate(SERIES):
        line = frontier(series[name], metric)
        path = "L".join(f"{x(size):.1f} {y(value):.1f}" for size, value in line)
        out.append(f'<path d="M{path}" fill="none" stroke="{colour}" stroke-width="2"/>')
        out += [f'<circle cx="{x(m["file_bytes"]):.1f}" cy="{y(m[metric]):.1f}" r="2.5" '
                f'fill="{colour}"/>' for m in series[name]]
        at = above + HEIGHT - 12
        out.append(f'<circle cx="{left + MARGIN + 190 * k}" cy="{at - 4}" r="4" fill="{colour}"/>'
                   f'<text x="{left + MARGIN + 190 * k + 8}" y="{at}">{label}</text>')
    return "\n".join(out)


def main():
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    parts = []
    for row, (capture, name) in enumerate(CAPTURES):
        series = points(capture)
        parts += [panel(series, metric, f"{name}: {title}", k * WIDTH, row * HEIGHT)
                  for k, (metric, title) in enumerate(PANELS)]
    with open(sys.argv[1], "w", encoding="utf-8") as file:
        file.write(f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH * len(PANELS)}" '
                   f'height="{HEIGHT * len(CAPTURES)}" font-family="sans-serif" font-size="11">\n'
                   '<rect width="100%" height="100%" fill="white"/>\n' + "\n".join(parts) +
                   "\n</svg>\n")


if __name__ == "__main__":
    main()
