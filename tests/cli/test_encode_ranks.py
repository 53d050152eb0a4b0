# SPDX-License-Identifier: Apache-2.0
"""Windows of a long capture that several processes encode: `mpirun stgs encode --window`."""
import json
import os
import shutil
import signal
import subprocess
import unittest

import harness
from harness import built_in
from mpi import MPIRUN, MpiTest

USAGE, IO = 1, 2


@unittest.skipUnless(built_in("encode"), "encode is not built in")
class EncodeRanks(MpiTest):
    """The sample capture in windows of 8, 8 and 4 frames: the first is encoded alone, the others
    in one round."""

    def encode(self, output, *more):
        return ["encode", harness.sample(), "-o", output, "--scale", "0.1", "--window", "8", "--preset", "fast",
                "--iterations", "60", "--max-primitives", "3000", "--backend", "cpu", *more]

    def psnr(self, scene):
        return self.json_of("evaluate", scene, "--against", "prepared", "--backend", "cpu")["psnr"]

    def killed(self, output):
        """Kills the second process when the second window has begun; the first window is complete."""
        command = [*MPIRUN, "-np", "2", harness.STGS, *self.encode(output, "--log-level", "info")]
        with subprocess.Popen(command, cwd=self.work, env=self.environment, stderr=subprocess.PIPE,
                              text=True) as process:
            for line in process.stderr:
                if "window 2 of 3" in line:
                    break
            os.kill(max(self.ranks_of(process)), signal.SIGKILL)
            process.stderr.read()
            process.wait(60)
        self.assertNotEqual(process.returncode, 0)
        self.assertFalse(os.path.exists(self.path(output)))
        self.assertTrue(os.path.exists(self.path(output + ".work/persistent-0000008.set")))

    def test_a_capture_without_a_calibration_is_refused(self):
        shutil.copytree(harness.sample(), self.path("videos"))
        os.remove(self.path("videos/poses_bounds.npy"))
        command = self.encode("out.stgs")
        command[1] = "videos"
        self.both_fail(USAGE, "videos: has no calibration, .*copy rig.json", command)

    def test_two_processes_encode_as_well_as_one(self):
        self.succeeds("prepare", harness.sample(), "-o", "prepared", "--scale", "0.1", "--backend", "cpu")
        self.succeeds(*self.encode("one.stgs"))
        result = self.both_succeed(self.encode("two.stgs", "--format", "json"))
        report = json.loads(result.stdout)  # only the first process prints
        self.check_schema("encode", report)
        self.assertEqual([(row["first_frame"], row["frames"]) for row in report["windows"]], [(0, 8), (8, 8), (16, 4)])
        self.assertEqual([row["iterations"] for row in report["windows"]], [60, 30, 30])
        self.json_of("validate", "two.stgs")
        info = self.json_of("info", "two.stgs")
        self.assertEqual(info["frames"], 20)
        self.assertEqual(info["primitives"], sum(row["primitives"] for row in report["windows"]))
        self.assertEqual(sorted(os.listdir(self.work)), ["one.stgs", "prepared", "two.stgs"])
        self.assertGreater(self.psnr("two.stgs"), self.psnr("one.stgs") - 0.5)
        # A round with fewer windows than processes.
        self.both_succeed(self.encode("three.stgs"), processes=3)
        self.assertEqual(self.read("three.stgs"), self.read("two.stgs"))

    def test_a_round_is_repeated_after_a_process_was_killed(self):
        self.both_succeed(self.encode("once.stgs"))
        self.killed("out.stgs")
        result = self.both_succeed(self.encode("out.stgs", "--log-level", "info"))
        self.assertIn("resuming after frame 8", result.stderr)
        self.assertEqual(self.read("out.stgs"), self.read("once.stgs"))
        self.assertEqual(sorted(os.listdir(self.work)), ["once.stgs", "out.stgs"])

    def test_an_error_of_one_process_ends_all(self):
        good = self.encode("out.stgs")
        self.both_fail(USAGE, "process 2 of 2, on .*: out.stgs.work: this process has another capture or other "
                       "settings than the first", good, self.encode("out.stgs", "--seed", "7"))
        self.both_fail(USAGE, "error: .*one process encodes all frames at once, but 2 have been started",
                       ["encode", harness.sample(), "-o", "out.stgs", "--scale", "0.1"])
        self.both_fail(IO, "error: none: no such", ["encode", "none", "-o", "out.stgs", "--window", "8"])


if __name__ == "__main__":
    unittest.main()
