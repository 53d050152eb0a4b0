# SPDX-License-Identifier: Apache-2.0
"""The common part of the drivers of browsers."""
import base64
import os
import signal
import time


class BrowserPage:
    """A page of a browser. A driver sets `process`, which leads a process group."""

    def wait_for(self, condition, seconds=20):
        end = time.monotonic() + seconds
        while not self.evaluate(condition):
            if time.monotonic() > end:
                raise TimeoutError(f"still false after {seconds} s: {condition}")
            time.sleep(0.05)

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.screenshot_data()))

    def close(self):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
