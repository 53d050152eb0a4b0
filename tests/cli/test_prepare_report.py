# SPDX-License-Identifier: Apache-2.0
"""The report that prepare writes: its verdict and its map of the cameras."""
import pathlib
import re
import unittest

import harness
from harness import CliTest


@unittest.skipUnless(harness.built_in("prepare"), "prepare is not built in")
class PrepareReport(CliTest):
    def report(self, *options):
        done = self.succeeds("prepare", harness.sample(), "-o", "out", "--frames", "0:2", "--scale", "0.2", *options)
        return pathlib.Path(self.path("out"), "report/index.html").read_text(encoding="utf-8"), done.stderr.decode()

    def test_a_sound_capture(self):
        page, log = self.report()
        self.assertIn("No problems found: ready to train.", page)
        self.assertNotIn("Findings", page)
        self.assertNotIn("warning", log)
        self.assertIn("Cameras from above", page)
        names = re.findall(r'text-anchor="middle">(cam\d+)</text>', page)
        self.assertEqual(len(names), 10)
        links = re.findall(r'<a href="([^"]*)"><img src="([^"]*)"', page)
        self.assertGreater(len(links), 0)
        for link, image in links:
            self.assertEqual(link, image)
            self.assertTrue(pathlib.Path(self.path("out"), "report", image).exists())
        self.assertEqual(page.count('fill="white"'), 1)  # the held-out camera

    def test_two_cameras(self):
        """Two cameras are too few for a check of the calibration, so the report does not mention one."""
        names = [f"cam{i:02}" for i in range(16) if pathlib.Path(harness.sample(), f"cam{i:02}.mp4").exists()]
        page, log = self.report("--test-cameras", ",".join(names[2:]))
        self.assertIn("Cameras from above", page)
        self.assertEqual(page.count('fill="white"'), len(names) - 2)
        self.assertNotIn("could not be checked", page + log)
