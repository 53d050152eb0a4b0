# SPDX-License-Identifier: Apache-2.0
"""Training with two processes that mpirun starts."""
import json
import os
import shutil
import signal
import subprocess
import time
import unittest

import harness
from harness import CliTest
from mpi import MPIRUN, MpiTest, mpirun_version

USAGE, IO, RUNTIME, NOT_BUILT = 1, 2, 4, 6
OPTIONS = ["--backend", "cpu", "--preset", "fast", "--max-primitives", "300", "--set",
           "densify_interval=20", "--threads", "1"]
# Steps of a run that is interrupted: sanitizers are 10 times slower.
STEPS = 1000 if os.environ.get("STGS_SANITIZE") else 3000


class Ranks(MpiTest):
    def train(self, *more, capture=None):
        return ["train", capture or self.fixture("prepared"), "-o", "out.stgs", *OPTIONS, *more]

    def test_two_processes_train_one_scene(self):
        args = self.train("--iterations", "300", "--log", "log.jsonl", "--format", "json")
        self.succeeds(*args)
        os.rename(self.path("out.stgs"), self.path("alone.stgs"))
        # Only the first process prints. The run itself checks at its end that all states are equal.
        result = self.both_succeed(args)
        report = json.loads(result.stdout)
        self.check_schema("train", report)
        self.assertEqual((report["processes"], report["iterations"]), (2, 300))
        self.assertEqual(result.stderr.count("training on cpu"), 1)
        self.assertIn("2 processes train one view each per step: 300 iterations (views) take "
                      "150 steps", result.stderr)
        lines = [json.loads(line) for line in self.read("log.jsonl").splitlines()]
        steps = [line["iteration"] for line in lines if "loss" in line]
        self.assertEqual(steps, [2, *range(50, 301, 50)])
        self.assertNotEqual(self.read("out.stgs"), self.read("alone.stgs"))

    def test_repeated_runs_give_the_same_scene(self):
        scenes = []
        for _ in range(2):
            self.both_succeed(self.train("--iterations", "150"))
            scenes.append(self.read("out.stgs"))
        self.assertEqual(scenes[0], scenes[1])

    def stopped_at(self, share, stop, *args):
        """Calls stop(process) when two processes have done a share of their run; returns the rest
        of standard error."""
        command = [*MPIRUN, "-np", "2", harness.STGS, *map(str, args), "--progress", "json"]
        with subprocess.Popen(command, cwd=self.work, env=self.environment,
                              stderr=subprocess.PIPE, text=True) as process:
            for line in process.stderr:
                progress = json.loads(line) if line.startswith("{") else {}
                if progress.get("stage") == "train" and progress["done"] >= share:
                    break
            stop(process)
            error = process.stderr.read()
            process.wait(60)
        self.assertNotEqual(process.returncode, 0)
        self.assertFalse(os.path.exists(self.path("out.stgs")))
        return error

    def test_a_run_resumes_with_any_number_of_processes(self):
        """The same number gives the same bytes; another number is reported."""
        args = self.train("--iterations", STEPS, "--checkpoint", "run.ckpt")
        self.both_succeed(args)
        os.rename(self.path("out.stgs"), self.path("uninterrupted.stgs"))
        os.remove(self.path("run.ckpt"))
        error = self.stopped_at(0.05, lambda process: process.send_signal(signal.SIGTERM), *args)
        if error or mpirun_version() < 5:  # mpirun 5 drops the last messages of a job that it stops
            self.assertRegex(error, r"stgs: error: interrupted by SIGTERM: .*stopped at iteration "
                                    r"\d*[02468]; resume with --resume run.ckpt")
            self.assertEqual(error.count("stgs: error"), 1)
        self.assert_no_leftovers()
        shutil.copy(self.path("run.ckpt"), self.path("stopped.ckpt"))
        self.both_succeed([*args, "--resume", "run.ckpt"])
        self.assertEqual(self.read("out.stgs"), self.read("uninterrupted.stgs"))
        result = self.succeeds(*args, "--resume", "stopped.ckpt")
        self.assertIn("stopped.ckpt: number of processes was 2 and is now 1",
                      result.stderr.decode())
        self.assertNotEqual(self.read("out.stgs"), self.read("uninterrupted.stgs"))

    def test_an_error_of_one_process_ends_both(self):
        bad = self.copy_capture("bad")
        os.remove(os.path.join(bad, "frames", "b", "000002.png"))
        good = self.train("--iterations", "50")
        incomplete = self.train("--iterations", "50", capture=bad)
        self.both_fail(IO, "process 2 of 2, on .*/bad/frames/b/000002.png: no such file", good,
                       incomplete)
        self.both_fail(IO, "process 1 of 2, on .*/bad/frames/b/000002.png: no such file", incomplete,
                       good)

    def test_an_error_of_both_processes_is_printed_once(self):
        self.both_fail(IO, "error: none: no such file or folder", self.train(capture="none"))
        self.both_fail(IO, "error: none.ckpt", self.train("--resume", "none.ckpt"))

    def test_both_processes_need_the_same_settings(self):
        first = self.train("--iterations", "50")
        self.both_fail(USAGE, "process 2 of 2: different capture or other settings than process 1",
                       first, self.train("--iterations", "60"))
        self.both_fail(USAGE, "process 2 of 2: different checkpoint, log or evaluation settings", first,
                       self.train("--iterations", "50", "--num-evals", "3"))

    def test_killing_one_process_ends_the_other(self):
        ranks = []

        def kill_the_second(process):
            ranks.extend(self.ranks_of(process))
            os.kill(max(ranks), signal.SIGKILL)

        self.stopped_at(0, kill_the_second, *self.train("--iterations", "1000000"))
        self.assertEqual(len(ranks), 2)
        deadline = time.monotonic() + 20

        def running():
            return [rank for rank in ranks if self.stat(rank)[:1] not in ([], ["Z"], ["X"])]

        while running() and time.monotonic() < deadline:
            time.sleep(0.1)
        self.assertEqual(running(), [])


class LauncherEnvironment(CliTest):
    """Runs without mpirun, but with the variables that a launcher sets."""

    def run_in(self, code, message, args, **environment):
        self.fails(code, message, *args, env={**os.environ, **environment})

    def test_a_build_without_mpi_rejects_several_processes(self):
        if harness.built_in("mpi"):
            self.skipTest("MPI is built in")
        self.run_in(NOT_BUILT, "mpirun started 2 processes, but this build has no MPI",
                    ["train", self.fixture("prepared"), "-o", "out.stgs"],
                    OMPI_COMM_WORLD_SIZE="2")

    def test_an_allocation_without_a_step_is_one_process(self):
        """A program started directly within sbatch or salloc is a single process."""
        args = ["train", self.fixture("prepared"), "-o", "out.stgs", "--iterations", "2", *OPTIONS]
        for environment in ({"SLURM_NTASKS": "4"},
                            {"SLURM_STEP_ID": "0", "SLURM_STEP_NUM_TASKS": "1",
                             "SLURM_NTASKS": "4"},
                            {"OMPI_COMM_WORLD_SIZE": "1"}):
            self.succeeds(*args, env={**os.environ, **environment})


if __name__ == "__main__":
    unittest.main()
