# SPDX-License-Identifier: Apache-2.0
"""A signal ends a run that waits for another program."""
import os
import signal
import subprocess
import threading
import time
import unittest

import harness
from harness import CliTest

RUNTIME = 4
SECONDS = 10  # much longer than a run takes to stop


class Signals(CliTest):
    def stops(self, process, number):
        time.sleep(0.5)
        self.assertIsNone(process.poll(), "the run waits")
        process.send_signal(number)
        killer = threading.Timer(SECONDS, process.kill)
        killer.start()
        error = process.stderr.read().decode()
        code = process.wait()
        killer.cancel()
        self.assertEqual(code, RUNTIME, error)
        self.assertRegex(error, f"interrupted by {number.name}: standard ")

    def start(self, *args, **streams):
        process = subprocess.Popen([harness.STGS, *args], cwd=self.work, stderr=subprocess.PIPE, **streams)
        self.addCleanup(process.stderr.close)
        return process

    def test_while_standard_input_gives_nothing(self):
        for number in (signal.SIGINT, signal.SIGTERM):
            with self.subTest(number=number):
                reader, writer = os.pipe()
                process = self.start("validate", "-", stdin=reader, stdout=subprocess.DEVNULL)
                os.close(reader)
                self.stops(process, number)
                os.close(writer)

    def test_while_nobody_reads_standard_output(self):
        videos = ["render", self.fixture("tiny.stgs"), "--size", "512x512", "--frames", "0:4",
                  "--backend", "cpu", "-o", "-"]
        for args in (videos, ["info", *[self.fixture("tiny.stgs")] * 200, "--format", "json"]):
            with self.subTest(args=args[0]):
                reader, writer = os.pipe()
                process = self.start(*args, stdout=writer)
                os.close(writer)
                self.stops(process, signal.SIGTERM)
                os.close(reader)

    def test_while_nobody_reads_standard_error(self):
        """More warnings than a pipe takes: the run ends, and they are lost."""
        reader, writer = os.pipe()
        process = subprocess.Popen([harness.STGS, "info", *["missing.stgs"] * 5000], cwd=self.work,
                                   stdout=subprocess.DEVNULL, stderr=writer)
        os.close(writer)
        time.sleep(1)
        self.assertIsNone(process.poll(), "the run waits")
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        try:
            process.wait(SECONDS)
        finally:
            process.kill()
        self.assertLess(time.monotonic() - begin, 1.5)
        self.assertIn(process.returncode, (2, RUNTIME))
        os.close(reader)


if __name__ == "__main__":
    unittest.main()
