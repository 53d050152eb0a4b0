#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests long_capture.py, and with it `stgs encode --window` that is killed at random times.

usage: test_long_capture.py BUILD
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
FRAMES, WINDOW, KILLS = 40, 8, 3


class LongCapture(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="test_long_capture-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def start_tool(self, work, kills, options=()):
        return subprocess.run(
            [sys.executable, HERE / "long_capture.py", "--build", sys.argv[1], "--frames", str(FRAMES),
             "--window", str(WINDOW), "--kills", str(kills), "--cameras", "3", "--size", "64x36",
             "--work", self.folder / work, "--windows", self.folder / f"{work}.csv", *options, "--", "--preset", "fast",
             "--iterations", "20", "--max-primitives", "800", "--max-static-points", "1500",
             "--backend", "cpu", "--seed", "3"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False,
            timeout=600)

    def run_tool(self, work, kills):
        run = self.start_tool(work, kills)
        self.assertEqual(run.returncode, 0, run.stderr)
        return json.loads(run.stdout)

    def test_a_run_that_is_killed_writes_the_same_file(self):
        once, killed = self.run_tool("once", 0), self.run_tool("killed", KILLS)
        self.assertEqual((once["kills"], killed["kills"]), (0, KILLS))
        self.assertEqual((self.folder / "once" / "long.stgs").read_bytes(),
                         (self.folder / "killed" / "long.stgs").read_bytes())
        for figures in (once, killed):
            self.assertTrue(figures["valid"])
            self.assertEqual(figures["frames"], FRAMES)
            self.assertGreater(min(db for _, db in figures["psnr_db"]), 15)
        self.assertEqual(once["windows"], FRAMES // WINDOW)
        # Videos and the recording stay open; nothing is added by a window.
        self.assertLessEqual(once["open_files"]["end"], once["open_files"]["start"])
        rows = (self.folder / "once.csv").read_text(encoding="ascii").splitlines()
        self.assertEqual(len(rows), 1 + FRAMES // WINDOW)
        self.assertEqual(sorted(os.listdir(self.folder / "killed")), ["capture", "capture.txt", "images", "long.stgs"])
        other = self.start_tool("killed", 0, ["--fps", "20"])
        self.assertEqual(other.returncode, 1)
        self.assertIn("was made with other options", other.stderr)

    def test_the_capture_plays_live(self):
        programs, capture = pathlib.Path(sys.argv[1], "bin"), self.folder / "capture"
        subprocess.run([programs / "make_room_capture", capture, "--frames", "20", "--cameras", "3", "--size", "64x36"],
                       check=True)
        run = subprocess.run([programs / "stgs", "live", capture, "-o", self.folder / "live.stgs", "--latency", "0.1",
                              "--max-primitives", "800", "--backend", "cpu", "--format", "json"],
                             capture_output=True, text=True, check=False, timeout=100)
        self.assertEqual(run.returncode, 0, run.stderr)
        report = json.loads(run.stdout)
        self.assertEqual((report["cameras"], report["frames"]), (3, 20))  # without the test camera

    def test_a_failing_encoder_is_reported(self):
        run = subprocess.run([sys.executable, HERE / "long_capture.py", "--build", sys.argv[1], "--frames", "16",
                              "--size", "96x54", "--", "--preset", "unknown"], capture_output=True, text=True,
                             check=False, timeout=100)
        self.assertEqual(run.returncode, 1)
        self.assertIn("the encoder failed", run.stderr)
        self.assertIn("--preset", run.stderr)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
