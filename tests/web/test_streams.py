#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Players that share a page, slow servers and recordings. See package_case.py for the usage."""
import os
import shutil
import subprocess
import tempfile

from package_case import Nginx, PackageCase, run
from faulty_server import FaultyServer  # in a folder that package_case adds

# With which pages of other origins can read a file.
OPEN = (("Access-Control-Allow-Origin", "*"), ("Access-Control-Expose-Headers", "Content-Range, ETag"))


class Streams(PackageCase):
    PAGE = "player_page.html"

    def open(self, page):
        self.browser.open(self.url + page)
        self.wait("'show' in window")

    def test_two_players_on_a_page(self):
        self.check("""(() => {
          window.players = [0, 1].map(() => {
            const player = document.createElement("stgs-player");
            player.style.height = "50vh";
            document.body.append(player);
            player.src = "scene.stgs";
            return player;
          });
        })()""")
        self.assertFalse(self.check("crossOriginIsolated"))  # without headers COOP and COEP
        self.wait("players.every((player) => player.readyState >= 3)")
        self.check("players[0].playbackRate = 0.25, players[0].play(), players[1].currentTime = 1.5, 0")
        self.wait("players[0].currentTime > 0.1 && !players[1].seeking")
        self.capture("two_players")
        self.assertEqual(self.check("players[1].currentTime"), 1.5)
        self.assertTrue(self.check("players[1].paused"))
        self.check("players[0].remove()")
        self.check("players[1].currentTime = 0.5")
        self.wait("!players[1].seeking")
        image = self.check("players[1].screenshot().then((blob) => blob.size)")
        self.assertGreater(image, 1000)

    def test_a_slow_server_stalls_and_resumes(self):
        folder = tempfile.mkdtemp(prefix="stgs-slow-")
        self.addCleanup(shutil.rmtree, folder, True)
        shutil.copy(os.path.join(self.work, "scene.stgs"), folder)
        bytes_per_second = os.path.getsize(os.path.join(folder, "scene.stgs")) // 6  # plays 2 s
        with Nginx(folder, str(bytes_per_second), settings="".join(f"add_header {name} '{value}';" for name, value in OPEN)) as slow:
            self.check("show", {"src": slow.url, "autoplay": ""})
            self.wait("player.currentTime > 0 || player.error", 60)
            self.assertIsNone(self.check("player.error && player.error.message"))
            self.wait("player.ended || player.error", 60)
            self.assertIsNone(self.check("player.error && player.error.message"))
        events = self.check("events")
        self.assertIn("waiting", events)
        self.assertEqual(events[-1], "ended")

    def show_from(self, faults):
        """Shows the scene from a server with faults. Returns the message of the error, or None."""
        with open(os.path.join(self.work, "scene.stgs"), "rb") as file:
            data = file.read()
        with FaultyServer(data, faults, OPEN) as server:
            self.check("show", {"src": server.url})
            self.wait("player.readyState === 4 || player.error")
            self.faults_left = server.faults
            return self.check("player.error && player.error.message")

    def test_faults_that_end_are_survived(self):
        for fault in ({"status": 503}, {"status": 429, "retry_after": 1}, {"cut": 100}, {"long": 7}):
            for before in ([], [{}]):  # in the first read, which the page does, and in one of the worker
                with self.subTest(fault=fault, before=before):
                    self.assertIsNone(self.show_from([*before, fault]))
                    self.assertEqual(self.faults_left, [])

    def test_faults_that_do_not_end_are_reported(self):
        for fault, message in (({"status": 404}, "no such file"), ({"status": 403}, "refuses access"),
                               ({"complete": True}, "does not support range requests"),
                               ({"shift": 1}, "another range than requested"),
                               ({"cut": 10}, "check the address, the network")):
            with self.subTest(fault=fault):
                self.assertIn(message, str(self.show_from(9 * [fault])))

    def test_a_recording_is_followed_until_it_is_closed(self):
        fragments, seconds = 24, 1 / 3
        path = os.path.join(self.work, "live.stgs")
        recorder = subprocess.Popen([self.record, path, str(fragments), str(round(1000 * seconds))])
        self.addCleanup(recorder.wait)
        self.addCleanup(recorder.kill)
        while not os.path.exists(path) or os.path.getsize(path) < 10_000:  # two fragments
            self.assertIsNone(recorder.poll())
        self.check("show", {"src": "live.stgs", "autoplay": "", "controls": ""})
        is_live = "player.live?.following && player.shadowRoot.querySelector('.live').ariaPressed === 'true'"
        self.wait(f"player.error || ({is_live} && player.currentTime > 0.3)")
        self.assertIsNone(self.check("player.error && player.error.message"))
        self.check("player.latency = 2.5")
        self.wait("player.live.targetLatency === 2.5")
        self.check("player.removeAttribute('latency')")
        self.wait("player.live.targetLatency < 2.5")
        before = self.check("player.duration")
        self.wait(f"player.duration > {before} + {seconds}")
        self.check("player.currentTime = 0.2")
        self.wait("!player.seeking && player.live?.following === false")
        self.assertLess(self.check("player.currentTime"), 1)
        self.check("player.goLive()")
        self.wait(is_live)
        self.assertGreater(self.check("player.currentTime"), before - 1.5)
        values = self.check("""player.screenshot().then((blob) => createImageBitmap(blob)).then((image) => {
            const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
            context.drawImage(image, 0, 0);
            return new Set(context.getImageData(0, 0, image.width, image.height).data).size; })""")
        self.assertGreater(values, 50)
        self.capture("recording")
        self.wait("player.error || player.ended")
        self.assertIsNone(self.check("player.error && player.error.message"))
        self.assertIsNone(self.check("player.live"))
        self.assertAlmostEqual(self.check("player.duration"), fragments * seconds, 5)
        self.check("player.play()")  # as any file, from its beginning
        self.wait("player.currentTime > 0.1")
        self.assertLess(self.check("player.currentTime"), fragments * seconds / 2)


if __name__ == "__main__":
    run(Streams)
