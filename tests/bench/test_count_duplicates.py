#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests count_duplicates.py with a scene whose primitives are known."""
import types
import unittest

import numpy as np

from count_duplicates import repeats, track

# Begin and end, seconds; position, largest axis and red of primitives.
PRIMITIVES = [
    (0, 30, (0, 0, 0), 0.10, 0.5),
    (0, 30, (0, 0, 0.001), 0.10, 0.5),  # appears at the same time
    (12, 30, (1, 0, 0), 0.10, 0.5),     # elsewhere
    (12, 30, (0, 0.005, 0), 0.11, 0.5),  # repeats the first two
    (12, 30, (0, 0, 0), 0.20, 0.5),     # of another size
    (12, 30, (0, 0, 0), 0.10, 0.9),     # of another colour
]


class KnownScene:
    def primitives(self, seconds):
        shown = [(i, p) for i, p in enumerate(PRIMITIVES) if p[0] <= seconds < p[1]]
        red = np.array([p[4] for _, p in shown]) / 0.28209
        return types.SimpleNamespace(
            id=np.array([i for i, _ in shown]), position=np.array([p[2] for _, p in shown], dtype=np.float32),
            scale=np.array([(p[3], p[3] / 2, p[3] / 2) for _, p in shown], dtype=np.float32),
            sh=np.stack([red, 0 * red, 0 * red], axis=1)[:, None])


class CountDuplicates(unittest.TestCase):
    def test_primitives_are_followed_over_time(self):
        seen = track(KnownScene(), 40)
        self.assertEqual(len(seen), len(PRIMITIVES))
        for i, (begin, end, *_) in enumerate(PRIMITIVES):
            self.assertAlmostEqual(seen[i][0], begin, delta=0.5)
            self.assertAlmostEqual(seen[i][1], end, delta=0.5)

    def test_a_later_primitive_at_the_same_place_of_the_same_size_and_colour_repeats(self):
        self.assertEqual(repeats(list(track(KnownScene(), 40).values())), 1)


if __name__ == "__main__":
    unittest.main()
