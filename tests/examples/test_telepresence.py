#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A viewer joins a recording, follows it, shows every fragment, and ends when the recording does.

usage: test_telepresence.py RECORDER VIEWER [CAMERAS]     CAMERAS: telepresence_cameras, if it works
"""
import os
import shutil
import sys
import unittest

from telepresence import run, run_replaced

RECORDER, VIEWER, *CAMERAS = map(os.path.abspath, sys.argv[1:])
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
        self.check_end(out)
        self.assertNotIn("stalled", out["events"])

    @unittest.skipUnless(CAMERAS, "needs a build that can prepare")
    def test_cameras_are_encoded_while_a_viewer_follows_them(self):
        out = run(*CAMERAS, VIEWER, SECONDS, join_after=0, options=())
        windows, times = out["fragments"], [time for time, _ in out["shown"]]
        self.assertGreaterEqual(len(windows), 2)
        self.assertEqual(windows[0]["begin"], 0)
        self.assertEqual(windows[-1]["end"], SECONDS)
        for before, after in zip(windows, windows[1:]):
            self.assertEqual(before["end"], after["begin"])
        # The viewer is live, also on a slow machine, where it waits or skips.
        self.assertLess(out["shown"][0][1], windows[-1]["appended"])
        self.assertEqual(times, sorted(times))
        self.check_end(out)

    def check_end(self, out):
        """The viewer has shown the last fragment and found the end, and no error has occurred."""
        self.assertGreater(out["shown"][-1][0], out["fragments"][-1]["begin"])
        events = out["events"]
        self.assertEqual((events.get("finished"), events.get("ended")), (1, 1), events)
        for failure in "failed", "read_failed", "damaged", "replaced":
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
