#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Counts static primitives of a file that repeat others, and how their number grows.

usage: count_duplicates.py FILE [--module FOLDER]

A primitive is static if it is displayed for at least 10 seconds. It repeats an earlier one if both have nearly the same
position, size and colour, whether or not they are displayed at the same time. Prints JSON: for each minute the static
primitives that are displayed at its end, and of all static primitives those that repeat one that appeared at least one
second before. FOLDER has the Python module stgs.
"""
import argparse
import importlib
import json
import sys

import numpy as np

STATIC_SECONDS, SAMPLE_SECONDS, LATER_SECONDS = 10.0, 0.5, 1.0
MAX_DISTANCE = 0.1      # over the largest axis of the primitive
MAX_LOG_SIZE = 0.2      # difference of the logarithms of the largest axes
MAX_COLOUR = 0.05       # of a channel, in [0, 1]
SH_TO_COLOUR = 0.28209  # value of the constant spherical harmonic
BLOCK = 256


def track(scene, seconds):
    """Returns per primitive the first and the last sample at which it is displayed, and its position, size and colour."""
    seen = {}
    for sample in np.arange(0.5 * SAMPLE_SECONDS, seconds, SAMPLE_SECONDS):
        shown = scene.primitives(float(sample))
        ids, position = np.asarray(shown.id), np.asarray(shown.position)
        if len(ids) == 0:
            continue
        size = np.asarray(shown.scale).max(axis=1)
        colour = SH_TO_COLOUR * np.asarray(shown.sh).reshape(len(ids), -1, 3)[:, 0]
        for i, identity in enumerate(ids):
            if identity in seen:
                seen[identity][1] = sample
            else:
                seen[identity] = [sample, sample, position[i], size[i], colour[i]]
    return seen


def repeats(static):
    """Returns how many static primitives repeat one that appeared before."""
    begin = np.array([entry[0] for entry in static])
    position, colour = (np.array([entry[k] for entry in static], dtype=np.float32) for k in (2, 4))
    size = np.array([entry[3] for entry in static], dtype=np.float32)
    count = 0
    for block in range(0, len(static), BLOCK):
        of = slice(block, block + BLOCK)
        distance = np.linalg.norm(position[of, None] - position[None], axis=2)
        near = distance < MAX_DISTANCE * size[of, None]
        near &= np.abs(np.log(size[of, None] / size[None])) < MAX_LOG_SIZE
        near &= begin[None] <= begin[of, None] - LATER_SECONDS
        rows, columns = np.nonzero(near)
        same = np.abs(colour[block + rows] - colour[columns]).max(axis=1) < MAX_COLOUR
        count += len(np.unique(rows[same]))
    return count


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("file")
    parser.add_argument("--module", default=".", help="folder of the Python module stgs")
    options = parser.parse_args()
    sys.path.insert(0, options.module)
    stgs = importlib.import_module("stgs")
    with stgs.Scene(options.file, max_memory=8 << 30) as scene:
        seconds = scene.info.duration_seconds
        seen = track(scene, seconds)
    static = [entry for entry in seen.values() if entry[1] - entry[0] >= STATIC_SECONDS]
    ends = [min(minute, seconds) for minute in np.arange(60, seconds + 59.9, 60)]
    shown = [int(sum(entry[0] < end and entry[1] >= end - 2 * SAMPLE_SECONDS for entry in static)) for end in ends]
    print(json.dumps({"primitives": len(seen), "static": len(static), "static_by_minute": shown,
                      "repeated": repeats(static) if static else 0}))


if __name__ == "__main__":
    main()
