#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A viewer joins a recording, follows it, shows every fragment, and ends when the recording does.

usage: test_telepresence.py RECORDER VIEWER
"""
import os
import shutil
import sys
import unittest

from telepresence import run, run_replaced

RECORDER, VIEWER = map(os.path.abspath, sys.argv[1:3])
SECONDS = 4


class Telepresence(unittest.TestCase):
    def test_a_viewer_shows_every_fragment_after_joining(self):
        out = run(RECORDER, VIEWER, SECONDS, join_after=1.5)
        times = [time for time, _ in out["shown"]]
        self.assertGreater(times[0], 0.5, out["events"])
        self.assertEqual(times, sorted(times))
        for fragment in out["fragments"]:
            if fragment["begin"] >= times[0]:
                self.assertTrue(any(fragment["begin"] <= t < fragment["end"] for t in times),
                                fragment)
        # Playback is live: fragments recorded after joining are shown before the recording ends.
        shown_by = {at for time, at in out["shown"] if time >= out["fragments"][4]["begin"]}
        self.assertLess(min(shown_by), out["fragments"][-1]["captured"])
        self.assertGreaterEqual(times[-1], out["fragments"][-1]["end"] - 0.1)
        events = out["events"]
        self.assertEqual((events.get("finished"), events.get("ended")), (1, 1), events)
        for failure in "read_failed", "damaged", "replaced", "stalled":
            self.assertNotIn(failure, events)

    def test_a_viewer_follows_the_replacement_of_its_recording(self):
        out = run_replaced(RECORDER, VIEWER, SECONDS)
        events = out["events"]
        self.assertEqual((events.get("replaced"), events.get("finished"), events.get("ended")),
                         (1, 1, 1), events)
        self.assertGreater(out["shown"][-1][0], SECONDS - 0.2)


if __name__ == "__main__":
    if not shutil.which("nginx"):
        print("skipped: needs nginx")
        sys.exit(77)
    unittest.main(argv=[sys.argv[0]], verbosity=2)
