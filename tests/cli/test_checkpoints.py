# SPDX-License-Identifier: Apache-2.0
"""Checkpoints that cannot be written, and encodes that resume from one."""
import os
import resource
import signal
import subprocess
import unittest

import harness
from harness import CliTest, built_in

USAGE, IO, RUNTIME = 1, 2, 4


class FullDisk(CliTest):
    """A file size limit has the effect of a full disk, for any user."""

    def limited(self, *more):
        def limit():
            # The fixture's scene fits; its checkpoint is four times as large and does not.
            resource.setrlimit(resource.RLIMIT_FSIZE, (65536, 65536))
        args = ["train", self.fixture("prepared"), "--preset", "fast", "--max-primitives", "300",
                "--iterations", "40", "--log-level", "warning", "--set", "compact_keep=1", *more]
        return self.stgs(*args, preexec_fn=limit)

    def test_training_completes_without_a_writable_checkpoint(self):
        result = self.limited("-o", "a.stgs", "--checkpoint", "run.ckpt", "--checkpoint-interval", "10")
        self.assertEqual(result.returncode, 0, result.stderr)
        warnings = [line for line in result.stderr.decode().splitlines() if "warning" in line]
        self.assertEqual(len(warnings), 2, warnings)  # the first and the last
        for line, iteration in zip(warnings, (10, 40)):
            self.assertRegex(line, rf"iteration {iteration}: the checkpoint could not be written "
                                   r"\(run.ckpt: cannot write")
        self.assert_no_leftovers()
        self.succeeds("train", self.fixture("prepared"), "--preset", "fast", "--max-primitives",
                      "300", "--iterations", "40", "--set", "compact_keep=1", "-o", "b.stgs")
        self.assertEqual(self.read("a.stgs"), self.read("b.stgs"))


@unittest.skipUnless(built_in("encode"), "encode is not built in")
class Encoding(CliTest):
    """An encode resumes with the prepared capture in --keep-work: preparing it again may differ."""

    TRAIN = ["--preset", "fast", "--iterations", "400"]

    def encode(self, *more):
        return ["encode", os.path.join(harness.SOURCE, "tests", "data", "workshop"), "-o",
                "out.stgs", "--scale", "0.125", "--frames", "0:2", *self.TRAIN, *more]

    def interrupted(self, *more):
        """Interrupts an encode while it trains, and returns the last line that it printed."""
        args = [harness.STGS, *self.encode(*more), "--progress", "json"]
        with subprocess.Popen(args, cwd=self.work, stderr=subprocess.PIPE) as process:
            for line in process.stderr:
                if b'"train"' in line and b'"done":0.' in line:
                    break
            process.send_signal(signal.SIGINT)
            error = process.stderr.read().decode()
        self.assertEqual(process.returncode, RUNTIME, error)
        return error.splitlines()[-1]

    def test_an_interrupted_encode_resumes_as_its_hint_states(self):
        work = ["--keep-work", "work", "--checkpoint", "work/run.ckpt"]
        self.assertRegex(self.interrupted(*work, "--overwrite"), "run the same command with "
                         "--resume work/run.ckpt instead of --overwrite$")
        self.assertFalse(os.path.exists(self.path("out.stgs")))
        self.assertEqual(sorted(os.listdir(self.path("work"))), ["prepared", "run.ckpt"])
        log = self.succeeds(*self.encode(*work, "--resume", "work/run.ckpt")).stderr.decode()
        self.assertRegex(log, "work/prepared: resuming from it; .* is not prepared again")
        self.assertRegex(log, r"resumed at iteration \d+ from work/run.ckpt")
        self.json_of("validate", "out.stgs")
        self.succeeds("train", "work/prepared", "-o", "uninterrupted.stgs", *self.TRAIN)
        self.assertEqual(self.read("work/trained.stgs"), self.read("uninterrupted.stgs"))

        # Another run's folder, and an option that would replace the prepared capture.
        self.fails(IO, "other/prepared: not found; --resume needs the --keep-work folder",
                   *self.encode("--keep-work", "other", "--resume", "work/run.ckpt"))
        self.assertFalse(os.path.exists(self.path("other")))
        self.fails(USAGE, "--overwrite replaces it; use one of them",
                   *self.encode(*work, "--resume", "work/run.ckpt", "--overwrite"))
        self.assertTrue(os.path.exists(self.path("work/prepared/capture.json")))

    def test_checkpoints_require_a_kept_capture(self):
        for option in ("--checkpoint", "--resume"):
            self.fails(USAGE, f"{option} requires --keep-work FOLDER",
                       *self.encode(option, "run.ckpt"))
        self.assertEqual(os.listdir(self.work), [])


if __name__ == "__main__":
    unittest.main()
