# SPDX-License-Identifier: Apache-2.0
"""Preparing captures: what prepare refuses, and what an interruption leaves."""
import os
import shutil
import signal
import subprocess
import time
import unittest

import harness
from harness import CliTest

USAGE, IO, INVALID, RUNTIME, NOT_BUILT = 1, 2, 3, 4, 6


class Preparing(CliTest):
    def setUp(self):
        super().setUp()
        if not harness.built_in("prepare"):
            self.fails(NOT_BUILT, "cannot prepare captures: install OpenCV", "prepare", self.work,
                       "-o", "out")
            self.skipTest("prepare is not built in")

    def test_what_prepare_refuses(self):
        os.mkdir(self.path("empty"))
        os.mkdir(self.path("text"))
        self.write("text/notes.txt", "no video")
        self.write("file", b"")
        cases = [
            (USAGE, "'film' is not one of auto", ["empty", "--layout", "film"]),
            (USAGE, "--scale: 0 is out of range", ["empty", "--scale", "0"]),
            (USAGE, "--scale: 2 is out of range", ["empty", "--scale", "2"]),
            (USAGE, "'5' is not a frame range", ["empty", "--frames", "5"]),
            (USAGE, "frame range 5:2 is empty", ["empty", "--frames", "5:2"]),
            (USAGE, "empty: unknown capture layout", ["empty"]),
            (USAGE, "text: unknown capture layout", ["text"]),
            (IO, "missing: no such file or folder; name the folder with", ["missing"]),
            (IO, "file: is not a folder", ["file"]),
        ]
        for code, message, args in cases:
            with self.subTest(args=args):
                self.fails(code, message, "prepare", *args, "-o", "out")
                self.assertFalse(os.path.exists(self.path("out")))
                self.no_leftovers()
        for output in ("/proc/out", "file/out"):
            self.fails(IO, f"^stgs: error: {output}: cannot create: ", "prepare",
                       harness.sample(), "-o", output)

    def test_a_video_that_is_none(self):
        shutil.copytree(harness.sample(), self.path("capture"))
        self.write("capture/cam03.mp4", b"no video at all" * 100)
        args = ["prepare", "capture", "-o", "out"]
        result = self.fails(INVALID, "cam03.mp4: cannot open the video of camera 'cam03'", *args)
        self.assertEqual(self.foreign_lines(result), [])
        self.assertFalse(os.path.exists(self.path("out")))
        # Its index is whole, its pictures are not.
        self.write("capture/cam03.mp4", self.read("capture/cam04.mp4")[:30000])
        result = self.fails(INVALID, "cam03.mp4: cannot decode frame 0 of camera 'cam03'", *args)
        self.assertEqual(self.foreign_lines(result), [])

    def foreign_lines(self, result):
        """What libraries wrote to standard error past us."""
        lines = result.stderr.decode().splitlines()
        return [line for line in lines if not line.startswith("stgs: ")]

    def test_a_killed_prepare_takes_colmap_with_it(self):
        os.mkdir(self.path("bin"))
        self.write("bin/colmap", "#!/bin/sh\necho $$ > \"$PID_FILE\"\nexec sleep 300\n")
        os.chmod(self.path("bin/colmap"), 0o755)
        shutil.copytree(harness.sample(), self.path("capture"))
        os.remove(self.path("capture/poses_bounds.npy"))  # so that COLMAP calibrates
        environment = dict(os.environ, PATH=self.path("bin") + ":" + os.environ["PATH"],
                           PID_FILE=self.path("pid"))
        args = [harness.STGS, "prepare", "capture", "-o", "out", "--scale", "0.25"]
        with subprocess.Popen(args, cwd=self.work, env=environment,
                              stderr=subprocess.DEVNULL) as process:
            self.wait_until(lambda: os.path.exists(self.path("pid")) and self.read("pid"))
            child = int(self.read("pid"))
            process.kill()
        self.wait_until(lambda: not self.lives(child))

    def lives(self, pid):
        """Whether a process runs; one that has ended and waits for its parent does not."""
        try:
            with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
                return file.read().rsplit(")", 1)[1].split()[0] != "Z"
        except FileNotFoundError:
            return False

    def wait_until(self, condition):
        for _ in range(1200):
            if condition():
                return
            time.sleep(0.05)
        self.fail("did not come about within a minute")

    def test_an_existing_folder_is_not_overwritten_unasked(self):
        os.mkdir(self.path("out"))
        self.write("out/notes.txt", "mine")
        self.fails(USAGE, "out: exists and is not a prepared capture", "prepare",
                   harness.sample(), "-o", "out", "--frames", "0:2")
        self.assertEqual(os.listdir(self.path("out")), ["notes.txt"])

    def interrupt(self, process, signal_number):
        """Sends the signal once the work has begun, and returns what it printed."""
        process.stderr.readline()
        for _ in range(2):  # as a terminal and timeout(1) do: to the process and to its group
            process.send_signal(signal_number)
        error = process.stderr.read().decode()
        process.wait()
        return error

    def test_what_a_killed_prepare_left_is_removed(self):
        left = "out.partial-999999999"  # no process has such an id
        os.makedirs(self.path(left, "frames"))
        os.makedirs(self.path("out.partial-notes"))
        self.fails(USAGE, "frames", "prepare", harness.sample(), "-o", "out", "--frames", "0:999")
        self.assertEqual(os.listdir(self.work), ["out.partial-notes"])

    def test_an_interrupted_prepare_leaves_nothing(self):
        args = [harness.STGS, "prepare", harness.sample(), "-o", "out", "--progress", "json"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            error = self.interrupt(process, signal.SIGTERM)
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn("stgs: error: interrupted", error)
        self.assertEqual(os.listdir(self.work), [])


if __name__ == "__main__":
    unittest.main()
