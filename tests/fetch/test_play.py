#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Playing over HTTP: despite network and server faults, frames degrade and recover.

usage: test_play.py PLAY_PROBE RECORDER STGS [unittest arguments]
"""
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import unittest

from faulty_link import FaultyLink
from faulty_server import FaultyServer
from nginx import Nginx

PROBE, RECORDER, STGS = map(os.path.abspath, sys.argv[1:4])


class Play(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.file = cls.folder.name + "/scene.stgs"
        subprocess.run([PROBE, "make", cls.file], check=True, timeout=120)
        with open(cls.file, "rb") as file:
            cls.data = file.read()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def play(self, location, seconds, *seeks, stall_seconds=1):
        run = subprocess.run([PROBE, "play", location, self.file, str(seconds), *map(str, seeks)],
                             stdout=subprocess.PIPE, check=True, timeout=60,
                             env={**os.environ, "STALL_SECONDS": str(stall_seconds)})
        out = json.loads(run.stdout)
        self.assertNotIn("error", out)
        return out

    def assert_recovered(self, out):
        """Checks that everything was loaded and rendered at the end, and that no call blocked."""
        self.assertEqual(out["layers"], out["layer_count"], out)
        self.assertTrue(out["same"], out)
        self.assertTrue(out["same_frame"], out)
        self.assertLess(out["longest_call"], 0.5, out)
        self.assertLess(out["closed_in"], 2, out)

    def faulty(self, faults, seconds=1.5, *seeks, stall_seconds=1):
        with FaultyServer(self.data, [{}, *faults]) as server:
            out = self.play(server.url, seconds, *seeks, stall_seconds=stall_seconds)
        self.assert_recovered(out)
        return out

    def test_bench_counts_failed_reads(self):
        camera = self.folder.name + "/camera.json"
        with open(camera, "w", encoding="ascii") as file:
            json.dump({"width": 32, "height": 24, "fx": 30, "fy": 30, "cx": 16, "cy": 12,
                       "rotation": [1, 0, 0, 0, 1, 0, 0, 0, 1], "translation": [0, 0, 8]}, file)
        faults = [{}] * 2 + [{"status": 404}] * 10000
        with FaultyServer(self.data, faults) as server:
            run = subprocess.run([STGS, "bench", server.url, "--play", "player", "--frames", "20",
                                  "--camera", camera, "--backend", "cpu", "--format", "json"],
                                 capture_output=True, timeout=120, check=True)
        play = json.loads(run.stdout)["play"]
        self.assertGreater(play["failed_reads"], 0)
        self.assertGreater(play["incomplete"], 0)
        self.assertIn(b"the file does not exist (missing for now)", run.stderr)

    def test_a_local_file_plays(self):
        out = self.play(self.file, 0.7, 2.9, 0.1)
        self.assert_recovered(out)
        self.assertLessEqual(set(out["counts"]), {"buffering", "resumed", "looped", "layers"})

    @unittest.skipUnless(shutil.which("nginx"), "needs nginx")
    def test_a_scene_on_nginx_plays(self):
        with Nginx(self.folder.name) as server:
            out = self.play(server.url, 1, stall_seconds=10)
        self.assert_recovered(out)
        self.assertEqual(out["messages"], [])

    @unittest.skipUnless(shutil.which("nginx"), "needs nginx")
    def test_a_slow_link_loads_the_base_layer_first(self):
        """Four connections transfer the file in about 3 s."""
        limit = len(self.data) // 12
        with Nginx(self.folder.name, limit=str(limit)) as server:
            out = self.play(server.url, 2)
        self.assert_recovered(out)
        self.assertLess(out["min_layers"], out["layer_count"], out)
        self.assertGreater(out["frames_ready"], 0)
        self.assertGreater(out["bytes_per_second"], limit / 4)

    def test_late_responses_cause_no_errors(self):
        # On a busy machine, a response may be more than a second late.
        out = self.faulty([{"delay": 0.2}] * 400, stall_seconds=10)
        self.assertEqual(out["messages"], [])

    def test_reset_connections_are_retried(self):
        out = self.faulty([{}, {"cut": 500}, {"cut": 0}, {}, {"cut": 100}] * 3)
        self.assertGreater(out["counts"].get("retry", 0), 0, out)

    def test_a_temporary_404_is_reported_and_survived(self):
        out = self.faulty([{}] * 4 + [{"status": 404}] * 6)
        self.assertGreater(out["counts"].get("read_failed", 0), 0, out)
        self.assertTrue(any("404" in m for m in out["messages"]), out)

    def test_a_stalled_link_is_retried(self):
        out = self.faulty([{}, {"stall": 100}, {}, {"stall": 0}], 3)
        self.assertGreater(out["counts"].get("retry", 0), 0, out)

    def test_a_seek_does_not_wait_for_a_stalled_read(self):
        """A seek waits neither for a stalled read nor for the backoff of a failed one."""
        for fault in ({"stall": 0}, {"status": 503, "retry_after": 20}):
            with self.subTest(fault=fault), FaultyServer(self.data) as server:
                requests, faulty_from = [], []

                def answer(_, requests=requests, faulty_from=faulty_from, fault=fault):
                    """Injects faults for 0.8 s, starting at the first request after a pause."""
                    requests.append(time.monotonic())
                    if len(requests) > 1 and requests[-1] - requests[-2] > 0.4 and not faulty_from:
                        faulty_from.append(requests[-1])
                    return fault if faulty_from and requests[-1] - faulty_from[0] < 0.8 else {}

                server.faults = [answer] * 1000
                run = subprocess.run([PROBE, "seek", server.url, "1.3", "2.7"],
                                     stdout=subprocess.PIPE, check=True, timeout=60)
                out = json.loads(run.stdout)
                self.assertNotIn("error", out)
                self.assertGreater(out["took"][0], 0.99, out)
                self.assertLess(out["took"][1], 3, out)

    def test_seeks_work_with_late_responses(self):
        self.faulty([{"delay": 0.1}] * 400, 2, 2.5, 0.2, 1.7, 0.9, 2.9)

    def test_replacing_the_file_is_reported_once(self):
        def replace(server):
            server.data = server.data[::-1]
            server.etag = '"2"'

        with FaultyServer(self.data, [{}] * 4 + [{"do": replace}]) as server:
            out = self.play(server.url, 1.5)
        self.assertGreater(out["counts"].get("read_failed", 0), 0, out)
        self.assertEqual(out["counts"].get("replaced", 0), 1, out)
        self.assertEqual(out["counts"].get("damaged", 0), 0, out)
        self.assertLess(out["longest_call"], 0.5, out)
        self.assertLess(out["closed_in"], 2, out)


@unittest.skipUnless(shutil.which("nginx"), "needs nginx")
class PlayNginx(unittest.TestCase):
    """nginx behind a link with faults, or with a file that is removed for a while."""
    play, assert_recovered = Play.play, Play.assert_recovered

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.served = self.folder + "/scene.stgs"
        self.file = self.folder + "/local.stgs"  # for comparison
        subprocess.run([PROBE, "make", self.served], check=True, timeout=120)
        shutil.copyfile(self.served, self.file)
        self.size = os.path.getsize(self.file)

    def over_link(self, faults, seconds, *seeks, stall_seconds=1):
        with Nginx(self.folder) as server, FaultyLink(server.port, faults) as link:
            out = self.play(link.url, seconds, *seeks, stall_seconds=stall_seconds)
            self.assertGreater(link.connections, 0)
        self.assert_recovered(out)
        self.assertGreater(out["frames_ready"], 0)
        return out

    def test_delays_cause_no_errors(self):
        out = self.over_link([{"delay": 0.1}] * 100, 2, stall_seconds=10)
        self.assertEqual(out["messages"], [])

    def test_seeks_work_with_delays(self):
        self.over_link([{"delay": 0.05}] * 100, 2, 2.5, 0.2, 1.7, 0.9, 2.9)

    def test_resets_are_retried(self):
        part = self.size // 16
        out = self.over_link([{}, {"cut": part}, {"cut": 0}, {}, {"cut": 300}, {"cut": part}] * 2, 2)
        self.assertGreater(out["counts"].get("retry", 0), 0, out)

    def test_stalls_are_retried(self):
        out = self.over_link([{}, {"stall": self.size // 16}, {}, {"stall": 0}], 3)
        self.assertGreater(out["counts"].get("retry", 0), 0, out)

    def while_it_plays(self, take_away, put_back, seconds):
        """Plays while the file is missing: connections are cut after a tenth of the file, the first
        cut calls take_away, and put_back is called a second after the next connection."""
        first, missing = threading.Lock(), []
        with Nginx(self.folder) as server, FaultyLink(server.port) as link:
            def put_back_when_missed(connected):
                while link.connections == connected and not link.ended.is_set():
                    time.sleep(0.01)
                link.ended.wait(1)
                put_back()

            def begin():
                if first.acquire(blocking=False):
                    take_away()
                    missing.append(threading.Thread(target=put_back_when_missed,
                                                    args=[link.connections]))
                    missing[0].start()

            link.faults = [{"cut": self.size // 10, "do": begin}] * 12
            out = self.play(link.url, seconds)
        self.assertTrue(missing, "no connection was cut")
        missing[0].join()
        return out

    def test_a_temporary_404_is_reported_and_survived(self):
        backup = self.served + ".backup"
        out = self.while_it_plays(lambda: os.rename(self.served, backup),
                                  lambda: os.rename(backup, self.served), 4)
        self.assert_recovered(out)
        self.assertGreater(out["counts"].get("read_failed", 0), 0, out)
        self.assertTrue(any("404" in m for m in out["messages"]), out)

    def test_a_replaced_and_restored_file_recovers(self):
        """The replacement is smaller, then larger."""
        backup, other = self.served + ".backup", self.served + ".other"

        def replace(size):
            with open(other, "wb") as file:
                file.write((bytes(range(256)) * (size // 256 + 1))[:size])
            os.link(self.served, backup)
            os.replace(other, self.served)

        for size in ((self.size - 1) // 256 * 256, self.size + 1000):
            with self.subTest(size=size):
                out = self.while_it_plays(lambda n=size: replace(n),
                                          lambda: os.replace(backup, self.served), 4)
                self.assert_recovered(out)  # no byte of the other file is used
                self.assertEqual(out["counts"].get("replaced", 0), 1, out)
                self.assertEqual(out["counts"].get("damaged", 0), 0, out)


class Live(unittest.TestCase):
    """A recorder appends a fragment of a third of a second in about real time."""
    # More under a sanitizer, because the programs start slowly.
    FRAGMENTS = 30 if os.environ.get("STGS_SANITIZE") else 10

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.file = self.folder + "/scene.stgs"
        self.recorder = subprocess.Popen([RECORDER, self.file, str(self.FRAGMENTS), "333"])
        self.addCleanup(self.recorder.wait)
        self.addCleanup(self.recorder.kill)

    def read(self):
        with open(self.file, "rb") as file:
            return file.read()

    def wait_for_fragments(self, count):
        """Waits for about `count` fragments of 8 kB; the exact number does not matter."""
        min_bytes = 4000 * count
        while not os.path.exists(self.file) or os.path.getsize(self.file) < min_bytes:
            time.sleep(0.02)

    def follow(self, url, stall_seconds=1):
        seconds = str(self.FRAGMENTS / 3 + 9)
        run = subprocess.run([PROBE, "follow", url, seconds], stdout=subprocess.PIPE, check=True,
                             timeout=60, env={**os.environ, "STALL_SECONDS": str(stall_seconds)})
        out = json.loads(run.stdout)
        self.assertNotIn("error", out)
        self.assertTrue(out["growing"], out)
        self.assertGreater(out["joined"], 0, out)
        self.assertTrue(out["ended"], out)
        self.assertLess(out["longest_call"], 0.5, out)
        self.assertEqual(out["counts"].get("finished"), 1, out)
        self.assertEqual(out["counts"].get("damaged", 0), 0, out)
        return out

    def assert_all_shown(self, out):
        """Checks that every third of a second was shown from the joining time to the end."""
        self.assertEqual(out["shown"], list(range(int(3 * out["joined"] + 1e-6), self.FRAGMENTS)))

    @unittest.skipUnless(shutil.which("nginx"), "needs nginx")
    def test_a_recording_on_nginx_is_followed(self):
        with Nginx(self.folder) as server:
            self.wait_for_fragments(4)
            out = self.follow(server.url, stall_seconds=10)
        self.assert_all_shown(out)
        self.assertEqual(out["messages"], [])

    def served(self, faults, mangle=lambda data: data):
        """Serves the growing file while it is followed; `mangle` maps its bytes to those served."""
        self.wait_for_fragments(2)
        data = self.read()
        with FaultyServer(data, [{}] * 8 + faults) as server:
            server.etag = f'"{len(data)}"'
            ended = threading.Event()

            def renew():
                while not ended.wait(0.02):
                    data = mangle(self.read())
                    with server.lock:
                        server.data, server.etag = data, f'"{len(data)}"'

            thread = threading.Thread(target=renew)
            thread.start()
            try:
                return self.follow(server.url)
            finally:
                ended.set()
                thread.join()

    def test_link_faults_are_retried(self):
        out = self.served([{"cut": 0}, {}, {"status": 503}, {}, {"cut": 100}, {}] * 6)
        self.assertGreater(out["counts"].get("retry", 0), 0, out)
        self.assertEqual(out["counts"].get("replaced", 0), 0, out)

    def test_a_temporarily_missing_file_is_reported(self):
        out = self.served([{"status": 404}] * 12)
        self.assertGreater(out["counts"].get("read_failed", 0), 0, out)
        self.assertTrue(any("404" in m for m in out["messages"]), out)

    def test_a_temporarily_shorter_file_is_reported_as_replaced(self):
        times = []

        def mangle(data):
            times.append(time.monotonic())
            return data[:3000] if 0.5 < times[-1] - times[0] < 1.1 else data

        out = self.served([], mangle)
        self.assertGreaterEqual(out["counts"].get("replaced", 0), 1, out)


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *sys.argv[4:]], verbosity=2)
