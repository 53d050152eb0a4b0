#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A viewer joins a recording in the middle, follows it, sees every stretch, and ends with it.

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
    def test_a_viewer_joins_in_the_middle_and_sees_all_from_there(self):
        out = run(RECORDER, VIEWER, SECONDS, join_after=1.5)
        moments = [moment for moment, _ in out["shown"]]
        self.assertGreater(moments[0], 0.5, out["events"])
        self.assertEqual(moments, sorted(moments))
        for stretch in out["stretches"]:
            if stretch["begin"] >= moments[0]:
                self.assertTrue(any(stretch["begin"] <= m < stretch["end"] for m in moments), stretch)
        # Live: what is recorded after joining has been shown before the end of the recording.
        shown_by = {at for moment, at in out["shown"] if moment >= out["stretches"][4]["begin"]}
        self.assertLess(min(shown_by), out["stretches"][-1]["captured"])
        self.assertGreaterEqual(moments[-1], out["stretches"][-1]["end"] - 0.1)
        events = out["events"]
        self.assertEqual((events.get("finished"), events.get("ended")), (1, 1), events)
        for trouble in "lost", "damaged", "replaced", "stalled":
            self.assertNotIn(trouble, events)

    def test_a_viewer_goes_on_with_the_recording_that_takes_the_place_of_its_own(self):
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
