# SPDX-License-Identifier: Apache-2.0
"""Checkpoints: what becomes of a training whose own cannot be written, and where one goes on."""
import os
import resource
import signal
import subprocess
import unittest

import harness
from harness import CliTest, built_in

USAGE, IO, RUNTIME = 1, 2, 4


class FullDisk(CliTest):
    """A limit on the size of files acts as a full disk does, for any user."""

    def limited(self, *more):
        def limit():
            # The scene of the fixture fits, and its checkpoint, four times as large, does not.
            resource.setrlimit(resource.RLIMIT_FSIZE, (65536, 65536))
        args = ["train", self.fixture("prepared"), "--preset", "fast", "--max-primitives", "300",
                "--iterations", "40", "--log-level", "warning", *more]
        return self.stgs(*args, preexec_fn=limit)

    def test_a_checkpoint_that_cannot_be_written_costs_no_scene(self):
        result = self.limited("-o", "a.stgs", "--checkpoint", "run.ckpt", "--checkpoint-interval", "10")
        self.assertEqual(result.returncode, 0, result.stderr)
        warnings = [line for line in result.stderr.decode().splitlines() if "warning" in line]
        self.assertEqual(len(warnings), 2, warnings)  # the first, and that of the end
        for line, begin in zip(warnings, ("10: the checkpoint could not be written", "40: the checkpoint could not be written")):
            self.assertRegex(line, f"iteration {begin} \(run.ckpt: cannot write")
        self.no_leftovers()
        self.succeeds("train", self.fixture("prepared"), "--preset", "fast", "--max-primitives",
                      "300", "--iterations", "40", "-o", "b.stgs")
        self.assertEqual(self.read("a.stgs"), self.read("b.stgs"))

    def test_nor_of_a_window(self):
        result = self.limited("-o", "parts", "--window", "6")
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn(b"000000-000006.stgs.ckpt: cannot write", result.stderr)
        self.json_of("validate", "parts/000000-000006.stgs")


@unittest.skipUnless(built_in("encode"), "encode is not built in")
class Encoding(CliTest):
    """What is prepared twice need not be the same, so a checkpoint goes on with what is kept."""

    TRAIN = ["--preset", "fast", "--iterations", "400"]

    def encode(self, *more):
        return ["encode", os.path.join(harness.SOURCE, "tests", "data", "workshop"), "-o",
                "out.stgs", "--scale", "0.25", "--frames", "0:2", *self.TRAIN, *more]

    def stopped(self, *more):
        """What an encode that is interrupted while it trains says last."""
        args = [harness.STGS, *self.encode(*more), "--progress", "json"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            for line in process.stderr:
                if b'"train"' in line and b'"done":0.' in line:
                    break
            process.send_signal(signal.SIGINT)
            error = process.stderr.read().decode()
        self.assertEqual(process.returncode, RUNTIME, error)
        return error.splitlines()[-1]

    def test_a_stopped_encode_goes_on_as_it_says(self):
        kept = ["--keep-work", "work", "--checkpoint", "work/run.ckpt"]
        self.assertRegex(self.stopped(*kept, "--overwrite"), "run the same command with "
                         "--resume work/run.ckpt instead of --overwrite$")
        self.assertFalse(os.path.exists(self.path("out.stgs")))
        self.assertEqual(sorted(os.listdir(self.path("work"))), ["prepared", "run.ckpt"])
        told = self.succeeds(*self.encode(*kept, "--resume", "work/run.ckpt")).stderr.decode()
        self.assertRegex(told, "work/prepared: resuming from it; .* is not prepared again")
        self.assertRegex(told, r"resumed at iteration \d+ from work/run.ckpt")
        self.json_of("validate", "out.stgs")
        self.succeeds("train", "work/prepared", "-o", "straight.stgs", *self.TRAIN)
        self.assertEqual(self.read("work/trained.stgs"), self.read("straight.stgs"))

        # A folder that is not the run's, and what would replace it.
        self.fails(IO, "other/prepared: not found; --resume needs the --keep-work folder",
                   *self.encode("--keep-work", "other", "--resume", "work/run.ckpt"))
        self.assertFalse(os.path.exists(self.path("other")))
        self.fails(USAGE, "--overwrite replaces it; use one of them",
                   *self.encode(*kept, "--resume", "work/run.ckpt", "--overwrite"))
        self.assertTrue(os.path.exists(self.path("work/prepared/capture.json")))

    def test_a_checkpoint_needs_the_capture_that_it_goes_on_from(self):
        for option in ("--checkpoint", "--resume"):
            self.fails(USAGE, f"{option} requires --keep-work FOLDER",
                       *self.encode(option, "run.ckpt"))
        self.assertEqual(os.listdir(self.work), [])


if __name__ == "__main__":
    unittest.main()
