#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Players that share a page, and slow servers. See package_case.py for the usage."""
import os
import shutil
import tempfile

from package_case import Nginx, PackageCase, run


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
        with Nginx(folder, str(bytes_per_second)) as slow:
            self.allow_pages(folder, slow)
            self.check("show", {"src": slow.url, "autoplay": ""})
            self.wait("player.currentTime > 0 || player.error", 60)
            self.assertIsNone(self.check("player.error && player.error.message"))
            self.wait("player.ended || player.error", 60)
            self.assertIsNone(self.check("player.error && player.error.message"))
        events = self.check("events")
        self.assertIn("waiting", events)
        self.assertEqual(events[-1], "ended")

    @staticmethod
    def allow_pages(folder, server):
        """Lets pages of other origins read the file."""
        with open(server.config, encoding="ascii") as file:
            config = file.read()
        header = ("add_header Access-Control-Allow-Origin *;"
                  "add_header Access-Control-Expose-Headers 'Content-Range, ETag';")
        with open(server.config, "w", encoding="ascii") as file:
            file.write(config.replace(f"root {folder};", f"root {folder}; {header}"))
        server.server.send_signal(1)  # reads its configuration again


if __name__ == "__main__":
    run(Streams)
