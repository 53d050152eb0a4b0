# SPDX-License-Identifier: Apache-2.0
"""tests/bench/player_table.py, which the tables of drawing and playing in RESULTS.md are made with."""
import os
import subprocess
import sys

import harness
from harness import CliTest


class PlayerTable(CliTest):
    def table(self, *options):
        script = os.path.join(harness.SOURCE, "tests/bench/player_table.py")
        return subprocess.run(
            [sys.executable, script, self.fixture("steady.stgs"), "--stgs", harness.STGS,
             "--backend", "cpu", "--scale", "0.02", "--num-frames", "2", "--frames", "2",
             "--work", "work", *options],
            cwd=self.work, capture_output=True, text=True, timeout=300, check=False)

    def test_each_case_gets_a_line(self):
        done = self.table("--cases", "frame,stereo,lives,play", "--foveae", "300")
        self.assertEqual(done.returncode, 0, done.stderr)
        number = r"[0-9]+\.[0-9]+"
        rows = dict(line.split(" | ", maxsplit=1) for line in done.stdout.splitlines())
        self.assertEqual(
            list(rows),
            [f"cpu {size} {how}" for size in ("2160p", "1080p") for how in ("moving", "still")]
            + [f"cpu stereo {how}{fovea}" for fovea in ("", " fovea 300")
               for how in ("moving", "still")]
            + ["cpu stored 1 times", "cpu stored 10 times"]
            + [f"cpu play {through} camera {camera}" for through in ("timeline", "player")
               for camera in (0, 3, 6)])
        self.assertRegex(rows["cpu 2160p moving"], rf"^frame {number} \({number}\), device ")
        self.assertRegex(rows["cpu stereo still"], rf" one {number} \({number}\) ms, {number} times$")
        self.assertRegex(rows["cpu stereo still fovea 300"], rf"one alike .*, {number} times$")
        self.assertRegex(rows["cpu play player camera 3"], r"^\d of \d missed, \d+ incomplete, 0 lost")
        once, ten_times = (int(rows[f"cpu stored {n} times"].split("| ")[1].split()[0])
                           for n in (1, 10))
        self.assertGreater(ten_times, 2 * once)

    def test_a_run_that_fails_is_told_with_its_command(self):
        done = self.table("--cases", "steps")
        self.assertEqual((done.returncode, done.stdout), (1, ""))
        self.assertRegex(done.stderr, r"bench .* --steps .*: exit code 5: .*backend 'cpu'")
        self.assertIn("no case walk; there are frame,", self.table("--cases", "walk").stderr)
