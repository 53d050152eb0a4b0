# SPDX-License-Identifier: Apache-2.0
"""A signal ends a run that waits for another program, or works."""
import json
import os
import shutil
import signal
import struct
import subprocess
import threading
import time
import unittest
import zlib

import harness
from harness import CliTest

RUNTIME = 4
SECONDS = 10  # much longer than a run takes to stop


def png(width, height):
    """Returns a black PNG image."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    packer = zlib.compressobj(1)
    rows = b"".join(packer.compress(bytes(1 + 3 * width)) for _ in range(height)) + packer.flush()
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)) +
            chunk(b"IDAT", rows) + chunk(b"IEND", b""))


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
        self.assertRegex(error, f"interrupted by {number.name}: (standard |the information is not complete)")

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

    def test_in_the_middle_of_work(self):
        self.write("large.png", png(8192, 8192))
        shutil.copy(self.fixture("cut.stgs"), self.path("cut.stgs"))
        os.truncate(self.path("cut.stgs"), 6 << 30)  # searched for fragments
        for args in (["compare", "large.png", "large.png"],
                     ["render", self.fixture("tiny.stgs"), "--time", "0", "--backend", "cpu", "--size",
                      "8192x8192", "-o", "null"],
                     ["render", self.fixture("tiny.stgs"), "--frames", "0:4", "--backend", "cpu", "--size",
                      "8192x8192", "-o", "a.y4m"],
                     ["convert", self.fixture("clip.splatv"), "a.usda", "--frames", "1000000"],
                     ["info", "cut.stgs"], ["finalize", "cut.stgs", "-o", "a.stgs"]):
            with self.subTest(verb=args[0]):
                process = self.start(*args, stdout=subprocess.DEVNULL)
                time.sleep(0.7)
                self.assertIsNone(process.poll(), "the run works")
                process.send_signal(signal.SIGTERM)
                begin = time.monotonic()
                self.assertEqual(process.wait(SECONDS), RUNTIME)
                self.assertLess(time.monotonic() - begin, 2)
                self.assertRegex(process.stderr.read().decode(), "^stgs: error: interrupted by SIGTERM: [^\n]*\n$")
        self.assertEqual(sorted(os.listdir(self.work)), ["cut.stgs", "large.png"])

    def test_in_the_middle_of_preparing(self):
        """Decoding an image cannot be interrupted."""
        if not harness.built_in("prepare"):
            self.skipTest("this build cannot prepare captures")
        self.write("0.png", png(16000, 16000))
        shutil.copy(self.path("0.png"), self.path("1.png"))
        frames = [{"file_path": f"{k}.png", "transform_matrix": [
            [1, 0, 0, k], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]} for k in range(2)]
        self.write("transforms.json", json.dumps({
            "fl_x": 16000, "fl_y": 16000, "cx": 8000, "cy": 8000, "w": 16000, "h": 16000, "frames": frames}).encode())
        process = self.start("prepare", ".", "-o", "out", "--threads", "1")
        time.sleep(1.2)
        self.assertIsNone(process.poll(), "the run works")
        process.send_signal(signal.SIGTERM)
        error = process.stderr.read().decode()
        self.assertEqual(process.wait(SECONDS), RUNTIME, error)
        self.assertIn("interrupted by SIGTERM: ", error)
        self.assertEqual(sorted(os.listdir(self.work)), ["0.png", "1.png", "transforms.json"])

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
