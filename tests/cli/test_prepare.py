# SPDX-License-Identifier: Apache-2.0
"""`stgs prepare`: captures and arguments that it rejects, and interruptions."""
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

    def test_prepare_rejects_bad_arguments(self):
        os.mkdir(self.path("empty"))
        os.mkdir(self.path("text"))
        self.write("text/notes.txt", "no video")
        self.write("file", b"")
        cases = [
            (USAGE, "'film' is not one of auto", ["empty", "--layout", "film"]),
            (USAGE, "--scale: 0 is out of range", ["empty", "--scale", "0"]),
            (USAGE, "--scale: 2 is out of range", ["empty", "--scale", "2"]),
            (USAGE, "--frames: '5' is not a frame range", ["empty", "--frames", "5"]),
            (USAGE, "--frames: 5:2 is empty", ["empty", "--frames", "5:2"]),
            (INVALID, "empty: unknown capture layout", ["empty"]),
            (INVALID, "text: unknown capture layout", ["text"]),
            (IO, "missing: no such file or folder; name the folder with", ["missing"]),
            (INVALID, "file: is not a folder", ["file"]),
        ]
        for code, message, args in cases:
            with self.subTest(args=args):
                self.fails(code, message, "prepare", *args, "-o", "out")
                self.assertFalse(os.path.exists(self.path("out")))
                self.assert_no_leftovers()
        for output in ("/proc/out", "file/out"):
            self.fails(IO, f"^stgs: error: {output}: cannot create: ", "prepare",
                       harness.sample(), "-o", output)

    def test_undecodable_videos_are_rejected(self):
        shutil.copytree(harness.sample(), self.path("capture"))
        self.write("capture/cam03.mp4", b"no video at all" * 100)
        args = ["prepare", "capture", "-o", "out"]
        result = self.fails(INVALID, "cam03.mp4: cannot open the video of camera 'cam03'", *args)
        self.assertEqual(self.foreign_lines(result), [])
        self.assertFalse(os.path.exists(self.path("out")))
        # The index is complete, but the frames are not.
        self.write("capture/cam03.mp4", self.read("capture/cam04.mp4")[:30000])
        result = self.fails(INVALID, "cam03.mp4: cannot decode frame 0 of camera 'cam03'", *args)
        self.assertEqual(self.foreign_lines(result), [])

    def foreign_lines(self, result):
        """Returns the lines that libraries wrote to standard error directly."""
        lines = result.stderr.decode().splitlines()
        return [line for line in lines if not line.startswith("stgs: ")]

    def test_killing_prepare_ends_colmap(self):
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
        self.wait_until(lambda: not self.is_running(child))

    def is_running(self, pid):
        """Returns whether a process runs; a zombie does not."""
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
        self.fail("the condition was not met within a minute")

    def test_an_unrelated_folder_is_not_overwritten(self):
        os.mkdir(self.path("out"))
        self.write("out/notes.txt", "mine")
        self.fails(USAGE, "out: exists and is not a prepared capture", "prepare",
                   harness.sample(), "-o", "out", "--frames", "0:2")
        self.assertEqual(os.listdir(self.path("out")), ["notes.txt"])

    def interrupt(self, process, signal_number):
        """Sends the signal after the first progress line, and returns the rest of standard error."""
        process.stderr.readline()
        for _ in range(2):  # a terminal and timeout(1) signal the process and its group
            process.send_signal(signal_number)
        error = process.stderr.read().decode()
        process.wait()
        return error

    def test_the_folder_of_a_killed_prepare_is_removed(self):
        stale = "out.partial-999999999"  # no process has this id
        os.makedirs(self.path(stale, "frames"))
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
