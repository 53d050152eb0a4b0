#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Reading over HTTP: despite network and server faults, reads return the bytes of the file.

usage: test_fetch.py FETCH_PROBE STGS VECTOR [unittest arguments]
"""
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

from faulty_server import FaultyServer
from nginx import Nginx

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir, "resources"))
import hostile  # noqa: E402

PROBE, STGS, VECTOR = (os.path.abspath(p) for p in sys.argv[1:4])
DATA = random.Random(5).randbytes(300_000)
QUICK = "backoff_seconds=0.01,stall_seconds=1,head_bytes=1000"


def probe(url, *ops, settings=QUICK):
    run = subprocess.run([PROBE, url, settings, *ops], stdout=subprocess.PIPE, check=True,
                         timeout=60)
    return json.loads(run.stdout)


class Ranges(unittest.TestCase):
    def assert_read(self, out, op, offset, size):
        result = out["ops"][op]["result"]
        self.assertEqual(result["code"], 0, result["message"])
        self.assertEqual(result["hex"], DATA[offset:offset + size].hex())

    def assert_failed(self, out, op, code, message):
        result = out["ops"][op]["result"]
        self.assertEqual(result["code"], code, result["message"])
        self.assertRegex(result["message"], message)

    def test_the_head_is_fetched_once_and_the_rest_by_range(self):
        with FaultyServer(DATA) as server:
            out = probe(server.url, "0:1000", "10:20", "999:2", "299999:1", "300000:0", "299999:2")
            self.assertEqual(out["size"], len(DATA))
            for op, (offset, size) in enumerate([(0, 1000), (10, 20), (999, 2), (299999, 1)]):
                self.assert_read(out, op, offset, size)
            self.assert_failed(out, 5, 3, r"the file is truncated \(needs bytes 299999 to 300001, has 300000 bytes\)")
            self.assertEqual(server.ranges,
                             ["bytes=0-999", "bytes=999-1000", "bytes=299999-299999"])
            self.assertEqual(len(server.connections), 1, "the connection is kept alive")
            self.assertEqual(out["statistics"], {"requests": 3, "bytes": 1003, "retries": 0})
            self.assertEqual(out["events"], [])

    def test_many_reads_of_few_bytes_take_few_requests(self):
        offsets = list(range(1000, 290_000, 700))
        random.Random(1).shuffle(offsets)
        with FaultyServer(DATA) as server:
            out = probe(server.url, *[f"{at}:45" for at in offsets])
            for op, at in enumerate(offsets):
                self.assert_read(out, op, at, 45)
            # The head, 16 reads, 5 blocks, and at most 4 reads of bytes in two blocks.
            self.assertLessEqual(len(server.ranges), 1 + 16 + 5 + 4)

    def test_blocks_are_read_again_after_a_refresh(self):
        def grow(server):
            server.data, server.etag = DATA, '"2"'

        with FaultyServer(DATA[:200_000], [{}] * 18 + [{"do": grow}]) as server:
            out = probe(server.url, *["199990:10"] * 17, "refresh", *["199990:20"] * 17)
            self.assertEqual(out["ops"][17]["result"]["change"], "resized")
            for op in range(18, 35):
                self.assert_read(out, op, 199_990, 20)

    def test_the_requests_for_an_index_are_bounded_by_its_bytes(self):
        data = hostile.pages(70_000, entries_each=0, damaged=0)
        self.assertGreater(data.count(b"PAGE"), 1300)
        with FaultyServer(data) as server:
            subprocess.run([STGS, "info", server.url], check=True, timeout=60, stdout=subprocess.DEVNULL)
            self.assertLess(len(server.ranges), 40)

    def test_a_file_may_be_shorter_than_the_head(self):
        with FaultyServer(DATA[:700]) as server:
            out = probe(server.url.replace("http:", "HTTP:"), "0:700")
            self.assertEqual(out["size"], 700)
            self.assert_read(out, 0, 0, 700)
            self.assertEqual(len(server.ranges), 1)

    def test_a_read_resumes_after_a_reset(self):
        with FaultyServer(DATA, [{}, {"cut": 70_000}, {"cut": 0}, {"cut": 9}]) as server:
            out = probe(server.url, "1000:200000")
            self.assert_read(out, 0, 1000, 200000)
            self.assertEqual(server.ranges[1], "bytes=1000-200999")
            begins = [int(r.split("=")[1].split("-")[0]) for r in server.ranges[1:]]
            self.assertEqual(begins, sorted(begins))
            self.assertGreater(begins[-1], 1000 + 9)
            self.assertTrue(all(r.endswith("-200999") for r in server.ranges[1:]))
            self.assertEqual(out["statistics"]["bytes"], 1000 + 200000)
            self.assertEqual([e["kind"] for e in out["events"]], ["retry"] * 3)

    def test_a_silent_server_is_retried(self):
        with FaultyServer(DATA, [{}, {"stall": 5000}]) as server:
            out = probe(server.url, "1000:20000")
            self.assert_read(out, 0, 1000, 20000)
            self.assertTrue(1 <= out["ops"][0]["seconds"] < 6, out["ops"])
            self.assertIn("received no data for 1 s", out["events"][0]["message"])
            self.assertEqual(server.ranges[2].split("-")[1], "20999")

    def test_a_very_slow_server_counts_as_silent(self):
        """At 20 bytes per second, the read would take an hour."""
        with FaultyServer(DATA, [{}, {"drip": 0.05}]) as server:
            out = probe(server.url, "1000:80000")
            self.assert_read(out, 0, 1000, 80000)
            self.assertTrue(1 <= out["ops"][0]["seconds"] < 6, out["ops"])
            self.assertIn("received almost no data for 1 s", out["events"][0]["message"])
            self.assertGreater(int(server.ranges[2].split("=")[1].split("-")[0]), 1000)

    def test_the_body_of_an_error_response_may_be_slow(self):
        with FaultyServer(DATA, [{}, {"status": 404, "slowly": 0.6}]) as server:
            out = probe(server.url, "1000:10")
            self.assert_failed(out, 0, 2, "responded with status 404: the file does not exist")
            self.assertEqual(len(server.ranges), 2)

    def test_attempts_with_progress_do_not_count(self):
        """Resets that follow some data are retried without a limit, even with a long stall timeout."""
        with FaultyServer(DATA, [{}] + [{"cut": 5000}] * 7) as server:
            settings = QUICK.replace("stall_seconds=1", "stall_seconds=100") + ",max_attempts=3"
            out = probe(server.url, "1000:40000", settings=settings)
            self.assert_read(out, 0, 1000, 40000)

    def test_temporary_errors_are_retried_with_backoff(self):
        faults = [{}, {"status": 503}, {"status": 500}, {"status": 429, "retry_after": 1}]
        with FaultyServer(DATA, faults) as server:
            out = probe(server.url, "1000:10")
            self.assert_read(out, 0, 1000, 10)
            waits = [e["wait"] for e in out["events"]]
            self.assertTrue(0.007 <= waits[0] <= 0.01 and 0.015 <= waits[1] <= 0.02, waits)
            self.assertGreaterEqual(waits[2], 1, "as long as the server asks for")

    def test_attempts_are_limited(self):
        with FaultyServer(DATA, [{}] + [{"status": 503}] * 9) as server:
            out = probe(server.url, "1000:10", settings=QUICK + ",max_attempts=3")
            self.assert_failed(out, 0, 2, "responded with status 503 .gave up after 3 attempts. .byte 1000")
            self.assertEqual(len(server.ranges), 4)
            self.assertEqual([e["kind"] for e in out["events"]], ["retry", "retry", "failed"])

    def test_permanent_errors_are_not_retried(self):
        cases = [({"status": 404}, 2, "responded with status 404: the file does not exist"),
                 ({"status": 403}, 2, "responded with status 403: access denied"),
                 ({"complete": True}, 5, "does not support byte ranges"),
                 ({"encode": True}, 5, "applies the content encoding .gzip"),
                 ({"shift": 1}, 2, "a different byte range than requested"),
                 ({"long": 7}, 2, "more data than requested")]
        for fault, code, message in cases:
            with self.subTest(fault), FaultyServer(DATA, [{}, fault]) as server:
                out = probe(server.url, "1000:10", "1000:10")
                self.assert_failed(out, 0, code, message)
                self.assert_read(out, 1, 1000, 10)
                self.assertEqual(len(server.ranges), 3)
            with self.subTest(open=fault), FaultyServer(DATA, [fault]) as server:
                out = probe(server.url)
                self.assertEqual(out["open"]["code"], code)
                self.assertRegex(out["open"]["message"], message)
        with FaultyServer(DATA, [{"no_total": True}]) as server:
            out = probe(server.url)
            self.assertEqual(out["open"]["code"], 5)
            self.assertRegex(out["open"]["message"], "does not state the size")

    def test_a_refused_connection_is_an_error(self):
        with socket.socket() as closed:
            closed.bind(("127.0.0.1", 0))
            url = f"http://127.0.0.1:{closed.getsockname()[1]}/x.stgs"
            out = probe(url, settings=QUICK + ",max_attempts=2")
            self.assertEqual(out["open"]["code"], 2)
            self.assertRegex(out["open"]["message"], "gave up after 2 attempts.; check the address and whether the server runs .byte 0")

    def test_connecting_after_a_redirect_has_its_own_timeout(self):
        with socket.create_server(("127.0.0.1", 0)) as mute:  # accepts connections without answering
            url = f"https://127.0.0.1:{mute.getsockname()[1]}/scene.stgs"
            with FaultyServer(DATA, [{"redirect": url}]) as server:
                out = probe(server.url, settings="max_attempts=1,stall_seconds=0.3,connect_seconds=2")
        self.assertEqual(out["open"]["code"], 2)
        self.assertRegex(out["open"]["message"], "(?i)connection time")

    def test_only_redirects_to_http_are_followed(self):
        with FaultyServer(DATA) as target:
            with FaultyServer(DATA, [{"redirect": target.url}]) as server:
                self.assertEqual(probe(server.url)["size"], len(DATA))
            with FaultyServer(DATA, [{"redirect": "file:///etc/hostname"}]) as server:
                self.assertEqual(probe(server.url)["open"]["code"], 2)

    def test_passwords_are_sent_to_their_own_origin(self):
        with FaultyServer(DATA) as other:
            faults = [{"redirect": "/moved"}, {}, {"redirect": other.url}] * 2
            with FaultyServer(DATA, faults) as server:
                out = probe(server.url.replace("//", "//me:secret@"), "1000:10", "2000:10")
                self.assert_read(out, 1, 2000, 10)
                basic = "Basic bWU6c2VjcmV0"
                self.assertEqual(server.authorizations, [basic] * 5)
                self.assertEqual(other.authorizations, [None])

    def test_a_replaced_file_is_an_error(self):
        def other(server):
            server.data, server.etag = bytes(len(DATA)), '"2"'

        def shorter(server):
            server.data = DATA[:2000]

        for change in (other, shorter):
            with self.subTest(change.__name__):
                with FaultyServer(DATA, [{}, {"do": change}]) as server:
                    self.assert_failed(probe(server.url, "1000:10"), 0, 2, "was replaced")
                with FaultyServer(DATA, [{}, {"cut": 9}, {"do": change}]) as server:
                    self.assert_failed(probe(server.url, "1000:9000"), 0, 2, "was replaced")

    def test_a_growing_file_is_not_a_replaced_file(self):
        def grow(server):
            server.data, server.etag = DATA + b"more", '"2"'

        def replace(server):
            server.data, server.etag = bytes(len(DATA) + 4), '"3"'

        with FaultyServer(DATA, [{}, {"do": grow}, {}, {}, {"do": replace}]) as server:
            out = probe(server.url, "1000:10", "refresh", "300000:4", "refresh")
            self.assert_read(out, 0, 1000, 10)
            self.assertEqual(out["ops"][1]["result"]["change"], "resized")
            self.assertEqual(out["ops"][1]["result"]["size"], len(DATA) + 4)
            self.assertEqual(out["ops"][2]["result"]["hex"], b"more".hex())
            self.assertEqual(out["ops"][3]["result"]["change"], "replaced")

    def test_a_stop_request_ends_a_read_at_once(self):
        for fault in ({"delay": 30}, {"status": 503, "retry_after": 25}, {"stall": 10}):
            with self.subTest(fault), FaultyServer(DATA, [{}, fault]) as server:
                out = probe(server.url, "stop:0.3:1000:100", "2000:10",
                            settings="stall_seconds=60,head_bytes=1000")
                self.assert_failed(out, 0, 4, "reading was stopped")
                self.assertLess(out["ops"][0]["seconds"], 3)
                self.assert_failed(out, 1, 4, "reading was stopped")

    def test_many_readers_share_the_connections(self):
        with FaultyServer(DATA, [{}] + [{"cut": 1000}, {}] * 4) as server:
            out = probe(server.url, "all:8", settings=QUICK + ",max_connections=2")
            for result in out["ops"][0]["result"]:
                self.assertEqual(result["hex"], DATA.hex())

    def test_names_contain_neither_keys_nor_passwords(self):
        with FaultyServer(DATA) as server:
            url = server.url.replace("//", "//me:secret@") + "?key=hidden"
            self.assertEqual(probe(url)["name"], server.url)


class Verbs(unittest.TestCase):
    def stgs(self, *args, **options):
        return subprocess.run([STGS, *args], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              timeout=120, check=False, **options)

    def assert_same_output(self, url):
        """Checks that verbs print the same for the URL as for the local file."""
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        camera = folder.name + "/camera.json"
        with open(camera, "w", encoding="ascii") as file:
            json.dump({"width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 32, "cy": 24,
                       "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 3]}, file)
        for args in (["info", "{}", "--format", "json"], ["validate", "{}"],
                     ["render", "{}", "--time", "0", "--camera", camera, "-o", "-"]):
            local = self.stgs(*[a.format(VECTOR) for a in args])
            remote = self.stgs(*[a.format(url) for a in args])
            self.assertEqual(remote.returncode, 0, remote.stderr)
            self.assertEqual(remote.stdout.replace(url.encode(), b"X"),
                             local.stdout.replace(VECTOR.encode(), b"X"), args[0])

    def test_verbs_accept_a_url_like_a_path(self):
        with open(VECTOR, "rb") as file:
            with FaultyServer(file.read()) as server:
                self.assert_same_output(server.url)

    def test_retries_are_warnings_and_failures_errors(self):
        with open(VECTOR, "rb") as file:
            data = file.read()
        with FaultyServer(data, [{"status": 503}]) as server:
            url = server.url.replace("//", "//user:secret@") + "?key=secret"
            run = self.stgs("info", url)
            self.assertEqual(run.returncode, 0)
            warning = rb"warning: at byte 0: http://127.\S+: .* 503; retrying in 0."
            self.assertRegex(run.stderr, warning)
            self.assertNotIn(b"secret", run.stderr)
        with FaultyServer(data, [{"status": 404}]) as server:
            run = self.stgs("info", server.url)
            self.assertEqual(run.returncode, 2)
            self.assertRegex(run.stderr, rb"error: http://\S+: the server responded with status 404")

    def test_output_contains_neither_keys_nor_passwords(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        with open(VECTOR, "rb") as file:
            data = bytearray(file.read())
        damaged = bytes(data[:-40]) + bytes(40)
        for content in (bytes(data), damaged):
            with FaultyServer(content) as server:
                url = server.url.replace("//", "//user:secret@") + "?key=secret"
                for args in (["info", url], ["validate", url], ["compare", url, url],
                             ["render", url, "--time", "99", "-o", folder.name + "/a.png"],
                             ["bench", url, "--num-frames", "1", "--backend", "cpu"],
                             ["bench", url, "--play", "player", "--frames", "1"]):
                    for output_format in ("text", "json"):
                        run = self.stgs(*args, "--format", output_format)
                        output = run.stdout + run.stderr
                        self.assertIn(server.url.encode(), output, args)
                        self.assertNotIn(b"secret", output, args)

    def test_output_contains_no_password_of_a_proxy(self):
        closed = "127.0.0.1:1"
        for proxy, code in (("me:secret@127.0.0.1:99999", 1), ("bad url secret", 1),
                            ("http://me:secret@[::1", 1), ("ftp://me:secret@127.0.0.1", 2),
                            ("http://me:secret@" + closed, 2), ("socks5://me:secret@" + closed, 2)):
            with self.subTest(proxy):
                run = self.stgs("info", "http://example.org/x.stgs", "--timeout", "0.5",
                                env={**os.environ, "http_proxy": proxy})
                self.assertEqual(run.returncode, code, run.stderr)
                self.assertIn(b"proxy" if code == 1 else b"http://example.org", run.stderr)
                self.assertNotIn(b"secret", run.stdout + run.stderr)

    def test_a_proxy_gets_its_password(self):
        with open(VECTOR, "rb") as file:
            with FaultyServer(file.read()) as proxy:
                address = proxy.url.replace("//", "//me:se%40cret@").replace("/scene.stgs", "")
                run = self.stgs("info", "http://example.org/x.stgs",
                                env={**os.environ, "http_proxy": address})
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertEqual(proxy.proxy_authorizations[0], "Basic bWU6c2VAY3JldA==")

    def test_other_url_schemes_are_rejected(self):
        run = self.stgs("info", "ftp://127.0.0.1/scene.stgs")
        self.assertEqual(run.returncode, 1)
        self.assertRegex(run.stderr, b"ftp://127.0.0.1/scene.stgs: unsupported URL scheme")

    def test_an_interrupt_ends_a_pending_request(self):
        with FaultyServer(b"", [{"delay": 60}]) as server:
            run = subprocess.Popen([STGS, "info", server.url], stderr=subprocess.PIPE)
            while not server.ranges:
                time.sleep(0.05)
            begin = time.monotonic()
            run.send_signal(signal.SIGINT)
            error = run.communicate(timeout=20)[1]
            self.assertEqual(run.returncode, 4)
            self.assertRegex(error, b"interrupted by SIGINT: ")
            self.assertLess(time.monotonic() - begin, 10)

    @unittest.skipUnless(shutil.which("nginx"), "needs nginx")
    def test_verbs_read_from_nginx(self):
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(VECTOR, folder + "/scene.stgs")
            with Nginx(folder, limit="2m") as server:
                self.assert_same_output(server.url)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[4:]], verbosity=2)
