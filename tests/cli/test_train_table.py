# SPDX-License-Identifier: Apache-2.0
"""tests/bench/train_table.py, which trains and evaluates lists of variants."""
import json
import os
import subprocess
import sys

import harness
from harness import CliTest


class TrainTable(CliTest):
    def table(self, text, *options):
        self.write("list.txt", text)
        script = os.path.join(harness.SOURCE, "tests/bench/train_table.py")
        return subprocess.run(
            [sys.executable, script, "list.txt", "--capture", f"c={self.fixture('prepared')}",
             "--stgs", harness.STGS, "--backend", "cpu", "--at-once", "2", "--work", "work",
             *options],
            cwd=self.work, capture_output=True, text=True, timeout=300, check=False)

    def test_a_fold_holds_out_training_cameras_and_omits_test_cameras(self):
        with open(os.path.join(self.fixture("prepared"), "capture.json"), encoding="utf-8") as file:
            cameras = json.load(file)["cameras"]
        training = [camera["name"] for camera in cameras if not camera["test"]]
        short = "--preset fast --iterations 20 --max-primitives 300"
        done = self.table(f"# a comment\nall | c | 3 | {short}\n"
                          f"fold | c:{training[0]} | 3 | {short} --ablate lifespan\n")
        self.assertEqual(done.returncode, 0, done.stderr)
        rows = {line.split(" | ")[0]: line for line in done.stdout.splitlines()}
        self.assertEqual(sorted(rows), ["all", "fold"])
        self.assertRegex(rows["fold"], rf"\| {training[0]} [0-9.]+$")
        with open(self.path(f"work/c-without-{training[0]}/capture.json"),
                  encoding="utf-8") as file:
            fold = json.load(file)["cameras"]
        self.assertEqual([camera["name"] for camera in fold], training)
        self.assertEqual([camera["name"] for camera in fold if camera["test"]], training[:1])
        self.assertEqual(os.listdir(self.path("work")), [f"c-without-{training[0]}"])

    def test_seeds_are_averaged(self):
        short = "--preset fast --iterations 20 --max-primitives 300 --seed"
        done = self.table(f"few-1 | c | 3 | {short} 1\nfew-2 | c | 3 | {short} 2\nother-1 | c | 3 | {short} 1\n")
        self.assertEqual(done.returncode, 0, done.stderr)
        rows = {line.split(" | ")[0]: line for line in done.stdout.splitlines()}
        self.assertEqual(sorted(rows), ["few, 2 seeds", "few-1", "few-2", "other-1"])
        psnr = [float(rows[name].split(" | ")[1].split(" / ")[0]) for name in ("few-1", "few-2")]
        mean, deviation = (float(v) for v in rows["few, 2 seeds"].split(" | ")[1].split(" ")[1::2])
        self.assertAlmostEqual(mean, sum(psnr) / 2, 2)
        self.assertAlmostEqual(deviation, abs(psnr[0] - psnr[1]) / 2 ** 0.5, 2)

    def test_a_failed_variant_does_not_stop_the_others(self):
        done = self.table("bad | c | 3 | --preset none\n"
                          "good | c | 3 | --preset fast --iterations 20 --max-primitives 300\n")
        self.assertEqual(done.returncode, 1)
        self.assertIn("exit code 1", done.stderr)
        self.assertRegex(done.stdout, r"^good \| ")
        self.assertIn("no --capture d", self.table("x | d | 3 |\n").stderr)
        only = self.table("bad | c | 3 | --preset none\nworse | d | 3 |\n", "--only", "bad")
        self.assertEqual((only.returncode, only.stdout), (1, ""))
        self.assertIn("no variant's name begins with 'good'",
                      self.table("bad | c | 3 | --preset none\n", "--only", "good").stderr)
