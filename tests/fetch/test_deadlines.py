#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""With any server, verbs end within --timeout plus a second, with the reason.

usage: test_deadlines.py PLAY_PROBE PLAYBACK_PROBE STGS [unittest arguments]
PLAYBACK_PROBE is empty in builds without `play`.
"""
import concurrent.futures
import os
import socket
import subprocess
import sys
import tempfile
import time
import unittest

from faulty_server import FaultyServer

PLAY_PROBE, PLAYBACK_PROBE, STGS = (p and os.path.abspath(p) for p in sys.argv[1:4])
TIMEOUT = 1.5
# The promise is one second. The rest is for programs that start late on a busy machine.
MARGIN = 1 + (20 if os.environ.get("STGS_SANITIZE") else 2)
GAVE_UP = rb"gave up after \d\.\d s\); use a larger --timeout"

# Name, fault of every request, expected message.
CASES = [
    ("header_drip", {"header_drip": 0.05}, rb"headers, but no data within 1\S* s .*" + GAVE_UP),
    ("continue_forever", {"interim": 0}, rb"more than 20 responses to a request"),
    ("slow_continue", {"interim": 0.3}, rb"headers, but no data within 1\S* s .*" + GAVE_UP),
    ("silence", {"delay": 60}, rb"the server did not respond within 1\S* s .*" + GAVE_UP),
    ("five_bytes_a_response", {"cut": 5}, GAVE_UP),
    ("slow", {"drip": 0.02}, rb"sent \d+ bytes of the file within 1\S* s .*" + GAVE_UP),
    ("slow_then_reset", {"drip": 0.02, "cut": 15}, GAVE_UP),
    ("slow_error_page", {"status": 503, "slowly": 0.3}, GAVE_UP),
    ("retry_after", {"status": 503, "retry_after": 25},
     rb"status 503 and asks to wait 25 s .*" + GAVE_UP),
    ("redirect_loop", {"redirect": "/again"}, rb"redirects more than 5 times"),
    ("redirect_to_private", {"redirect": "http://10.1.2.3/scene.stgs"},
     rb"redirects to 10\.1\.2\.3, a host of a private network; use --allow-private"),
    ("redirect_to_localhost", {"redirect": "http://localhost/scene.stgs"},
     rb"redirects to localhost, a host of a private network; use --allow-private"),
    ("redirect_to_file", {"redirect": "file:///etc/hostname"},
     rb"redirects to a URL of the scheme file"),
    ("huge_header", {"huge_header": 300_000}, rb"the headers of the response exceed 64 KiB"),
    ("many_headers", {"huge_header": 200_000, "line": 1000},
     rb"the headers of the response exceed 64 KiB"),
    ("endless_body", {"endless": 206}, rb"sent more data than requested"),
    ("not_found", {"status": 404}, rb"status 404: the file does not exist"),
    ("endless_error_page", {"endless": 404}, rb"status 404: the file does not exist"),
]


def run(*command):
    """Returns the finished process and its duration, seconds."""
    begin = time.monotonic()
    process = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, check=False,
                             timeout=TIMEOUT + 60)
    return process, time.monotonic() - begin


class Deadlines(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        path = cls.folder.name + "/scene.stgs"
        subprocess.run([PLAY_PROBE, "make", path], check=True, timeout=120)
        with open(path, "rb") as file:
            cls.data = file.read()

    def check(self, name, process, seconds, message):
        print(f"  {name}: {seconds:.2f} s", file=sys.stderr)
        self.assertEqual(process.returncode, 2, (name, process.stderr))
        self.assertRegex(process.stdout + process.stderr, message, name)
        self.assertLess(seconds, TIMEOUT + MARGIN, name)

    def check_all(self, command, faults_before, cases=None):
        """Runs a command against each server. The first requests have no faults."""
        cases = cases or CASES

        def one(case):
            name, fault, message = case
            with FaultyServer(self.data, [{}] * faults_before + [fault] * 10000) as server:
                return name, *run(*[a.format(server.url) for a in command]), message

        with concurrent.futures.ThreadPoolExecutor(8) as pool:
            for result in pool.map(one, cases):
                with self.subTest(result[0]):
                    self.check(*result)

    def test_info_ends(self):
        self.check_all([STGS, "info", "{}", "--timeout", str(TIMEOUT)], 0)

    def test_validate_ends_if_later_reads_fail(self):
        """It reads no more after a failed read."""
        cases = [case for case in CASES if case[0] in ("silence", "slow", "retry_after")]
        self.check_all([STGS, "validate", "{}", "--timeout", str(TIMEOUT)], 1, cases)

    def test_validate_ends_if_reads_give_up(self):
        """Of each later range, too few bytes arrive, and soon."""
        with FaultyServer(self.data, [{}] + [{"cut": 0}] * 10000) as server:
            process, seconds = run(STGS, "validate", server.url, "--timeout", "60")
            requests = len(server.ranges)
        self.assertEqual(process.returncode, 2, process.stderr)
        self.assertIn(b"gave up after 5 attempts", process.stdout + process.stderr)
        # A read, and once more without the bytes read ahead.
        self.assertLessEqual(requests, 1 + 2 * 5)
        self.assertLess(seconds, 15)

    @unittest.skipUnless(PLAYBACK_PROBE, "needs play")
    def test_play_ends_while_it_opens(self):
        self.check_all([PLAYBACK_PROBE, "{}", str(TIMEOUT)], 0)

    @unittest.skipUnless(PLAYBACK_PROBE, "needs play")
    def test_play_ends_if_nothing_can_be_shown(self):
        cases = [(name, fault, message + rb".*; nothing could be shown for \d")
                 for name, fault, message in CASES]
        self.check_all([PLAYBACK_PROBE, "{}", str(TIMEOUT)], 1, cases)

    @unittest.skipUnless(PLAYBACK_PROBE, "needs play")
    def test_play_shows_what_can_be_read(self):
        with FaultyServer(self.data, [{}, {"status": 404}, {"cut": 100}]) as server:
            process, _ = run(PLAYBACK_PROBE, server.url, "30")
        self.assertEqual(process.returncode, 0, process.stderr)

    def test_a_slow_server_has_time_at_the_minimum_rate(self):
        """At 20 kB/s, the head takes longer than the timeout."""
        data = self.data[:30_000]
        with FaultyServer(data, [{"drip": 0.02, "piece": 400}] * 10000) as server:
            process, seconds = run(STGS, "info", server.url, "--timeout", "0.5")
        self.assertGreater(seconds, 1.5)
        self.assertEqual(process.returncode, 0, process.stderr)

    def test_a_mute_listener_is_not_a_server(self):
        """Connections are accepted by the kernel alone."""
        with socket.create_server(("127.0.0.1", 0)) as mute:
            url = f"http://127.0.0.1:{mute.getsockname()[1]}/scene.stgs"
            process, seconds = run(STGS, "info", url, "--timeout", str(TIMEOUT))
        self.check("mute", process, seconds, rb"did not respond within 1\S* s .*" + GAVE_UP)

    def test_a_refused_connection_needs_another_address_and_no_more_time(self):
        with socket.create_server(("127.0.0.1", 0)) as closed:
            url = f"http://127.0.0.1:{closed.getsockname()[1]}/scene.stgs"
        for timeout in ("0.2", "30"):  # no time for a second attempt; for all of them
            process, seconds = run(STGS, "info", url, "--timeout", timeout)
            self.assertEqual(process.returncode, 2, process.stderr)
            self.assertRegex(process.stderr, rb"onnect.* .gave up after \d attempts?.; check the "
                                             rb"address and whether the server runs .byte 0.")
            self.assertNotIn(b"--timeout", process.stderr)

    def test_redirects_within_the_host_and_allowed_ones_are_followed(self):
        with FaultyServer(self.data) as target:
            other_name = target.url.replace("127.0.0.1", "localhost")
            with FaultyServer(self.data, [{"redirect": target.url}] * 99) as server:
                self.assertEqual(run(STGS, "info", server.url)[0].returncode, 0)
            with FaultyServer(self.data, [{"redirect": other_name}] * 99) as server:
                self.assertEqual(run(STGS, "info", server.url)[0].returncode, 2)
                allowed, _ = run(STGS, "info", server.url, "--allow-private")
                self.assertEqual(allowed.returncode, 0, allowed.stderr)

    def test_limits_are_checked(self):
        for value in ("0", "-1", "nan", "inf", "2e6", "x", ""):
            process, _ = run(STGS, "info", "http://127.0.0.1/x.stgs", f"--timeout={value}")
            self.assertEqual(process.returncode, 1, value)
            self.assertIn(b"--timeout", process.stderr, value)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[4:]], verbosity=2)
