# SPDX-License-Identifier: Apache-2.0
"""`stgs prepare`: captures and arguments that it rejects, and interruptions."""
import json
import os
import re
import shutil
import signal
import subprocess
import time
import unittest

import harness
from harness import CliTest

USAGE, IO, INVALID, RUNTIME, UNSUPPORTED, NOT_BUILT = 1, 2, 3, 4, 5, 6


class Preparing(CliTest):
    def setUp(self):
        super().setUp()
        if not harness.built_in("prepare"):
            self.fails(NOT_BUILT, "cannot prepare captures .no OpenCV or FFmpeg.", "prepare", self.work,
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
        result = self.fails(INVALID, "cam03.mp4: video of camera 'cam03': not an MP4, MOV", *args)
        self.assertEqual(self.foreign_lines(result), [])
        self.assertFalse(os.path.exists(self.path("out")))
        # The index is complete, but the frames are not.
        self.write("capture/cam03.mp4", self.read("capture/cam04.mp4")[:30000])
        video = "capture/cam03.mp4: video of camera 'cam03'"
        result = self.fails(INVALID, f"{video}: cannot decode frame 0 ", *args)
        self.assertEqual(self.foreign_lines(result), [])
        # The last frames are missing, and one is cut.
        complete = self.read("capture/cam04.mp4")
        self.write("capture/cam03.mp4", complete[:len(complete) * 4 // 5])
        cut = self.fails(INVALID, f"{video}: cannot decode frame [1-9][0-9]* .cut short", *args)
        # All frames before it are usable.
        frame = re.search(rb"decode frame ([0-9]+)", cut.stderr)[1].decode()
        self.succeeds(*args, "--frames", f"0:{frame}", "--scale", "0.2", "--no-split")

    @unittest.skipIf(os.path.exists("/dev/nvidiactl"), "there is an NVIDIA GPU")
    def test_a_missing_backend_is_reported_before_work_starts(self):
        text = self.succeeds("--version").stdout.decode()
        code = UNSUPPORTED if "trains with: cpu cuda" in text else NOT_BUILT
        self.fails(code, "use --backend cpu", "prepare", harness.sample(), "-o", "out", "--backend",
                   "cuda")
        self.assertFalse(os.path.exists(self.path("out")))

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
        args = [harness.STGS, "prepare", harness.sample(), "-o", "out", "--progress", "json"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            process.stderr.readline()
            process.kill()
        left = [name for name in os.listdir(self.work) if name.endswith(".tmp.work")]
        self.assertEqual(len(left), 1)
        os.makedirs(self.path("out.partial-notes"))
        self.fails(USAGE, "frames", "prepare", harness.sample(), "-o", "out", "--frames", "0:999")
        self.assertEqual(os.listdir(self.work), ["out.partial-notes"])

    def test_two_prepares_of_one_folder_in_two_containers(self):
        """Both processes have the id 1 in their container. The second reports that the folder is in
        use, and leaves the work of the first."""
        inside = ["unshare", "--user", "--map-root-user", "--pid", "--fork", "--kill-child"]
        if subprocess.run([*inside, "true"], check=False, capture_output=True).returncode != 0:
            self.skipTest("namespaces are not allowed here")
        args = [*inside, harness.STGS, "prepare", harness.sample(), "-o", "out", "--scale", "0.125",
                "--frames", "0:2"]
        with subprocess.Popen([*args, "--progress", "json"], cwd=self.work,
                              stderr=subprocess.PIPE) as first:
            first.stderr.readline()
            second = subprocess.run(args, cwd=self.work, capture_output=True, check=False)
            self.assertIsNone(first.poll())  # it still works while the second is refused
            error = first.stderr.read().decode()
        self.assertEqual(second.returncode, USAGE, second.stderr)
        self.assertIn(b"out: another process is writing it", second.stderr)
        self.assertEqual(first.returncode, 0, error)
        self.assertTrue(os.path.exists(self.path("out", "capture.json")))
        self.assertEqual(os.listdir(self.work), ["out"])

    def test_pipes_are_rejected_as_videos(self):
        os.mkdir(self.path("capture"))
        os.mkfifo(self.path("capture/cam0.mp4"))
        frames = [{"file_path": f"cam{k}.mp4", "transform_matrix": [
            [1, 0, 0, k], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]} for k in range(2)]
        shutil.copy(os.path.join(harness.sample(), "cam03.mp4"), self.path("capture/cam1.mp4"))
        self.write("capture/transforms.json", json.dumps({
            "fl_x": 500, "fl_y": 500, "cx": 320, "cy": 240, "w": 640, "h": 480, "frames": frames}))
        self.fails(IO, "cam0.mp4: video of camera 'cam0': not a regular file", "prepare", "capture",
                   "-o", "out")

    def test_a_module_that_every_user_can_replace_is_not_loaded(self):
        os.mkdir(self.path("bin"))
        program = shutil.copy(harness.STGS, self.path("bin"))
        shutil.copy(os.path.join(os.path.dirname(harness.STGS), "stgs_opencv.so"), self.path("bin"))
        args = [program, "prepare", harness.sample(), "-o", "out", "--frames", "0:999"]
        for mode, code, message in ((0o755, USAGE, b"frames"), (0o777, UNSUPPORTED, b"not loaded")):
            os.chmod(self.path("bin"), mode)
            result = subprocess.run(args, cwd=self.work, capture_output=True, check=False)
            self.assertEqual(result.returncode, code, result.stderr)
            self.assertIn(message, result.stderr)

    def test_an_interrupted_prepare_leaves_nothing(self):
        args = [harness.STGS, "prepare", harness.sample(), "-o", "out", "--progress", "json"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            error = self.interrupt(process, signal.SIGTERM)
        self.assertEqual(process.returncode, RUNTIME, error)
        self.assertIn("stgs: error: interrupted", error)
        self.assertEqual(os.listdir(self.work), [])


if __name__ == "__main__":
    unittest.main()
