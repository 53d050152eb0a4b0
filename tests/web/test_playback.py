#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Playback, and 100 seeks: times of frames, and memory. See package_case.py for the usage. With
PLAY_SECONDS=N in the environment, playback lasts N seconds.
"""
import os

from package_case import PackageCase, run

SECONDS = float(os.environ.get("PLAY_SECONDS", "8"))


class Playback(PackageCase):
    PAGE = "playback_page.html"

    def heap(self):
        """Returns the bytes that scripts of the page use."""
        self.browser.send("HeapProfiler.collectGarbage")
        return self.browser.send("Runtime.getHeapUsage")["usedSize"]

    def memory(self):
        """Returns the resident bytes of the processes of pages, with workers and WebAssembly."""
        total = 0
        for process in self.browser.call("browserSession.send", "SystemInfo.getProcessInfo")["processInfo"]:
            if process["type"] != "renderer":
                continue
            try:
                with open(f"/proc/{process['id']}/statm", encoding="ascii") as file:
                    total += int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
            except (FileNotFoundError, ProcessLookupError):
                pass  # it has ended
        return total

    def play(self, seconds):
        # Longer than a command of the browser may take.
        self.check(f"delete window.result, playFor({seconds}).then((result) => (window.result = result)), 0")
        self.wait("'result' in window", seconds + 60)
        return self.check("result")

    def check_memory(self, before):
        """Checks that the heap and the memory are about as before."""
        after = self.heap(), self.memory()
        print("heap and memory of the page, MB:", [f"{value / 1e6:.1f}" for value in before + after],
              flush=True)
        self.assertLess(after[0], before[0] + 1e6)
        self.assertGreater(before[1], 0)
        self.assertLess(after[1], 1.25 * before[1])

    def test_frames_follow_the_clock(self):
        self.play(4)
        before = self.heap(), self.memory()
        result = self.play(SECONDS)
        print(result, flush=True)
        self.assertGreaterEqual(result["fps"], 10)
        self.assertGreater(result["loops"], SECONDS / 2 / 2)
        self.assertLess(result["largest"], result["tick"])
        self.check_memory(before)

    def test_seeks_do_not_retain_memory(self):
        self.check("player.load('scene.stgs')")
        self.wait("player.readyState >= 3")
        self.check("seek(20)")
        before = self.heap(), self.memory()
        for _ in range(8):
            self.check("seek(10)")
        self.check_memory(before)


if __name__ == "__main__":
    run(Playback)
